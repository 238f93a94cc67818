/* Devices, lines, variables, words of the DPRAM and downloads, against a board: the functions return what pmacctl
 * tells. `works turbo` has a Turbo board. */
#include "check.h"
#include <pthread.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

/* Words that pmacd leaves to programs. */
#define FREE_PMAC "$D800"
#define FREE_TURBO "$60A10"

static int turbo;

static const char *ask(const char *command)
{
    static char response[1024];
    PmacGetResponseA(0, response, sizeof response, command);
    return response;
}

static void devices(void)
{
    CHECK(OpenPmacDevice(0));
    EQUAL(DrvNumberOfDevices(), 1);
    EQUAL(PmacSelect(NULL), 0);
    CHECK(!PmacConfigure(NULL, 0));
    LockPmac(0);
    ReleasePmac(0);
    CHECK(ClosePmacDevice(0));
    CHECK(OpenPmacDevice(0));
    CHECK(OpenPmacDevice(0));
    EQUAL(PmacGetError(0), 0);
}

static void responses(void)
{
    char text[256] = "old";
    EQUAL(PmacGetResponseA(0, text, sizeof text, "P1=12.5"), 0);
    SAME(text, "");
    EQUAL(PmacGetError(0), 0);
    EQUAL(PmacGetResponseA(0, text, sizeof text, "P1"), 5);
    SAME(text, "12.5\r");
    SAME(pmacctl("send P1"), "12.5");
    pmacctl("send P2=-3");
    EQUAL(PmacGetResponseA(0, text, sizeof text, "P1P2"), 8);
    SAME(text, "12.5\r-3\r");
    EQUAL(PmacGetResponseA(0, text, sizeof text, "P1\nP2\r"), 8);
    SAME(text, "12.5\r-3\r");
    EQUAL(PmacGetResponseA(0, text, sizeof text, ""), 0);

    CHECK((DWORD)PmacGetResponseExA(0, text, sizeof text, "P1") == (COMM_EOT | 5));
    CHECK((DWORD)PmacGetResponseExA(0, text, sizeof text, "P3=1") == COMM_EOT);
    SAME(text, "");
    CHECK(IS_COMM_ERROR((DWORD)PmacGetResponseExA(0, text, sizeof text, "XYZZY")));
    EQUAL(PmacGetError(0), 3);
    CHECK(PmacGetErrorStrA(0, text, sizeof text) > 0 && strstr(text, "ERR003"));
    EQUAL(PmacGetResponseA(0, text, sizeof text, "P1"), 5);
    EQUAL(PmacGetError(0), 0);

    /* A buffer of four has room for three characters. Nothing is written behind it. */
    memset(text, '#', sizeof text);
    EQUAL(PmacGetResponseA(0, text, 4, "P1"), 3);
    SAME(text, "12.");
    CHECK(text[4] == '#');
    CHECK(IS_COMM_MORE((DWORD)PmacGetResponseExA(0, text, 4, "P1")));
    EQUAL(PmacGetResponseA(0, text, 1, "P1"), 0);
    SAME(text, "");

    /* The same in characters of 16 bits. */
    WCHAR wide[256];
    EQUAL(PmacGetResponseW(0, wide, 32, u"P1"), 5);
    CHECK(memcmp(wide, u"12.5\r", 6 * sizeof(WCHAR)) == 0);
    CHECK((DWORD)PmacGetResponseExW(0, wide, 32, u"P1") == (COMM_EOT | 5));
    EQUAL(PmacSendLineW(0, u"P1P2"), 4);
    EQUAL(PmacGetLineW(0, wide, 32), 5);
    CHECK((PmacGetLineExW(0, wide, 32) & 0x0FFFFFFF) == 3 && memcmp(wide, u"-3\r", 4 * sizeof(WCHAR)) == 0);
    EQUAL(PmacGetLineW(0, wide, 32), 0);
    EQUAL(PmacGetControlResponseW(0, wide, 256, 'P' - '@'), PmacGetControlResponseA(0, text, sizeof text, 'P' - '@'));
    CHECK(IS_COMM_EOT((DWORD)PmacGetControlResponseExW(0, wide, 256, 'P' - '@')));

    /* Which motor a line addresses, and which program is open, is the board's state between calls. */
    ask("#3J=300");
    ask("#3");
    for (int tries = 0; tries < 600 && strcmp(ask("P"), "300\r") != 0; tries++)
        Sleep(50);
    SAME(ask("P"), "300\r");
    /* Behind a line that fails only stops go out. The error tells how many lines ran. */
    ask("#3J+");
    CHECK(IS_COMM_ERROR((DWORD)PmacGetResponseExA(0, text, sizeof text, "P4=2\nXYZZY\nP4=3\n#3J/")));
    EQUAL(PmacGetError(0), 3);
    PmacGetErrorStrA(0, text, sizeof text);
    CHECK(strstr(text, "2 of 4 lines succeeded") != NULL);
    SAME(ask("P4"), "2\r");
    char still[64];
    for (int tries = 0; tries < 100; tries++) {
        strcpy(still, ask("P"));
        Sleep(50);
        if (strcmp(ask("P"), still) == 0)
            break;
    }
    Sleep(200);
    SAME(ask("P"), still);

    ask("OPEN PROG 17");
    CHECK(InBufferedMode(0));
    ask("CLEAR");
    ask("X10");
    ask("CLOSE");
    CHECK(!InBufferedMode(0));
    CHECK(strstr(ask("LIST PROG 17"), "X10") != NULL);
}

