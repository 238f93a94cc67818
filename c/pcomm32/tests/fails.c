/* What the functions return without a board: a wrong device number, a closed device, NULL, and a daemon
 * that dies between two calls. Writes "kill" and "start" when run shall do that to the daemon, and waits for a line. */
#include "check.h"
#include <pthread.h>
#include <time.h>

static char text[64];
/* A file with a line for the board. */
static char lines[] = "/tmp/pcomm32-XXXXXX";

/* Nothing here has a board: every function says so. */
static void nothing_works(DWORD device)
{
    memset(text, '#', sizeof text);
    EQUAL(PmacGetResponseA(device, text, sizeof text, "P1"), 0);
    CHECK(IS_COMM_FAIL((DWORD)PmacGetResponseExA(device, text, sizeof text, "P1")));
    CHECK(memchr(text, 0, sizeof text) != NULL);
    CHECK(PmacGetError(device) != 0);
    CHECK(PmacGetErrorStrA(device, text, sizeof text) > 0 && text[0]);
    EQUAL(PmacSendLineA(device, "P1"), 0);
    EQUAL(PmacGetLineA(device, text, sizeof text), 0);
    EQUAL(PmacGetControlResponseA(device, text, sizeof text, 'P' - '@'), 0);
    CHECK(!PmacSendCharA(device, 'P' - '@'));
    CHECK(PmacGetVariableDouble(device, 'P', 1, -12345) == -12345);
    EQUAL(PmacGetVariable(device, 'P', 1, -5), -5);
    EQUAL(PmacGetVariableLong(device, 'P', 1, -6), -6);
    EQUAL(PmacGetIVariableLong(device, 10, -7), -7);
    PmacSetVariableDouble(device, 'P', 1, 1);
    CHECK(PmacGetError(device) != 0);
    LONG word = 1;
    CHECK(PmacDPRGetMem(device, 0, sizeof word, &word) == NULL);
    CHECK(PmacDPRSetMem(device, 0xA40, sizeof word, &word) == NULL);
    EQUAL(PmacDPRGetDWord(device, 0), 0);
    CHECK(!PmacDPRRealTimeEx(device, 1, 1, 1));
    CHECK(!PmacDPRUpdateRealTime(device));
    CHECK(!PmacDPRBackground(device, 1));
    CHECK(isnan(PmacDPRPosition(device, 0, 1)));
    CHECK(!PmacDPRInposition(device, 0));
    CHECK(PmacDPRAsciiStrToRotA(device, "X1", 0) < 0);
    CHECK(PmacDPRRotBufChange(device, 0, 100) < 0);
    EQUAL(PmacDownloadA(device, NULL, NULL, NULL, lines, 0, 0, 0, 1), 0);
    CHECK(!PmacGetDpramAvailable(device));
    EQUAL(PmacGetPmacType(device), 0);
    CHECK(PmacGetRomVersionA(device, text, sizeof text) == text);
    SAME(text, "");
}

static void missing_arguments(void)
{
    EQUAL(PmacGetResponseA(0, NULL, 64, "P1"), 0);
    EQUAL(PmacGetResponseA(0, text, 0, "P1"), 0);
    EQUAL(PmacGetResponseA(0, text, sizeof text, NULL), 0);
    CHECK(IS_COMM_FAIL((DWORD)PmacGetResponseExA(0, text, sizeof text, NULL)));
    EQUAL(PmacSendLineA(0, NULL), 0);
    EQUAL(PmacGetLineA(0, NULL, 64), 0);
    EQUAL(PmacGetErrorStrA(0, NULL, 64), 0);
    CHECK(PmacGetRomVersionA(0, NULL, 0) == NULL);
    CHECK(!PmacGetVariableStrA(0, 'P', NULL, 1));
    CHECK(PmacDPRGetMem(0, 0, 4, NULL) == NULL);
    CHECK(PmacDPRSetMem(0, 0xA40, 4, NULL) == NULL);
    CHECK(PmacDPRGetMem(0, 0x7FFFFFFF, 4, text) == NULL);
    CHECK(PmacDPRGetMem(0, 0, -1, text) == NULL);
    CHECK(PmacDPRGetMem(0, 0, 0x7FFFFFFF, text) == NULL);
    EQUAL(PmacDPRGetDWord(0, 0xFFFFFFFF), 0);
    CHECK(isnan(PmacDPRPosition(0, -1, 1)));
    CHECK(isnan(PmacDPRPosition(0, 1000, 1)));
    EQUAL(PmacDownloadA(0, NULL, NULL, NULL, NULL, 0, 0, 0, 1), 0);
    CHECK(PmacDPRAsciiStrToRotA(0, NULL, 0) < 0);
    CHECK(!PmacINTRFuncCallInit(0, NULL, 0, 0));
    PmacDPRGetMasterPos(0, 0, 1, NULL);
    PmacDPRGetGlobalStatus(0, NULL);
    PmacDPRGetGlobalStatusTurbo(0, NULL);
    CHECK(isnan(PmacDPRVectorVelocity(0, 2, NULL, NULL)));
    CHECK(isnan(PmacDPRFloat(NULL, 1)));
    CHECK(isnan(PmacDPRLFixed(NULL, 1)));
    CHECK(OpenPmacDevice(0));
    EQUAL(PmacGetVariableDouble(0, 'P', 1, -1), PmacGetVariableDouble(0, 'P', 1, -2));
}

