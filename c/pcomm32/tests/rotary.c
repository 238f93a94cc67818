/* Lines through a rotary buffer, as a streaming thread of a program sends them. */
#include "check.h"

#define LINES 150

/* The buffer takes a line, or is full until an empty one is taken. */
static void stream(const char *line)
{
    SHORT taken = PmacDPRAsciiStrToRotA(0, line, 0);
    for (int tries = 0; taken == DprBufBsy && tries < 2000; tries++) {
        Sleep(5);
        taken = PmacDPRAsciiStrToRotA(0, "", 0);
    }
    CHECK(taken == DprOk);
}

static int first;

/* Opens the buffer as programs do. */
static void open_buffer(void)
{
    char response[256];
    CHECK(PmacDPRRotBufChange(0, 0, 200) >= 0);
    send("&1A");
    send("CLOSE");
    /* Refused by a board that has none. */
    PmacGetResponseA(0, response, sizeof response, "&1 DEL ROT");
    send("&1 DEF ROT 100");
    send("&1B0R");
    send("OPEN BIN ROT");
}

static void reaches(double position)
{
    for (int tries = 0; tries < 1200 && PmacDPRPosition(0, first, 1) != position; tries++)
        Sleep(50);
    EQUAL(PmacDPRPosition(0, first, 1), position);
}

int main(void)
{
    const char *motor = getenv("PMAC_FIRST_MOTOR");
    char line[64];
    first = motor ? atoi(motor) : 0;
    CHECK(OpenPmacDevice(0));
    CHECK(PmacDPRRealTimeEx(0, 0xFF, 1, 1));
    send("&1 #1->X");
    EQUAL(PmacDPRBufLast(0), 0);
    CHECK(PmacDPRAsciiStrToRotA(0, "X1\n", 0) < 0);
    open_buffer();
    CHECK(PmacDPRBufLast(0) > 0);
    stream("LINEAR ABS TM20 TA10 TS0\n");
    for (int i = 1; i <= LINES; i++) {
        snprintf(line, sizeof line, "X%d\n", i * 10);
        stream(line);
    }
    CHECK(PmacDPRAsciiStrToRotA(0, "XYZZY\n", 0) < 0);
    reaches(LINES * 10);

    /* A program ends the stream by an abort amid the lines, and begins another. */
    for (int i = 1; i <= 20; i++) {
        snprintf(line, sizeof line, "X%d\n", LINES * 10 - i * 10);
        stream(line);
    }
    send("&1A");
    send("CLOSE");
    open_buffer();
    stream("LINEAR ABS TM20 TA10 TS0\n");
    CHECK(PmacDPRAsciiStrToRotEx(0, "X500\n", 0, TRUE) >= 0);
    stream("");
    reaches(500);
    /* Commands that the program has converted itself. */
    DWORD command[2] = {0, 0};
    const char *code = pmacctl("rotary encode - <<'END'\nX600\nEND\n");
    CHECK(sscanf(code, "%x %x", &command[0], &command[1]) == 2);
    EQUAL(PmacDPRrotput(0, 2, command, 0), RET_OKAY);
    EQUAL(PmacDPRrotput(0, 1, command, 0), RET_ERROR);
    EQUAL(PmacDPRrotput(0, 2, NULL, 0), RET_ERROR);
    reaches(600);

    send("&1A");
    send("CLOSE");
    send("&1 DEL ROT");
    PmacDPRRotBufClr(0, 0);
    CHECK(PmacDPRRotBufRemove(0, 0) >= 0);
    EQUAL(PmacDPRBufLast(0), 0);
    CHECK(PmacDPRRotBufRemove(0, 0) < 0);
    CHECK(ClosePmacDevice(0));
    return finish("rotary");
}
