/* What every source of the library begins with: it has no libc, and shows only what it exports. */
#ifndef MM_EXPORT_H
#define MM_EXPORT_H

#include <stddef.h>
#include <stdint.h>

#if defined(__wasm__)
#define MM_EXPORT(name) __attribute__((export_name(#name), visibility("default")))
#elif defined(_WIN32)
#define MM_EXPORT(name) __declspec(dllexport)
#else
#define MM_EXPORT(name) __attribute__((visibility("default")))
#endif

/* Compilers call these by themselves too. For a few bytes: __builtin_memcpy, which is no call. */
void *memcpy(void *restrict to, const void *restrict from, size_t n);
void *memmove(void *to, const void *from, size_t n);
void *memset(void *to, int byte, size_t n);

#endif
