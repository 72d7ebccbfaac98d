/* Range coder, plain bits and lists of numbers: docs/format.md, sections 5 and 6.
 *
 * Every function codes in both directions: a writer takes the values, a reader gives them. Nothing
 * is allocated: callers hand over the words and bits of a stream and room to work in, and are told
 * by a status if there is too little. */
#ifndef MM_CODER_H
#define MM_CODER_H

#include "export.h"

enum {
    FINE,
    DAMAGED,   /* words that no writer writes */
    FEW_BITS,  /* fewer plain bits than numbers need */
    NO_VERTEX, /* a triangle of a vertex that does not exist */
    NO_NODE,   /* a number for a vertex that does not exist */
    ENDLESS,   /* a number that does not end */
    TOO_MANY,  /* more than is coded at once */
    FULL = 16, /* of a writer: the words or the bits are too few */
    ROOM,      /* the room is too small: `needed` bytes */
    KEYS,      /* the hash table is full: again with twice as many places */
};

/* What a caller keeps between calls: 12 numbers of 64 bits. */
typedef struct {
    uint64_t lower, range, point;
    int64_t word, n_words;      /* the next one, and how many there are or have room */
    int64_t bit, n_bits;
    int64_t n_waiting, waiting; /* of a writer: words that wait for a carry, and the first */
    int64_t status, reads, needed;
} State;

typedef struct {
    State at;
    uint32_t *words;
    uint8_t *bits; /* eight a byte, the high one first */
} Coder;

static inline int64_t least(int64_t a, int64_t b) { return a < b ? a : b; }
static inline int64_t most(int64_t a, int64_t b) { return a > b ? a : b; }

/* floor(log2 x) of x > 0 */
static inline int log_2(uint64_t x) { return 63 - __builtin_clzll(x); }

/* Note the first thing that went wrong. */
static void fail(Coder *c, int status) {
    if (!c->at.status) c->at.status = status;
}

static void put_word(Coder *c, uint32_t word) {
    if (c->at.word < c->at.n_words)
        c->words[c->at.word++] = word;
    else
        fail(c, FULL);
}

static uint32_t next_word(Coder *c) {
    return c->at.word < c->at.n_words ? c->words[c->at.word++] : 0;
}

/* Write the words that waited for a carry. */
static void resolve_carry(Coder *c, int carried) {
    put_word(c, (uint32_t)(c->at.waiting + carried));
    for (int64_t i = 1; i < c->at.n_waiting; i++) put_word(c, carried ? 0 : UINT32_MAX);
    c->at.n_waiting = 0;
}

/* Take the part from left to right of 2^24 as the new interval. */
static inline void narrow(Coder *c, uint32_t left, uint32_t right) {
    State *s = &c->at;
    const uint64_t scale = s->range >> 24;
    uint64_t lower = s->lower + scale * left, range = scale * (right - left);
    if (s->reads) {
        if (range < UINT64_C(1) << 32) {
            lower <<= 32;
            range <<= 32;
            s->point = s->point << 32 | next_word(c);
        }
    } else {
        if (s->n_waiting && lower + range > lower) resolve_carry(c, lower < s->lower);
        if (range < UINT64_C(1) << 32) {
            const uint32_t word = (uint32_t)(lower >> 32);
            lower <<= 32;
            range <<= 32;
            if (s->n_waiting) {
                s->n_waiting++;
            } else if (lower + range > lower) {
                put_word(c, word);
            } else {
                s->n_waiting = 1;
                s->waiting = word;
            }
        }
    }
    s->lower = lower;
    s->range = range;
}

/* Whether the point lies at or beyond a boundary, in 2^-24 of the interval. */
static inline int reaches(const Coder *c, uint32_t left) {
    return c->at.point - c->at.lower >= (c->at.range >> 24) * left;
}

/* Code yes (1) or no (0), yes with a chance in 1/65536. */
static inline int code_odds(Coder *c, int chance, int value) {
    const uint32_t split = (uint32_t)((65536 - chance) * ((16777216.0 - 2.0) / 65536.0)) + 1;
    if (c->at.reads) {
        if (reaches(c, 1 << 24)) {
            fail(c, DAMAGED);
            return 0;
        }
        value = reaches(c, split);
    }
    if (value)
        narrow(c, split, 1 << 24);
    else
        narrow(c, 0, split);
    return value;
}

/* Code one of n symbols; the symbol i begins at cuts[i]. */
static int code_symbol(Coder *c, const uint32_t *cuts, int n, int value) {
    if (c->at.reads) {
        if (reaches(c, 1 << 24)) {
            fail(c, DAMAGED);
            return 0;
        }
        value = 0;
        while (value < n - 1 && reaches(c, cuts[value + 1])) value++;
    }
    narrow(c, cuts[value], cuts[value + 1]);
    return value;
}

/* Code a plain number of so many bits. */
static int64_t code_bits(Coder *c, int width, int64_t value) {
    State *s = &c->at;
    if (width > s->n_bits - s->bit) {
        fail(c, s->reads ? FEW_BITS : FULL);
        return 0;
    }
    if (s->reads) value = 0;
    for (int i = width - 1; i >= 0; i--, s->bit++) {
        uint8_t *byte = c->bits + (s->bit >> 3);
        const int shift = 7 - (int)(s->bit & 7);
        if (s->reads)
            value = value << 1 | (*byte >> shift & 1);
        else
            *byte = (uint8_t)((*byte & ~(1 << shift)) | (int)(value >> i & 1) << shift);
    }
    return value;
}