static volatile int ends;

static void *busy(void *unused)
{
    char response[64];
    LONG words[16];
    while (!ends) {
        PmacGetResponseA(0, response, sizeof response, "P1..20");
        PmacDPRGetMem(0, 0, sizeof words, words);
        PmacDPRPosition(0, 0, 1);
        PmacSendLineA(0, "P1");
        PmacGetLineA(0, response, sizeof response);
    }
    return unused;
}

static void ask_for(const char *what)
{
    puts(what);
    fflush(stdout);
    CHECK(fgets(text, sizeof text, stdin) != NULL);
}

static void daemon_dies(void)
{
    pthread_t threads[4];
    for (int i = 0; i < 4; i++)
        pthread_create(&threads[i], NULL, busy, NULL);
    Sleep(300);
    ask_for("kill");
    Sleep(300);
    time_t began = time(NULL);
    EQUAL(PmacGetResponseA(0, text, sizeof text, "P1"), 0);
    CHECK(time(NULL) - began < 15);
    CHECK(PmacGetError(0) != 0);
    ends = 1;
    for (int i = 0; i < 4; i++)
        pthread_join(threads[i], NULL);
    /* Old positions are not told as live ones. */
    Sleep(1500);
    CHECK(!PmacDPRUpdateRealTime(0));
    nothing_works(0);
    CHECK(!OpenPmacDevice(0) || PmacGetError(0) != 0);
    ask_for("start");
    CHECK(OpenPmacDevice(0));
    EQUAL(PmacGetResponseA(0, text, sizeof text, "P1=4 P1"), 2);
    SAME(text, "4\r");
    CHECK(is_live());
}

static int restarts;

static void WINAPI restart(LONG percent)
{
    if (percent == 1 && !restarts++) {
        /* The daemon's last word on these lines has come. */
        Sleep(300);
        ask_for("kill");
        ask_for("start");
    }
}

/* No line runs twice, and the error tells how far the download came. */
static void daemon_restarts_amid_a_download(void)
{
    char why[512];
    FILE *file = fopen(lines, "w");
    for (int line = 0; line < 800; line++)
        fputs("P30=P30+1\n", file);
    fclose(file);
    EQUAL(PmacDownloadA(0, NULL, NULL, restart, lines, 0, 0, 0, 1), 0);
    EQUAL(restarts, 1);
    EQUAL(PmacGetError(0), -1);
    PmacGetErrorStrA(0, why, sizeof why);
    CHECK(strstr(why, "8 of 800 lines succeeded") != NULL);
    EQUAL(PmacGetVariableLong(0, 'P', 30, -1), 0);
}

int main(void)
{
    const DWORD wrong[] = {1, 7, 8, 99, 0x80000000u, 0xFFFFFFFFu};
    FILE *file = fdopen(mkstemp(lines), "w");
    fputs("P1=1\n", file);
    fclose(file);
    nothing_works(0);
    for (unsigned i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        CHECK(!OpenPmacDevice(wrong[i]));
        nothing_works(wrong[i]);
    }
    CHECK(OpenPmacDevice(0));
    missing_arguments();
    daemon_dies();
    daemon_restarts_amid_a_download();
    CHECK(ClosePmacDevice(0));
    nothing_works(0);
    remove(lines);
    return finish("fails");
}
