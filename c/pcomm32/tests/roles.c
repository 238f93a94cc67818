/* A program whose user may stop the machine and no more: what would move it is refused, and every stop goes through. */
#include "check.h"

int main(void)
{
    char text[256];
    CHECK(OpenPmacDevice(0));
    CHECK(is_live());
    /* The daemon has asked the board for its scales. */
    for (int tries = 0; tries < 200 && isnan(PmacDPRPosition(0, 0, 1)); tries++)
        Sleep(50);
    EQUAL(PmacDPRPosition(0, 0, 1), 0);
    const char *refused[] = {"#1J+", "P1=1", "&1B1R", "I5=3"};
    for (int i = 0; i < 4; i++) {
        CHECK(IS_COMM_ERROR((DWORD)PmacGetResponseExA(0, text, sizeof text, refused[i])));
        CHECK(PmacGetError(0) > 0);
        CHECK(PmacGetErrorStrA(0, text, sizeof text) > 0);
    }
    PmacSetVariableDouble(0, 'P', 1, 5);
    CHECK(PmacGetError(0) > 0);
    LONG word = 1;
    CHECK(PmacDPRSetMem(0, (0xD800 - 0xD000) * 4, sizeof word, &word) == NULL);
    CHECK(PmacDPRAsciiStrToRotA(0, "X1", 0) < 0);
    CHECK(PmacDownloadA(0, NULL, NULL, NULL, "c/pcomm32/tests/roles.c", 0, 0, 0, 1) == 0);

    const CHAR stops[] = {'A' - '@', 'K' - '@', 'O' - '@'};
    for (int i = 0; i < 3; i++) {
        CHECK(IS_COMM_EOT((DWORD)PmacGetControlResponseExA(0, text, sizeof text, stops[i])));
        EQUAL(PmacGetError(0), 0);
        CHECK(PmacSendCharA(0, stops[i]));
        CHAR line[2] = {stops[i], 0};
        CHECK(IS_COMM_EOT((DWORD)PmacGetResponseExA(0, text, sizeof text, line)));
        CHECK(PmacSendLineA(0, line) > 0);
        EQUAL(PmacGetError(0), 0);
    }
    CHECK(ClosePmacDevice(0));
    return finish("roles");
}
