/* Fills the variables of runtime.h from libPComm32W.so. Compile it into a program that calls OpenRuntimeLink. */
#define NO_EXTERN
#include "runtime.h"

HINSTANCE hPmacLib;

HINSTANCE OpenRuntimeLink(void)
{
    hPmacLib = LoadLibrary(DRIVERNAME);
    if (!hPmacLib) {
        fprintf(stderr, "PComm32's library cannot be loaded: %s\n", dlerror());
        return NULL;
    }
#define FILL(type, variable, function)                                         \
    variable = (type)GetProcAddress(hPmacLib, #function);                      \
    if (!variable) {                                                           \
        fprintf(stderr, "PComm32's library lacks the function " #function "\n"); \
        CloseRuntimeLink();                                                    \
        return NULL;                                                           \
    }
    PCOMM32_LINKS(FILL)
    FILL(PMACCONFIGURE, DevicePmacConfigure, PmacConfigure)
    FILL(WHYMOTORNOTMOVINGTURBO, DeviceWhyMotorNotMovingTURBO, whyMotorNotMoving)
#undef FILL
    return hPmacLib;
}

void CloseRuntimeLink(void)
{
    FreeLibrary(hPmacLib);
    hPmacLib = NULL;
}