static void lines(void)
{
    char text[256];
    ask("P1=1 P2=2 P3=3");
    CHECK(!PmacReadReady(0));
    EQUAL(PmacSendLineA(0, "P1..3"), 5);
    CHECK(PmacReadReady(0));
    EQUAL(PmacGetLineA(0, text, sizeof text), 2);
    SAME(text, "1\r");
    EQUAL(PmacGetLineA(0, text, sizeof text), 2);
    EQUAL(COMM_CHARS(PmacGetLineExA(0, text, sizeof text)), 2);
    SAME(text, "3\r");
    EQUAL(PmacGetLineA(0, text, sizeof text), 0);
    CHECK(!PmacReadReady(0));

    CHECK(PmacSendLineA(0, "P4=44\nP4\nP5=55\nP5") > 0);
    EQUAL(PmacGetLineA(0, text, sizeof text), 3);
    SAME(text, "44\r");
    EQUAL(PmacGetLineA(0, text, sizeof text), 3);
    SAME(text, "55\r");
    EQUAL(PmacGetLineA(0, text, sizeof text), 0);

    /* A line without a reply: its end can be waited for, and is read. */
    CHECK(PmacSendLineA(0, "P6=1") > 0);
    CHECK(PmacReadReady(0));
    EQUAL(PmacGetLineA(0, text, sizeof text), 0);
    CHECK(!PmacReadReady(0));

    /* A success has nothing of the failure before. */
    EQUAL(PmacSendLineA(0, "XYZZY"), 0);
    CHECK(PmacSendLineA(0, "P6=1") > 0);
    CHECK((DWORD)PmacGetLineExA(0, text, sizeof text) == COMM_EOT);

    CHECK(PmacSendLineA(0, "P1..3") > 0);
    EQUAL(PmacGetBufferA(0, text, sizeof text), 6);
    SAME(text, "1\r2\r3\r");
    CHECK(PmacSendLineA(0, "P1..3") > 0);
    PmacFlush(0);
    CHECK(!PmacReadReady(0));
    EQUAL(PmacGetLineA(0, text, sizeof text), 0);

    PmacSendCommandA(0, "P7=77");
    EQUAL(PmacGetVariableDouble(0, 'P', 7, -1), 77);
    int count = PmacGetControlResponseA(0, text, sizeof text, 'P' - '@');
    CHECK(count > 1 && text[count - 1] == '\r');
    text[count - 1] = 0;
    SAME(pmacctl("send '^P'"), text);
    CHECK((DWORD)PmacGetControlResponseExA(0, text, sizeof text, 'P' - '@') == (COMM_EOT | (DWORD)count));
    CHECK(PmacSendCharA(0, 'P' - '@'));
    PmacFlush(0);

    CHECK(PmacSetAsciiComm(0, DPR));
    CHECK(PmacGetAsciiComm(0) == DPR);
}

static volatile int calls, took_signals;
static char called_with[64];