/* Where the interval of each symbol begins, from its weight. */
static void cut(const double *weights, int n, uint32_t *cuts) {
    double total = 0.0, left = 0.0;
    for (int i = 0; i < n; i++) total += weights[i];
    const double scale = (16777216.0 - n) / total;
    cuts[0] = 0;
    for (int i = 1; i < n; i++) {
        left += weights[i - 1];
        cuts[i] = (uint32_t)(left * scale) + (uint32_t)i;
    }
    cuts[n] = 1 << 24;
}

enum { ESCAPE = 15, N_SYMBOLS = 16, N_CLASSES = 40, INCREMENT = 24 };

/* Adaptive weights of the magnitudes of one context: below 15 a symbol each, then classes of what
 * exceeds 14, which holds 2^n to 2^(n+1) - 1 in the class n. */
typedef struct {
    double symbols[N_SYMBOLS], classes[N_CLASSES];
    uint32_t symbol_cuts[N_SYMBOLS + 1], class_cuts[N_CLASSES + 1];
    int has_symbol_cuts, has_class_cuts;
} Table;

static int code_small(Coder *c, Table *t, int64_t magnitude) {
    if (!t->has_symbol_cuts) cut(t->symbols, N_SYMBOLS, t->symbol_cuts);
    t->has_symbol_cuts = 1;
    return code_symbol(c, t->symbol_cuts, N_SYMBOLS, (int)least(magnitude, ESCAPE));
}

static int code_class(Coder *c, Table *t, int64_t magnitude) {
    if (!t->has_class_cuts) cut(t->classes, N_CLASSES, t->class_cuts);
    t->has_class_cuts = 1;
    const int size = c->at.reads ? 0 : log_2((uint64_t)(magnitude - ESCAPE + 1));
    return code_symbol(c, t->class_cuts, N_CLASSES, size);
}

/* Code the rest of a magnitude of the class n. */
static int64_t code_rest(Coder *c, int n, int64_t magnitude) {
    const int64_t first = (INT64_C(1) << n) + ESCAPE - 1;
    return first + code_bits(c, n, magnitude - first);
}

/* Code whole numbers >= 0 that resemble each other, in batches of 8, 8, 16, 32, ... */
static void code_list(Coder *c, int64_t n, int64_t *values) {
    Table t;
    for (int i = 0; i < N_SYMBOLS; i++) t.symbols[i] = (double)most(1, 24 >> i / 2);
    for (int i = 0; i < N_CLASSES; i++) t.classes[i] = (double)most(1, 8 >> i / 2);
    for (int64_t start = 0, stop; start < n && !c->at.status; start = stop) {
        int symbols[N_SYMBOLS] = {0}, classes[N_CLASSES] = {0};
        stop = least(n, start + most(8, start));
        t.has_symbol_cuts = t.has_class_cuts = 0;
        for (int64_t i = start; i < stop; i++) {
            const int symbol = code_small(c, &t, values[i]);
            symbols[symbol]++;
            if (c->at.reads) values[i] = symbol;
        }
        for (int i = 0; i < N_SYMBOLS; i++) t.symbols[i] += INCREMENT * symbols[i];
        if (!symbols[ESCAPE]) continue;
        for (int64_t i = start; i < stop; i++) {
            if (values[i] < ESCAPE) continue;
            const int size = code_class(c, &t, values[i]);
            classes[size]++;
            if (c->at.reads) values[i] = ESCAPE + size;
        }
        for (int i = 0; i < N_CLASSES; i++) t.classes[i] += INCREMENT * classes[i];
        for (int64_t i = start; i < stop; i++) {
            if (values[i] < ESCAPE) continue;
            if (c->at.reads)
                values[i] = code_rest(c, (int)(values[i] - ESCAPE), 0);
            else
                code_rest(c, log_2((uint64_t)(values[i] - ESCAPE + 1)), values[i]);
        }
    }
}

/* Room that a caller gave: zeros beyond what is `touched`, where pages that nothing touches cost
 * nothing. What has no place in it is counted, so that the caller knows. */
typedef struct {
    uint8_t *start;
    int64_t size, used, touched;
} Room;

/* Take n zeros of so many bytes; null if there is no place for them. */
static void *take(Room *room, int64_t n, int64_t width) {
    const int64_t from = room->used;
    room->used += (n * width + 15) & ~INT64_C(15);
    if (room->used > room->size) return 0;
    const int64_t stale = least(room->used, room->touched) - from;
    if (stale > 0) memset(room->start + from, 0, (size_t)stale);
    room->touched = most(room->touched, room->used);
    return room->start + from;
}

#define TAKE(room, type, n) ((type *)take(room, n, (int64_t)sizeof(type)))

/* Whether all that was taken has a place; if not, the caller is told how much there should be. */
static int has_room(Coder *c, const Room *room) {
    c->at.needed = room->used;
    if (room->used > room->size) fail(c, ROOM);
    return room->used <= room->size;
}

#endif
