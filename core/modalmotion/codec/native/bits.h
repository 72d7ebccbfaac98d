/* Bits that are predicted by mixing what several contexts expect: docs/format.md, section 8. */
#ifndef MM_BITS_H
#define MM_BITS_H

#include "coder.h"

enum {
    N_BIT_MODELS = 24,
    MOST_CONTEXTS = 8,
    FIRST_WEIGHT = 22938,
    LARGEST_LOGIT = 2047,
    MOST_COUNTED = 250,
    WIDEST_NUMBER = 40,
    MOST_TRUSTED = 40,
};

/* A value by a pair of numbers that nothing else has; a tag is never 0. */
typedef struct {
    uint64_t tag, key;
    int64_t value;
} Slot;

typedef struct {
    Coder c;
    Slot *slots;
    uint64_t n_slots, n_keys;
    int64_t weights[N_BIT_MODELS][MOST_CONTEXTS];
    uint64_t high[MOST_CONTEXTS], low[MOST_CONTEXTS]; /* contexts of the next bit */
    int32_t logarithms[MOST_COUNTED + 2];             /* 256 ln(n + 0.4) */
    int32_t chances[2 * LARGEST_LOGIT + 1];           /* 65536 / (1 + exp(-d / 256)) */
    int32_t trusts[MOST_TRUSTED + 3];                 /* 1024 ln n */
} Mixer;

/* Natural logarithm of x >= 0.4, by halving and ln((1 + z) / (1 - z)) = 2 (z + z^3 / 3 + ...). */
static double logarithm(double x) {
    double found = 0.0;
    for (; x > 1.5; x /= 2.0) found += 0.69314718055994530942;
    const double z = (x - 1.0) / (x + 1.0);
    double power = z;
    for (int k = 1; k < 60; k += 2, power *= z * z) found += 2.0 * power / k;
    return found;
}

static int32_t nearest(double x) { return (int32_t)(x + 1024.0 + 0.5) - 1024; }

/* Take a hash table of about so many places, and start all weights and tables. */
static Mixer *take_mixer(Room *room, int64_t n_keys, int grow) {
    uint64_t n_slots = 64;
    /* What a stream declares costs nothing to declare: the table begins with so many at most. */
    while (n_slots < 3 * (uint64_t)least(n_keys, 1 << 20) / 2) n_slots *= 2;
    n_slots <<= grow;
    Mixer *m = TAKE(room, Mixer, 1);
    Slot *slots = TAKE(room, Slot, (int64_t)n_slots + 1);
    if (m) m->n_slots = n_slots;
    if (!slots) return m;
    m->slots = slots;
    for (int i = 0; i < N_BIT_MODELS; i++)
        for (int j = 0; j < MOST_CONTEXTS; j++) m->weights[i][j] = FIRST_WEIGHT;
    for (int n = 0; n < MOST_COUNTED + 2; n++)
        m->logarithms[n] = nearest(256.0 * logarithm(n + 0.4));
    for (int n = 1; n < MOST_TRUSTED + 3; n++) m->trusts[n] = nearest(1024.0 * logarithm(n));
    /* exp(-1 / 256) by its series, then its powers. */
    double step = 1.0, term = 1.0, power = 1.0;
    for (int k = 1; k < 12; k++) step += term *= -1.0 / 256.0 / k;
    for (int d = 0; d <= LARGEST_LOGIT; d++, power *= step) {
        m->chances[LARGEST_LOGIT + d] = nearest(65536.0 / (1.0 + power));
        m->chances[LARGEST_LOGIT - d] = nearest(65536.0 * power / (1.0 + power));
    }
    return m;
}

/* Place of the value of a pair, 0 if it is new. */
static int64_t *value_of(Mixer *m, uint64_t tag, uint64_t key) {
    const uint64_t mix = UINT64_C(0x9E3779B97F4A7C15);
    uint64_t h = (tag * mix) ^ (key * UINT64_C(0xC2B2AE3D27D4EB4F));
    h ^= h >> 29;
    h *= mix;
    h ^= h >> 29;
    for (uint64_t i = h & (m->n_slots - 1);; i = (i + 1) & (m->n_slots - 1)) {
        Slot *slot = m->slots + i;
        if (slot->tag == tag && slot->key == key) return &slot->value;
        if (slot->tag) continue;
        if (3 * m->n_keys >= 2 * m->n_slots) {
            /* Whatever is kept here is thrown away. */
            fail(&m->c, KEYS);
            slot = m->slots + m->n_slots;
            slot->value = 0;
        } else {
            m->n_keys++;
            slot->tag = tag;
            slot->key = key;
        }
        return &slot->value;
    }
}

/* Set a context of the next bit: 39 and 64 bits that nothing else has. */
static inline void set_context(Mixer *m, int i, int64_t high, int64_t low) {
    m->high[i] = (uint64_t)high;
    m->low[i] = (uint64_t)low;
}

/* Code a bit with the n contexts that were set, and adapt its model. */
static int code_bit(Mixer *m, int model, int step, int n, int value) {
    int64_t *seen[MOST_CONTEXTS], *weights = m->weights[model], total = 0;
    int32_t odds[MOST_CONTEXTS];
    for (int i = 0; i < n; i++) {
        const uint64_t where = 1 | (uint64_t)i << 5 | (uint64_t)model << 8 | (uint64_t)step << 16;
        seen[i] = value_of(m, where | m->high[i] << 24, m->low[i]);
        odds[i] = m->logarithms[*seen[i] >> 16] - m->logarithms[*seen[i] & 0xFFFF];
        total += weights[i] * odds[i];
    }
    const int64_t logit = most(-LARGEST_LOGIT, least(LARGEST_LOGIT, total >> 16));
    const int chance = m->chances[logit + LARGEST_LOGIT];
    const int bit = code_odds(&m->c, chance, value);
    const int64_t surprise = 3 * ((bit ? 65536 : 0) - chance);
    for (int i = 0; i < n; i++) {
        weights[i] += odds[i] * surprise >> 16;
        int no = (int)(*seen[i] & 0xFFFF), yes = (int)(*seen[i] >> 16);
        int *same = bit ? &yes : &no, *other = bit ? &no : &yes;
        ++*same;
        if (*other > 2) *other = (*other + 2) / 2;
        if (no + yes > MOST_COUNTED) {
            no /= 2;
            yes /= 2;
        }
        *seen[i] = (int64_t)yes << 16 | no;
    }
    return bit;
}

/* Code a number >= 0 with the n contexts that were set. */
static int64_t code_number(Mixer *m, int model, int n, int64_t value) {
    const int length = log_2((uint64_t)value + 1);
    int step = 0;
    while (code_bit(m, model, step, n, step < length)) {
        if (++step > WIDEST_NUMBER || m->c.at.status) {
            fail(&m->c, ENDLESS);
            return 0;
        }
    }
    return (INT64_C(1) << step) - 1 + code_bits(&m->c, step, value + 1 - (INT64_C(1) << step));
}

#endif