static void WINAPI interrupt(DWORD number, PINTRBUFFER buffer)
{
    if (number == 0xABCD && buffer)
        snprintf(called_with, sizeof called_with, "%s", buffer->lpData);
    sigset_t blocked;
    pthread_sigmask(SIG_BLOCK, NULL, &blocked);
    took_signals += !sigismember(&blocked, SIGALRM) || !sigismember(&blocked, SIGRTMIN);
    took_signals += sigismember(&blocked, SIGSEGV);
    calls++;
}

/* What the board's own programs say. A bit of 0 switches an interrupt on. */
static void texts(void)
{
    char text[64] = "";
    const ULONG replies = ~(turbo ? 1u << 5 : 1u << 7);
    CHECK(!USReadReady(0));
    CHECK(!GetUSResponse(0, text, sizeof text));
    CHECK(!PmacINTRTerminate(0));
    CHECK(!PmacINTRFuncCallInit(0, interrupt, 0xABCD, 0xFFFFFFBF));
    CHECK(PmacINTRFuncCallInit(0, interrupt, 0xABCD, replies));
    ask("OPEN PROG 20");
    ask("CLEAR");
    ask("SEND\"hello\"");
    ask("CLOSE");
    ask("&1 #1->X");
    ask("&1B20R");
    for (int tries = 0; tries < 200 && !(calls && USReadReady(0)); tries++)
        Sleep(50);
    CHECK(calls == 1);
    /* The program's handlers run in its own threads, which take signals as before. */
    EQUAL(took_signals, 0);
    sigset_t blocked;
    pthread_sigmask(SIG_BLOCK, NULL, &blocked);
    CHECK(!sigismember(&blocked, SIGALRM));
    SAME(called_with, "hello\r");
    CHECK(GetUSResponse(0, text, sizeof text));
    SAME(text, "hello\r");
    CHECK(!USReadReady(0));
    CHECK(PmacINTRTerminate(0));
}

static void variables(void)
{
    char text[256];
    PmacSetVariableDouble(0, 'P', 10, 0.125);
    SAME(pmacctl("send P10"), "0.125");
    EQUAL(PmacGetVariableDouble(0, 'P', 10, -1), 0.125);
    EQUAL(PmacGetVariableDouble(0, 'p', 10, -1), 0.125);
    CHECK(PmacGetVariableStrA(0, 'P', text, 10));
    EQUAL(atof(text), 0.125);
    PmacSetVariable(0, 'Q', 11, -321);
    EQUAL(PmacGetVariable(0, 'Q', 11, 0), -321);
    PmacSetVariableLong(0, 'P', 12, 123456789);
    EQUAL(PmacGetVariableLong(0, 'P', 12, 0), 123456789);
    SAME(pmacctl("send P12"), "123456789");

    PmacSetIVariableDouble(0, 122, 40.5);
    EQUAL(PmacGetIVariableDouble(0, 122, -1), 40.5);
    EQUAL(atof(pmacctl("send I122")), 40.5);
    PmacSetIVariableLong(0, 113, 1000000);
    EQUAL(PmacGetIVariableLong(0, 113, -1), 1000000);
    PmacSetIVariableLong(0, 113, 0);

    /* What the board does not know is the default, to the last bit. */
    CHECK(PmacGetVariableDouble(0, 'Z', 1, -0.1) == -0.1);
    CHECK(PmacGetVariableLong(0, 'Z', 1, -7) == -7);
    CHECK(PmacGetVariable(0, 'Z', 1, -7) == -7);
    if (!turbo) {
        CHECK(PmacGetVariableDouble(0, 'P', 9999, -12345) == -12345);
        CHECK(PmacGetIVariableDouble(0, 9999, -7) == -7);
        CHECK(PmacGetIVariableLong(0, 9999, -7) == -7);
    }
    CHECK(!PmacGetVariableStrA(0, 'Z', text, 1));
}

