/* What every source of the library begins with: it has no libc, and shows only what it exports. */
#ifndef MODALMOTION_EXPORT_H
#define MODALMOTION_EXPORT_H

#include <stddef.h>
#include <stdint.h>

#ifdef _WIN32
#define MM_EXPORT __declspec(dllexport)
#else
#define MM_EXPORT __attribute__((visibility("default")))
#endif

/* Compilers call these on their own too. For a few bytes: __builtin_memcpy, which needs no call. */
void *memcpy(void *restrict to, const void *restrict from, size_t n);
void *memmove(void *to, const void *from, size_t n);
void *memset(void *to, int byte, size_t n);

#endif
