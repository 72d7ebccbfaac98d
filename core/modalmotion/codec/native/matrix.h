/* Matrices of whole numbers in waves: docs/format.md, section 7. */
#ifndef MM_MATRIX_H
#define MM_MATRIX_H

#include "coder.h"

enum { WIDEST_BAND = 64, LARGEST_SEEN = 1023, N_CONTEXTS = 44, ABOVE = 3 };

typedef struct {
    int64_t n_rows, n_columns, n_bands;
    int64_t *edges;   /* first column of each band, and the end */
    int64_t *extents; /* bands of each row, never more than of the one above */
    int64_t *values;
} Matrix;

static inline int64_t magnitude_of(int64_t value) { return value < 0 ? -value : value; }

/* Bands of 4, 4, 8, 8, 16, 16, 32, 32, 64, 64, ... columns; their number. */
static int64_t band_edges(int64_t n_columns, int64_t *edges) {
    int64_t n = 0, at = 0;
    for (int64_t width = 4; at < n_columns; n++) {
        if (edges) edges[n] = at;
        at = least(n_columns, at + width);
        if (n % 2) width = least(WIDEST_BAND, 2 * width);
    }
    if (edges) edges[n] = n_columns;
    return n;
}

/* Code how many bands each row has, and leave out the rows at the end that have none. */
static void code_extents(Coder *c, Matrix *m) {
    int64_t *drops = m->extents, seen = 0;
    for (int64_t row = c->at.reads ? 0 : m->n_rows; row-- > 0;) {
        const int64_t *values = m->values + row * m->n_columns;
        int64_t column = m->n_columns;
        while (column > m->edges[seen] && !values[column - 1]) column--;
        while (m->edges[seen] < column) seen++;
        drops[row] = seen;
    }
    for (int64_t row = 0, before = m->n_bands; !c->at.reads && row < m->n_rows; row++) {
        const int64_t extent = drops[row];
        drops[row] = before - extent;
        before = extent;
    }
    code_list(c, m->n_rows, drops);
    int64_t extent = m->n_bands, used = 0;
    for (int64_t row = 0; row < m->n_rows; row++) {
        extent = most(0, extent - drops[row]);
        m->extents[row] = extent;
        used += extent > 0;
    }
    m->n_rows = used;
}

typedef struct {
    int64_t place;
    int32_t context, symbol;
} Entry;

typedef struct {
    Matrix *m;
    uint32_t *sums;  /* running sums of magnitudes along each row; three rows of zeros above */
    uint32_t *means; /* of each tile, in 1/64; two tiles of zeros before each row */
    Table *tables;
    Entry *wave;
} Waves;

/* Start the tables of each context from a geometric distribution of its expected magnitude. */
static void start_tables(Table *tables) {
    double doubled = 1.25;
    for (int k = 0; k < N_CONTEXTS; k++) {
        if (k && k % 2 == 0) doubled *= 2.0;
        const double mean = (2 + k % 2) * doubled / 512.0, ratio = mean / (1.0 + mean);
        double left = 1.0, power = ratio;
        for (int i = 0; i < N_SYMBOLS; i++, left *= ratio) {
            const double share = i < ESCAPE ? left * (1.0 - ratio) : left;
            tables[k].symbols[i] = 1.0 + (double)(int64_t)(share * 512.0);
        }
        left = 1.0;
        for (int n = 0; n < N_CLASSES; n++, left *= power, power *= power)
            tables[k].classes[n] = 1.0 + (double)(int64_t)(left * (1.0 - power) * 256.0);
    }
}

/* Context of an entry from what it is expected to be, in 1/512. */
static int wave_context(const Waves *w, int64_t row, int64_t band, int64_t column) {
    const int64_t stride = w->m->n_columns + 1, end = w->m->edges[band + 1];
    const uint32_t *one = w->sums + (row + ABOVE - 1) * stride;
    const uint32_t *two = one - stride, *three = two - stride;
    const uint32_t *means = w->means + row * (w->m->n_bands + 2) + band;
    uint32_t total = 3 * means[1] + means[0] + 60 * (one[column + 1] - one[column]) + 2;
    int64_t low = most(column - 1, 0), high = least(column + 2, end);
    total += 24 * (one[high] - one[low]) + 12 * (two[high] - two[low]);
    total += 14 * (three[high] - three[low]);
    low = most(column - 6, 0), high = least(column + 7, end);
    total += 8 * (one[high] - one[low]) + 5 * (two[high] - two[low]);
    total += 5 * (three[high] - three[low]);
    low = most(column - 32, 0), high = least(column + 33, end);
    total += one[high] - one[low];
    const int n = log_2(total);
    return (int)least(2 * n - 2 + (int)(total >> (n - 1) & 1), N_CONTEXTS - 1);
}