static void board(void)
{
    char text[30];
    CHECK(PmacGetRomVersionA(0, text, sizeof text) == text);
    SAME(pmacctl("send VERSION"), text);
    CHECK(PmacGetRomDateA(0, text, sizeof text) == text);
    SAME(pmacctl("send DATE"), text);
    PmacGetRomDateA(0, text, 3);
    EQUAL((double)strlen(text), 2);
    EQUAL(PmacGetPmacType(0), turbo ? PT_PMAC2T : PT_PMAC1);
    EQUAL(bPMACIsTurbo(0), turbo);
    CHECK(PmacGetDpramAvailable(0));
    CHECK(PmacDPRAvailable(0));
    CHECK(!PmacInBootStrapMode(0));
    CHECK(PmacSetCriticalIVars(0));
}

static void memory(void)
{
    const UINT at = turbo ? (0x60A10 - 0x60000) * 4 : (0xD800 - 0xD000) * 4;
    const char *x = turbo ? "X:" FREE_TURBO : "X:" FREE_PMAC;
    const char *y = turbo ? "Y:" FREE_TURBO : "Y:" FREE_PMAC;
    const char *real = turbo ? "F:" FREE_TURBO : "F:" FREE_PMAC;
    PmacDPRSetWord(0, at, 0x1234);
    PmacDPRSetWord(0, at + 2, 0x5678);
    EQUAL(word(y), 0x1234);
    EQUAL(word(x), 0x5678);
    EQUAL(PmacDPRGetWord(0, at), 0x1234);
    EQUAL(PmacDPRGetDWord(0, at), 0x56781234);
    PmacDPRSetDWord(0, at, 0xFFFFFFFE);
    EQUAL(PmacDPRGetDWord(0, at), 0xFFFFFFFE);
    EQUAL(word(y), 0xFFFE);
    PmacDPRSetFloat(0, at, -2.5);
    EQUAL(PmacDPRGetFloat(0, at), -2.5);
    EQUAL(word(real), -2.5);

    PmacDPRSetDWord(0, at, 0xF0);
    CHECK(PmacDPRDWordBitSet(0, at, 4) && !PmacDPRDWordBitSet(0, at, 3));
    PmacDPRSetDWordBit(0, at, 31);
    PmacDPRResetDWordBit(0, at, 4);
    EQUAL(PmacDPRGetDWord(0, at), 0x800000E0);
    PmacDPRSetDWordMask(0, at, 0x3, TRUE);
    PmacDPRSetDWordMask(0, at, 0xE0, FALSE);
    EQUAL(PmacDPRGetDWord(0, at), 0x80000003);
    EQUAL(PmacDPRGetDWordMask(0, at, 0x80000001), 0x80000001);

    DWORD out[12], in[13];
    for (DWORD i = 0; i < 12; i++)
        out[i] = i * 0x01010101u;
    in[12] = 99;
    CHECK(PmacDPRSetMem(0, at, sizeof out, out) == out);
    CHECK(PmacDPRGetMem(0, at, sizeof out, in) == in);
    CHECK(memcmp(in, out, sizeof out) == 0 && in[12] == 99);
    BYTE odd[3] = {7, 7, 7};
    CHECK(PmacDPRGetMem(0, at + 4, 2, odd) == odd && odd[0] == 1 && odd[1] == 1 && odd[2] == 7);

    /* Host-Busy is the daemon's: a program's own is taken, and changes nothing. */
    if (!turbo) {
        PmacDPRSetWord(0, (0xD009 - 0xD000) * 4, 1);
        PmacDPRSetWord(0, (0xD08A - 0xD000) * 4, 0);
        EQUAL(PmacGetError(0), 0);
    }
    /* The daemon's rules hold: the line to the board is not this program's to write. */
    PmacDPRSetDWord(0, turbo ? (0x603A8 - 0x60000) * 4 : (0xD18B - 0xD000) * 4, 1);
    CHECK(PmacGetError(0) != 0);
}

static volatile int messages, percent;

static void WINAPI message(LPSTR text, BOOL newline)
{
    (void)newline;
    messages += text != NULL;
}

static void WINAPI progress(LONG now)
{
    percent = now;
}

