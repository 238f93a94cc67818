/* The tests' checks, and the board's values as pmacctl tells them. */
#ifndef CHECK_H
#define CHECK_H

#include <math.h>
#include <pmacu.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int failures;

#define CHECK(condition)                                                             \
    do {                                                                             \
        if (!(condition)) {                                                          \
            fprintf(stderr, "%s:%d: %s does not hold\n", __FILE__, __LINE__, #condition); \
            failures++;                                                              \
        }                                                                            \
    } while (0)
#define EQUAL(got, expected) equal(__FILE__, __LINE__, #got, got, expected)
#define SAME(got, expected) same(__FILE__, __LINE__, #got, got, expected)

static inline void equal(const char *file, int line, const char *what, double got, double expected)
{
    if (!(fabs(got - expected) <= 1e-6 * fabs(expected))) {
        fprintf(stderr, "%s:%d: %s is %.17g, not %.17g\n", file, line, what, got, expected);
        failures++;
    }
}

static inline void same(const char *file, int line, const char *what, const char *got, const char *expected)
{
    if (!got || strcmp(got, expected) != 0) {
        fprintf(stderr, "%s:%d: %s is \"%s\", not \"%s\"\n", file, line, what, got ? got : "(NULL)", expected);
        failures++;
    }
}

/* What pmacctl prints, without the last end of line, once it has live data. The text stays until the next call. */
static inline char *pmacctl(const char *format, ...)
{
    static char text[1 << 18];
    char command[512];
    int length = snprintf(command, sizeof command, "%s --socket %s ", getenv("PMACCTL"), getenv("PMAC_SOCKET"));
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(command + length, sizeof command - (size_t)length, format, arguments);
    va_end(arguments);
    for (int tries = 0; tries < 50; tries++) {
        FILE *pipe = popen(command, "r");
        size_t count = pipe ? fread(text, 1, sizeof text - 1, pipe) : 0;
        text[count] = 0;
        while (count && text[count - 1] == '\n')
            text[--count] = 0;
        if (pipe && pclose(pipe) == 0)
            return text;
        Sleep(100);
    }
    fprintf(stderr, "%s fails\n", command);
    failures++;
    return text;
}

/* The number behind the nth `key` of pmacctl's JSON, there behind `part` if the key has parts. NaN: there is none. */
static inline double told(const char *command, int nth, const char *key, const char *part)
{
    char quoted[64];
    const char *at = pmacctl("%s --json", command);
    snprintf(quoted, sizeof quoted, "\"%s\":", key);
    while (at && nth--)
        at = (at = strstr(at, quoted)) ? at + strlen(quoted) : NULL;
    if (at && part) {
        snprintf(quoted, sizeof quoted, "\"%s\":", part);
        at = (at = strstr(at, quoted)) ? at + strlen(quoted) : NULL;
    }
    return at ? atof(at) : NAN;
}

/* The value of a DPRAM address, as the manual writes it. */
static inline double word(const char *address)
{
    const char *last = strrchr(pmacctl("read '%s'", address), ' ');
    return last ? atof(last) : NAN;
}

/* Sends a line to which the board has no reply. */
static inline void send(const char *line)
{
    char response[256];
    if (PmacGetResponseA(0, response, sizeof response, line) != 0 || PmacGetError(0) != 0) {
        PmacGetErrorStrA(0, response, sizeof response);
        fprintf(stderr, "%s: %s\n", line, response);
        failures++;
    }
}

/* Whether live positions come, within ten seconds. */
static inline BOOL is_live(void)
{
    for (int tries = 0; tries < 200; tries++) {
        if (PmacDPRUpdateRealTime(0))
            return TRUE;
        Sleep(50);
    }
    return FALSE;
}

static inline int finish(const char *name)
{
    if (failures)
        fprintf(stderr, "%s: %d failures\n", name, failures);
    else
        printf("%s: ok\n", name);
    return failures != 0;
}

#endif