/* Code what exceeds the symbols of a wave. */
static void code_large(Coder *c, Waves *w, int64_t n) {
    int64_t *values = w->m->values;
    for (int64_t i = 0; i < n; i++) {
        Entry *e = w->wave + i;
        if (e->symbol < ESCAPE) continue;
        const int64_t magnitude = magnitude_of(values[e->place]);
        e->symbol = ESCAPE + code_class(c, w->tables + e->context, magnitude);
    }
    for (int64_t i = 0; i < n; i++) {
        const Entry *e = w->wave + i;
        if (e->symbol >= ESCAPE) w->tables[e->context].classes[e->symbol - ESCAPE] += INCREMENT;
    }
    for (int64_t i = 0; i < n; i++) {
        const Entry *e = w->wave + i;
        if (e->symbol < ESCAPE) continue;
        const int64_t magnitude = magnitude_of(values[e->place]);
        const int64_t found = code_rest(c, e->symbol - ESCAPE, magnitude);
        if (c->at.reads) values[e->place] = found;
    }
}

/* Add up the magnitudes of a tile for those that look at it. */
static void take_in(Waves *w, int64_t row, int64_t band) {
    const int64_t columns = w->m->n_columns;
    const int64_t low = w->m->edges[band], high = w->m->edges[band + 1];
    const int64_t *values = w->m->values + row * columns;
    uint32_t *sums = w->sums + (row + ABOVE) * (columns + 1);
    for (int64_t i = low; i < high; i++)
        sums[i + 1] = sums[i] + (uint32_t)least(magnitude_of(values[i]), LARGEST_SEEN);
    const uint32_t seen = sums[high] - sums[low];
    w->means[row * (w->m->n_bands + 2) + band + 2] = 64 * seen / (uint32_t)(high - low);
}

/* Code a matrix whose extents are known, diagonal by diagonal: all that is looked at is older. */
static void code_waves(Coder *c, Matrix *m, Room *room) {
    const int64_t most_tiles = least(m->n_rows, m->n_bands);
    Waves w = {.m = m};
    w.sums = TAKE(room, uint32_t, (m->n_rows + ABOVE) * (m->n_columns + 1));
    w.means = TAKE(room, uint32_t, m->n_rows * (m->n_bands + 2));
    w.tables = TAKE(room, Table, N_CONTEXTS);
    w.wave = TAKE(room, Entry, most_tiles * WIDEST_BAND);
    if (!has_room(c, room)) return;
    start_tables(w.tables);
    for (int64_t t = 0; t < m->n_rows + m->n_bands - 1; t++) {
        const int64_t first = most(0, t - m->n_bands + 1), last = least(t, m->n_rows - 1);
        int64_t n = 0, n_large = 0;
        /* Boundaries are those of a wave: what it counts changes the next one's. */
        for (int k = 0; k < N_CONTEXTS; k++)
            w.tables[k].has_symbol_cuts = w.tables[k].has_class_cuts = 0;
        for (int64_t row = first; row <= last; row++) {
            const int64_t band = t - row;
            if (band >= m->extents[row]) continue;
            for (int64_t column = m->edges[band]; column < m->edges[band + 1]; column++) {
                const int64_t place = row * m->n_columns + column;
                const int context = wave_context(&w, row, band, column);
                const int64_t magnitude = magnitude_of(m->values[place]);
                const int symbol = code_small(c, w.tables + context, magnitude);
                if (c->at.reads) m->values[place] = symbol;
                w.wave[n++] = (Entry){place, context, symbol};
                n_large += symbol == ESCAPE;
            }
        }
        for (int64_t i = 0; i < n; i++)
            w.tables[w.wave[i].context].symbols[w.wave[i].symbol] += INCREMENT;
        if (n_large) code_large(c, &w, n);
        for (int64_t row = first; row <= last; row++)
            if (t - row < m->extents[row]) take_in(&w, row, t - row);
        for (int64_t i = 0; i < n; i++) {
            int64_t *value = m->values + w.wave[i].place;
            if (w.wave[i].symbol && code_bits(c, 1, *value < 0) && c->at.reads) *value = -*value;
        }
        if (c->at.status) return;
    }
}

#endif
