/* What a library without libc must bring itself. */
#include "export.h"

#ifndef __clang__
/* Or the loops below would be made calls of themselves. */
#pragma GCC optimize("no-tree-loop-distribute-patterns")
#endif

/* Digest of the sources that the library was made from; the build states it. */
#ifndef MM_SOURCES
#define MM_SOURCES ""
#endif
MM_EXPORT(mm_sources) const char *mm_sources(void) { return MM_SOURCES; }

void *memcpy(void *restrict to, const void *restrict from, size_t n) {
    unsigned char *t = to;
    const unsigned char *f = from;
    for (size_t i = 0; i < n; i++) t[i] = f[i];
    return to;
}

void *memmove(void *to, const void *from, size_t n) {
    unsigned char *t = to;
    const unsigned char *f = from;
    if (t <= f) {
        for (size_t i = 0; i < n; i++) t[i] = f[i];
    } else {
        while (n--) t[n] = f[n];
    }
    return to;
}

void *memset(void *to, int byte, size_t n) {
    unsigned char *t = to;
    for (size_t i = 0; i < n; i++) t[i] = (unsigned char)byte;
    return to;
}

#ifdef _WIN32
int __stdcall DllMainCRTStartup(void *library, unsigned long reason, void *reserved) {
    (void)library;
    (void)reason;
    (void)reserved;
    return 1;
}
#endif
