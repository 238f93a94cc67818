/* The part of Windows that a console program over PComm32 uses, with types of the size that they have there: LONG and
 * DWORD have 32 bits, WCHAR has 16. Where a program says `long` and means LONG, write LONG: here `long` has 64 bits on most processors. */
#ifndef PCOMM32_WINDOWS_H
#define PCOMM32_WINDOWS_H

#include <dlfcn.h>
#include <poll.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <uchar.h>

/* On processors of 64 bits Windows has one calling convention, too. */
#define WINAPI
#define CALLBACK
#define APIENTRY
#define FAR
#define CONST const
#ifndef __stdcall
#define __stdcall
#define __cdecl
#define __declspec(attribute)
#endif

#ifndef TRUE
#define TRUE 1
#define FALSE 0
#endif
#define MAX_PATH 260
#define _MAX_PATH MAX_PATH
#define INFINITE 0xFFFFFFFFu

typedef int BOOL, INT, *PINT;
typedef unsigned int UINT, *PUINT;
typedef uint8_t BYTE, *PBYTE;
typedef int16_t SHORT;
typedef uint16_t USHORT, WORD, *PWORD, *LPWORD;
typedef int32_t LONG, *PLONG, *LPLONG;
typedef uint32_t ULONG, *PULONG, DWORD, *PDWORD, *LPDWORD;
typedef float FLOAT;
typedef double DOUBLE;
typedef char CHAR, *PCHAR, *PCH, *PSTR, *LPSTR;
typedef const char *PCSTR, *LPCSTR;
typedef char16_t WCHAR, *PWCHAR, *PWSTR, *LPWSTR;
typedef const char16_t *PCWSTR, *LPCWSTR;
typedef void VOID, *PVOID, *LPVOID, *HANDLE, *HWND, *HINSTANCE, *HMODULE;
/* Of this type alone gcc lets a program make any other function's without a word. */
typedef void (*FARPROC)(void);

#ifdef UNICODE
typedef WCHAR TCHAR, *LPTSTR;
typedef LPCWSTR LPCTSTR;
#define TEXT(text) PCOMM32_WIDE(text)
#define PCOMM32_WIDE(text) u##text
#else
typedef CHAR TCHAR, *LPTSTR;
typedef LPCSTR LPCTSTR;
#define TEXT(text) text
#endif
#define _T(text) TEXT(text)

static inline VOID Sleep(DWORD milliseconds)
{
    poll(NULL, 0, milliseconds > INT32_MAX ? INT32_MAX : (int)milliseconds);
}

/* A console program has no windows: a message goes to standard error, and the answer is always OK. */
#define MB_OK 0x00u
#define MB_ICONSTOP 0x10u
#define MB_ICONERROR 0x10u
#define MB_ICONWARNING 0x30u
#define MB_ICONINFORMATION 0x40u
#define MB_TOPMOST 0x40000u
#define IDOK 1
static inline int MessageBoxA(HWND parent, LPCSTR text, LPCSTR title, UINT type)
{
    (void)parent;
    (void)type;
    fprintf(stderr, "%s: %s\n", title ? title : "Error", text ? text : "");
    return IDOK;
}
#define MessageBox MessageBoxA

static inline HMODULE LoadLibraryA(LPCSTR name)
{
    return dlopen(name, RTLD_NOW);
}
#define LoadLibrary LoadLibraryA

static inline FARPROC GetProcAddress(HMODULE module, LPCSTR name)
{
    /* C has no conversion from an object's pointer to a function's. */
    union {
        void *object;
        FARPROC function;
    } address;
    address.object = dlsym(module, name);
    return address.function;
}

static inline BOOL FreeLibrary(HMODULE module)
{
    return module && dlclose(module) == 0;
}

#endif
