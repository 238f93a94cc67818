// Every function with arguments that make no sense: nothing crashes.
#include <runtime.h>

#include <cstdio>
#include <cstring>
#include <initializer_list>
#include <type_traits>

// What the arguments of a round are.
struct Round {
    DWORD device;
    bool memory; // or NULL
    bool ones;   // or zeros
};

static char memory[1 << 16];

template <class A> static A argument(const Round &round, bool is_device)
{
    if constexpr (std::is_function_v<std::remove_pointer_t<A>>) {
        return nullptr;
    } else if constexpr (std::is_pointer_v<A>) {
        return round.memory ? reinterpret_cast<A>(memory + sizeof memory / 2) : nullptr;
    } else if constexpr (std::is_enum_v<A> || std::is_floating_point_v<A>) {
        return static_cast<A>(round.ones ? -1 : 0);
    } else {
        return is_device ? static_cast<A>(round.device) : static_cast<A>(round.ones ? ~A{} : A{});
    }
}

template <class R, class First, class... A> static void call(R (*function)(First, A...), const Round &round)
{
    std::memset(memory, 0, sizeof memory);
    (void)function(argument<First>(round, std::is_same_v<First, DWORD>), argument<A>(round, false)...);
}

template <class R> static void call(R (*function)(), const Round &)
{
    (void)function();
}

static void each(const Round &round, bool closes)
{
#define CALL(type, variable, function)                                              \
    if (closes || (std::strcmp(#function, "ClosePmacDevice") && std::strcmp(#function, "ShutdownPmacDevice"))) \
        call(function, round);
    PCOMM32_LINKS(CALL)
    // The others of pmacu.h, which the vendor's loader does not need.
#define ALONE(function) call(function, round);
    ALONE(PmacSendCommandA)
    ALONE(PmacGetVariable)
    ALONE(PmacDPRAmpFault)
    ALONE(PmacDPRAmpEnabled)
    ALONE(PmacDPRAvailable)
    ALONE(PmacDPRFatalFError)
    ALONE(PmacDPRGetGlobalStatus)
    ALONE(PmacDPRGetGlobalStatusTurbo)
    ALONE(PmacDPRHomeComplete)
    ALONE(PmacDPRInposition)
    ALONE(PmacDPROnPositionLimit)
    ALONE(PmacDPRVectorVelocity)
    ALONE(PmacDPRWarnFError)
    ALONE(PmacDownloadFile)
}

int main()
{
    for (DWORD device : {0u, 3u, 7u, 8u, 99u, 0x80000000u, 0xFFFFFFFFu})
        for (bool has_memory : {false, true})
            for (bool ones : {false, true})
                each({device, has_memory, ones}, true);
    std::puts("nonsense: closed devices: ok");
    for (bool has_memory : {false, true})
        for (bool ones : {false, true}) {
            if (!OpenPmacDevice(0))
                return 1;
            each({0, has_memory, ones}, false);
            ClosePmacDevice(0);
        }
    std::puts("nonsense: ok");
    return 0;
}
