/* Matrices of whole numbers one by one, in fewer bits and more time: docs/format.md, section 9. */
#ifndef MM_MIXED_H
#define MM_MIXED_H

#include "bits.h"
#include "matrix.h"

enum { N_STEPS = 14, LARGER = 20, ROWS_ABOVE = 6, WIDEST = 30, MOST_MIXED = 1 << 20 };

/* Magnitudes of a row, cut off at LARGEST_SEEN, and their running sums: zeros on both sides. */
typedef struct {
    int32_t *seen, *sums;
} Seen;

/* Two classes for each doubling. */
static inline int64_t size_of(int64_t value) {
    const int n = log_2((uint64_t)value + 2);
    return 2 * n - 2 + ((value + 2) >> (n - 1) & 1);
}

/* Set the eight contexts of an entry from its row and those above; give the first. */
static int64_t set_mixed_contexts(Mixer *m, const Seen *rows, int64_t row, int64_t column) {
    const int64_t x = WIDEST + column;
    const int32_t *here = rows[0].sums + x, *seen = rows[0].seen + x;
    const int32_t *one = rows[1].sums + x, *two = rows[2].sums + x, *three = rows[3].sums + x;
    const int64_t near_1 = one[2] - one[-1], near_2 = two[2] - two[-1];
    const int64_t near_3 = three[2] - three[-1], wide_1 = one[7] - one[-6];
    const int64_t wide_2 = two[7] - two[-6], wide_3 = three[7] - three[-6];
    const int64_t left = here[0] - here[-8], far_left = here[0] - here[-WIDEST];
    const int64_t up = rows[1].seen[x];
    const int64_t expected = 60 * up + 24 * near_1 + 12 * near_2 + 14 * near_3 + 8 * wide_1 +
                             5 * wide_2 + 5 * wide_3 + 32 * left;
    const int64_t size = size_of(expected), size_up = size_of(up);
    set_context(m, 0, 0, size);
    set_context(m, 1, 0, size_of(4 * left) << 8 | size_of(2 * wide_1));
    set_context(m, 2, 0, size_up << 16 | size_of(rows[2].seen[x]) << 8 | size_of(rows[3].seen[x]));
    set_context(m, 3, 0, size_of(near_1) << 8 | size_of(near_3));
    set_context(m, 4, 0, size_of(far_left) << 8 | size_of(left));
    set_context(m, 5, 0, least(column, 60) << 8 | row % 3);
    set_context(m, 6, 0, size_of(seen[-1]) << 16 | size_of(seen[-2]) << 8 | size_up);
    set_context(m, 7, 0, size_of(wide_1 + wide_2 + wide_3) << 8 | size_of(rows[6].seen[x]));
    return size;
}

static int64_t code_magnitude(Mixer *m, int64_t size, int64_t value) {
    for (int step = 0; step < N_STEPS; step++)
        if (!code_bit(m, step, 0, MOST_CONTEXTS, value > step)) return step;
    set_context(m, 0, 0, 0);
    set_context(m, 1, 0, size);
    return N_STEPS + code_number(m, LARGER, 2, most(value - N_STEPS, 0));
}

/* Code a matrix whose extents are known. */
static void code_mixed(Coder *c, Matrix *matrix, int grow, Room *room) {
    const int64_t columns = matrix->n_columns, width = columns + 2 * WIDEST + 2;
    int64_t n = 0;
    for (int64_t row = 0; row < matrix->n_rows; row++) n += matrix->edges[matrix->extents[row]];
    if (n > MOST_MIXED) {
        fail(c, TOO_MANY);
        return;
    }
    Mixer *m = take_mixer(room, 2 * n, grow);
    Seen rows[ROWS_ABOVE + 1];
    for (int i = 0; i <= ROWS_ABOVE; i++)
        rows[i] = (Seen){TAKE(room, int32_t, width), TAKE(room, int32_t, width)};
    if (!has_room(c, room)) return;
    m->c = *c;
    for (int64_t row = 0; row < matrix->n_rows && !m->c.at.status; row++) {
        int64_t *values = matrix->values + row * columns;
        const int64_t end = matrix->edges[matrix->extents[row]];
        const Seen oldest = rows[ROWS_ABOVE];
        for (int i = ROWS_ABOVE; i > 0; i--) rows[i] = rows[i - 1];
        rows[0] = oldest;
        int32_t *seen = oldest.seen + WIDEST, *sums = oldest.sums + WIDEST;
        for (int64_t column = 0; column < end; column++) {
            const int64_t size = set_mixed_contexts(m, rows, row, column);
            const int64_t magnitude = code_magnitude(m, size, magnitude_of(values[column]));
            if (c->at.reads) values[column] = magnitude;
            seen[column] = (int32_t)least(magnitude, LARGEST_SEEN);
            sums[column + 1] = sums[column] + seen[column];
        }
        /* What the row that had this place before left behind the end. */
        for (int64_t column = end; column < columns + WIDEST + 1; column++) {
            seen[column] = 0;
            sums[column + 1] = sums[column];
        }
    }
    for (int64_t row = 0; row < matrix->n_rows && !m->c.at.status; row++) {
        int64_t *values = matrix->values + row * columns;
        for (int64_t column = 0; column < columns; column++)
            if (values[column] && code_bits(&m->c, 1, values[column] < 0) && c->at.reads)
                values[column] = -values[column];
    }
    const int64_t needed = c->at.needed;
    *c = m->c;
    c->at.needed = needed;
}

#endif
