/* Orders of numbers, equals as they came. */
#ifndef MM_SORTING_H
#define MM_SORTING_H

#include "coder.h"

/* Order n keys: order[i] is the place of the i-th. The keys are overwritten. */
static void sort_places(uint64_t *keys, int64_t *order, int64_t n, Room *room) {
    const int64_t used = room->used;
    uint64_t *other_keys = TAKE(room, uint64_t, n);
    int64_t *other = TAKE(room, int64_t, n);
    const int has_place = room->used <= room->size;
    room->used = has_place ? used : room->used;
    if (!has_place) return;
    uint64_t differs = 0;
    for (int64_t i = 0; i < n; i++) {
        order[i] = i;
        differs |= keys[i] ^ keys[0];
    }
    for (int shift = 0; shift < 64; shift += 8) {
        int64_t counts[257] = {0};
        if (!(differs >> shift & 255)) continue;
        for (int64_t i = 0; i < n; i++) counts[(keys[i] >> shift & 255) + 1]++;
        for (int i = 0; i < 256; i++) counts[i + 1] += counts[i];
        for (int64_t i = 0; i < n; i++) {
            const int64_t at = counts[keys[i] >> shift & 255]++;
            other_keys[at] = keys[i];
            other[at] = order[i];
        }
        memcpy(keys, other_keys, (size_t)n * sizeof *keys);
        memcpy(order, other, (size_t)n * sizeof *order);
    }
}

#endif
