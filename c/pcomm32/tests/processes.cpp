/* A program's processes: forks during the first call, and the last functions: at exit() the values of the threads are
 * gone, and destructors run. */
#include "check.h"
#include <pthread.h>
#include <sys/wait.h>
#include <unistd.h>

/* Runs after main, as the functions of atexit do. Its calls work, and tell what they have done. */
static void ends(const char *when)
{
    char text[64];
    EQUAL(PmacGetResponseA(0, text, sizeof text, "P40=40"), 0);
    EQUAL(PmacGetError(0), 0);
    EQUAL(PmacGetResponseA(0, text, sizeof text, "#1J/ P40"), 3);
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

static void *first_call(void *unused)
{
    OpenPmacDevice(0);
    return unused;
}

/* Each round has a process in which a thread makes the first call, and a child that forks off meanwhile. */
static void forks_at_the_first_call()
{
    for (int round = 0; round < 40; round++) {
        int status = -1;
        pid_t process = fork();
        if (process == 0) {
            pthread_t thread;
            pthread_create(&thread, nullptr, first_call, nullptr);
            usleep(round * 10);
            pid_t child = fork();
            if (child == 0) {
                alarm(15);
                _exit(!OpenPmacDevice(0));
            }
            waitpid(child, &status, 0);
            _exit(status != 0);
        }
        CHECK(waitpid(process, &status, 0) == process && status == 0);
    }
}

int main()
{
    forks_at_the_first_call();
    atexit(at_exit);
    CHECK(OpenPmacDevice(0));
    EQUAL(PmacGetError(0), 0);
    return finish("main");
}
