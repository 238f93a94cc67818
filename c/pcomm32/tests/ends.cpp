/* What the last functions of a program do: at exit() the values of its threads are gone, and its destructors run. */
#include "check.h"
#include <unistd.h>

/* Runs after main, as the functions of atexit do. Its calls work, and tell what they have done. */
static void ends(const char *when)
{
    char text[64];
    EQUAL(PmacGetResponseA(0, text, sizeof text, "P40=40"), 0);
    EQUAL(PmacGetError(0), 0);
    EQUAL(PmacGetResponseA(0, text, sizeof text, "#1K P40"), 3);
    SAME(text, "40\r");
    EQUAL(PmacGetResponseA(0, text, sizeof text, "XYZZY"), 0);
    EQUAL(PmacGetError(0), 3);
    LockPmac(0);
    CHECK(PmacGetVariableLong(0, 'P', 40, -1) == 40);
    ReleasePmac(0);
    if (finish(when))
        _exit(1);
}

struct Machine {
    ~Machine() { ends("a static destructor"); }
} machine;

static void at_exit() { ends("atexit"); }

int main()
{
    atexit(at_exit);
    CHECK(OpenPmacDevice(0));
    EQUAL(PmacGetError(0), 0);
    return finish("main");
}
