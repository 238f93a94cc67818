/* A console program of Windows that knows PComm32 alone: it opens a board, moves motor 1, and reads it in each way that
 * passes values differently. Every line that it prints is checked by `test`. */
#include <pmacu.h>
#include <stdio.h>
#include <string.h>

#define OF(name) __typeof__(name) *p##name = (__typeof__(name) *)(void (*)(void))GetProcAddress(library, #name)

static int messages, percents;

static void WINAPI message(LPSTR text, BOOL newline)
{
    (void)text, (void)newline;
    messages++;
}

static void WINAPI progress(LONG percent)
{
    (void)percent;
    percents++;
}

int main(int count, char **arguments)
{
    HMODULE library = LoadLibraryA("PComm32W.dll");
    if (!library) {
        printf("no library: %lu\n", (unsigned long)GetLastError());
        return 1;
    }
    OF(OpenPmacDevice);
    OF(ClosePmacDevice);
    OF(PmacGetResponseA);
    OF(PmacGetResponseExA);
    OF(PmacSetVariableDouble);
    OF(PmacGetVariableDouble);
    OF(PmacDPRRealTimeEx);
    OF(PmacDPRPosition);
    OF(PmacDPRGlobalStatus);
    OF(PmacDPRSetFloat);
    OF(PmacDPRGetFloat);
    OF(PmacDownloadA);
    if (!pOpenPmacDevice || !pOpenPmacDevice(0)) {
        printf("no device\n");
        return 1;
    }
    char text[256];
    int length = pPmacGetResponseA(0, text, sizeof text, "I100");
    printf("I100 is %s of %d characters\n", strtok(text, "\r"), length);
    printf("unknown: %08lX\n", (unsigned long)pPmacGetResponseExA(0, text, sizeof text, "NONSENSE") & 0xF0000000ul);
    pPmacSetVariableDouble(0, 'P', 100, -12.5);
    printf("P100 is %g\n", pPmacGetVariableDouble(0, 'P', 100, 1));
    pPmacGetResponseA(0, text, sizeof text, "#1J=2000");
    pPmacDPRRealTimeEx(0, 1, 10, 1);
    int tries = 0;
    do {
        Sleep(50);
        pPmacGetResponseA(0, text, sizeof text, "#1P");
    } while (strcmp(strtok(text, "\r"), "2000") != 0 && tries++ < 200);
    Sleep(100);
    printf("motor 1 is at %s, in DPRAM at %.0f\n", text, pPmacDPRPosition(0, 0, 1));
    struct gs global = pPmacDPRGlobalStatus(0);
    printf("global status: %u bytes\n", (unsigned)sizeof global);
    pPmacDPRSetFloat(0, 0x2000, 2.5);
    printf("a float in DPRAM: %g\n", pPmacDPRGetFloat(0, 0x2000));
    int done = count > 1 ? pPmacDownloadA(0, message, NULL, progress, arguments[1], 0, 0, 0, 1) : 0;
    pPmacGetResponseA(0, text, sizeof text, "P101");
    printf("download: %s, P101 is %s, messages: %d, percents: %s\n", done ? "done" : "failed", strtok(text, "\r"), messages,
        percents ? "some" : "none");
    printf("closed: %s\n", pClosePmacDevice(0) ? "yes" : "no");
    return 0;
}
