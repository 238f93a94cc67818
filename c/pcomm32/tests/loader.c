/* A program that finds every function by its name, as the vendor's loader does, and calls through the variables. */
#include <runtime.h>
#include <string.h>

int main(void)
{
    char response[256] = "";
    if (!OpenRuntimeLink())
        return 1;
    if (!DeviceOpen(0) || DeviceGetResponse(0, response, sizeof response, "P900=6.25 P900") != 5 ||
        strcmp(response, "6.25\r") != 0 || !DeviceClose(0)) {
        fprintf(stderr, "the board answers \"%s\"\n", response);
        return 1;
    }
    CloseRuntimeLink();
    puts("loader: ok");
    return 0;
}
