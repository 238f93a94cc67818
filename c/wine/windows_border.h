/* The border between a program of Windows, under Wine, and the libraries of this host. */
#include <pmacu.h>

#ifdef __i386__
/* A program of Windows aligns its stack to 4 bytes, a library here expects 16. */
#define WINDOWS __attribute__((stdcall, force_align_arg_pointer))
#else
#define WINDOWS __attribute__((ms_abi))
#endif

/* A structure of 4 or 8 bytes is returned as an integer of its size; Linux on 32 bits does not. */
#define RETURNED(type) \
    __typeof__(__builtin_choose_expr( \
        sizeof(type) == 4, (uint32_t)0, __builtin_choose_expr(sizeof(type) == 8, (uint64_t)0, (type){0})))
#define RETURN(type, call) \
    union { \
        type given; \
        RETURNED(type) returned; \
    } result = {.given = call}; \
    return result.returned
