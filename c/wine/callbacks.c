/* The functions that get a function of the program. Windows calls by another convention, so the library gets one of this
 * file, which calls the program's. */
#include "windows_border.h"
#include <pthread.h>

/* The functions that the program gave with a call. */
struct callbacks {
    void(WINDOWS *message)(LPSTR, BOOL);
    LONG(WINDOWS *get)(LONG, LPSTR, LONG);
    void(WINDOWS *progress)(LONG);
};

/* Those of the calling thread's download. (A `__thread` variable does not work in a
 * library that Wine loads.) */
static pthread_key_t calling;

static __attribute__((constructor)) void begin(void)
{
    pthread_key_create(&calling, NULL);
}

static const struct callbacks *program(void)
{
    return pthread_getspecific(calling);
}

static void message(LPSTR text, BOOL newline)
{
    program()->message(text, newline);
}

static LONG get(LONG index, LPSTR text, LONG max)
{
    return program()->get(index, text, max);
}

static void progress(LONG percent)
{
    program()->progress(percent);
}

int WINDOWS windows_PmacDownloadA(DWORD device, void *of_message, void *of_get, void *of_progress, LPCSTR file,
    BOOL macro, BOOL map, BOOL log, BOOL download)
{
    const struct callbacks *outer = program();
    const struct callbacks mine = {of_message, of_get, of_progress};
    pthread_setspecific(calling, &mine);
    int done = PmacDownloadA(device, of_message ? message : NULL, of_get ? get : NULL, of_progress ? progress : NULL, file,
        macro, map, log, download);
    pthread_setspecific(calling, outer);
    return done;
}

/* A thread that Wine did not start cannot call a program of Windows: a download in the background tells none, and no
 * interrupt reaches one. The other two the library does not have, and says so. */

int WINDOWS windows_PmacThreadDownloadA(DWORD device, void *of_message, void *of_get, void *of_progress, LPCSTR file,
    BOOL macro, BOOL map, BOOL log, BOOL download)
{
    (void)of_message, (void)of_get, (void)of_progress;
    return PmacThreadDownloadA(device, NULL, NULL, NULL, file, macro, map, log, download);
}

int WINDOWS windows_PmacMultiDownloadA(DWORD device, void *of_message, LPCSTR out_file, LPCSTR ini_file, LPCSTR user,
    BOOL macro, BOOL map, BOOL log, BOOL download)
{
    (void)of_message;
    return PmacMultiDownloadA(device, NULL, out_file, ini_file, user, macro, map, log, download);
}

LONG WINDOWS windows_PmacDPRTest(DWORD device, void *of_message, void *of_progress)
{
    (void)of_message, (void)of_progress;
    return PmacDPRTest(device, NULL, NULL);
}

BOOL WINDOWS windows_PmacINTRFuncCallInit(DWORD device, void *callback, DWORD message, ULONG mask)
{
    (void)device, (void)callback, (void)message, (void)mask;
    return FALSE;
}

BOOL WINDOWS windows_PmacINTRWndMsgInit(DWORD device, HWND window, UINT message, ULONG mask)
{
    (void)device, (void)window, (void)message, (void)mask;
    return FALSE;
}