static void downloads(void)
{
    char file[] = "/tmp/pcomm32-XXXXXX";
    int descriptor = mkstemp(file);
    FILE *program = fdopen(descriptor, "w");
    fputs("; a file of lines\nP20=33\nOPEN PROG 19\nCLEAR\nX1 Y2\nCLOSE\nP21=44\n", program);
    fclose(program);
    CHECK(PmacDownloadA(0, NULL, NULL, NULL, file, FALSE, FALSE, FALSE, TRUE) != 0);
    EQUAL(PmacGetVariableDouble(0, 'P', 21, -1), 44);
    ask("P21=0");
    CHECK(PmacDownloadA(0, message, NULL, progress, file, TRUE, FALSE, FALSE, TRUE) != 0);
    EQUAL(PmacGetVariableDouble(0, 'P', 21, -1), 44);
    EQUAL(percent, 100);
    ask("P21=0");
    CHECK(PmacThreadDownloadA(0, message, NULL, progress, file, FALSE, FALSE, FALSE, TRUE) != 0);
    for (int tries = 0; tries < 100 && PmacGetVariableLong(0, 'P', 21, -1) != 44; tries++)
        Sleep(50);
    EQUAL(PmacGetVariableDouble(0, 'P', 21, -1), 44);
    ask("P21=0");
    PmacDownloadFile(0, file);
    EQUAL(PmacGetVariableDouble(0, 'P', 21, -1), 44);
    PmacAbortDownload(0);

    program = fopen(file, "w");
    fputs("P20=1\nXYZZY\nP21=2\n", program);
    fclose(program);
    EQUAL(PmacDownloadA(0, message, NULL, progress, file, FALSE, FALSE, FALSE, TRUE), 0);
    CHECK(messages > 0);

    /* An abort counts from the start on: it lets one call of lines through. */
    program = fopen(file, "w");
    for (int line = 0; line < 400; line++)
        fputs("P22=P22+1\n", program);
    fclose(program);
    ask("P22=0");
    messages = 0;
    CHECK(PmacThreadDownloadA(0, message, NULL, progress, file, FALSE, FALSE, FALSE, TRUE) != 0);
    PmacAbortDownload(0);
    for (int tries = 0; tries < 100 && messages == 0; tries++)
        Sleep(50);
    CHECK(messages > 0 && PmacGetVariableLong(0, 'P', 22, -1) <= 8);
    remove(file);
    EQUAL(PmacDownloadA(0, message, NULL, progress, file, FALSE, FALSE, FALSE, TRUE), 0);
}

/* Each thread reads what it has written, and no other thread's reply. */
static void *talk(void *of)
{
    const int number = *(const int *)of;
    char command[64], response[64], expected[64];
    for (int round = 0; round < 40; round++) {
        snprintf(command, sizeof command, "P%d=%d P%d", number, round * 1000 + number, number);
        snprintf(expected, sizeof expected, "%d\r", round * 1000 + number);
        PmacGetResponseA(0, response, sizeof response, command);
        if (strcmp(response, expected) != 0)
            return "a thread has another's reply";
    }
    return NULL;
}

static void *fetch(void *text)
{
    PmacGetLineA(0, text, 64);
    return NULL;
}

static void threads_and_processes(void)
{
    pthread_t threads[4];
    int numbers[4] = {301, 302, 303, 304};
    for (int i = 0; i < 4; i++)
        pthread_create(&threads[i], NULL, talk, &numbers[i]);
    for (int i = 0; i < 4; i++) {
        void *wrong = NULL;
        pthread_join(threads[i], &wrong);
        CHECK(wrong == NULL);
    }
    /* While this thread holds the device, another takes none of its replies. */
    char text[64], theirs[64] = "#";
    LockPmac(0);
    CHECK(PmacSendLineA(0, "P301") > 0);
    pthread_create(&threads[0], NULL, fetch, theirs);
    Sleep(300);
    CHECK(PmacGetLineA(0, text, sizeof text) > 1);
    ReleasePmac(0);
    pthread_join(threads[0], NULL);
    SAME(theirs, "");
    /* A child has connections of its own; the parent's go on. */
    int status = -1;
    pid_t child = fork();
    if (child == 0)
        _exit(talk(&numbers[0]) != NULL);
    CHECK(talk(&numbers[1]) == NULL);
    CHECK(waitpid(child, &status, 0) == child && status == 0);
}

int main(int count, char **arguments)
{
    turbo = count > 1 && strcmp(arguments[1], "turbo") == 0;
    devices();
    responses();
    lines();
    texts();
    variables();
    board();
    memory();
    downloads();
    threads_and_processes();
    CHECK(ClosePmacDevice(0));
    return finish("works");
}
