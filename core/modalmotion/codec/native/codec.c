/* The codec's inner loops, for Python (modalmotion.numeric.native) and for WebAssembly.
 *
 * Freestanding C11: no library, no allocation, no state; floating point in single operations only
 * (-ffp-contract=off), so that every machine codes the same bits. Functions that code take the
 * state of a coder, its words and its bits, and give a status; what a failed call has changed is
 * of no use, and the state is as before. */
#include "graph.h"
#include "mixed.h"
#include "surface.h"

/* Hand back a coder; a failed call leaves the state, but for what it says. */
static int done(State *state, const Coder *c) {
    const int status = (int)c->at.status;
    if (status == FINE) *state = c->at;
    state->needed = c->at.needed;
    return status;
}

/* Begin to read these words, or to write. */
MM_EXPORT(mm_begin) void mm_begin(State *state, uint32_t *words, int64_t reads) {
    Coder c = {*state, words, 0};
    c.at.lower = c.at.point = 0;
    c.at.range = UINT64_MAX;
    c.at.word = c.at.bit = c.at.n_waiting = c.at.waiting = c.at.status = 0;
    c.at.reads = reads;
    if (reads) {
        c.at.point = (uint64_t)next_word(&c) << 32;
        c.at.point |= next_word(&c);
    }
    *state = c.at;
}

/* Write what of the words is left. */
MM_EXPORT(mm_finish) int32_t mm_finish(State *state, uint32_t *words, uint8_t *bits) {
    Coder c = {*state, words, bits};
    if (c.at.range == UINT64_MAX) return FINE;
    const uint64_t point = c.at.lower + UINT32_MAX;
    if (c.at.n_waiting) resolve_carry(&c, point < c.at.lower);
    put_word(&c, (uint32_t)(point >> 32));
    if ((c.at.lower + c.at.range) >> 32 == point >> 32) put_word(&c, 0);
    return done(state, &c);
}

/* Code a list of whole numbers >= 0. */
MM_EXPORT(mm_list)
int32_t mm_list(State *state, uint32_t *words, uint8_t *bits, int64_t n, int64_t *values) {
    Coder c = {*state, words, bits};
    code_list(&c, n, values);
    return done(state, &c);
}

/* Code plain numbers of so many bits each. */
MM_EXPORT(mm_bits)
int32_t mm_bits(State *state, uint32_t *words, uint8_t *bits, int64_t n, int64_t width,
                int64_t *values) {
    Coder c = {*state, words, bits};
    for (int64_t i = 0; i < n && !c.at.status; i++) {
        const int64_t value = code_bits(&c, (int)width, values[i]);
        if (c.at.reads) values[i] = value;
    }
    return done(state, &c);
}

/* Code a matrix of whole numbers, zeros at first for a reader: in waves, or one by one if it is
 * `mixed`, then with a hash table 2^grow times as large as is usual. */
MM_EXPORT(mm_matrix)
int32_t mm_matrix(State *state, uint32_t *words, uint8_t *bits, int64_t n_rows, int64_t n_columns,
                  int64_t *values, int64_t mixed, int64_t grow, uint8_t *room, int64_t n_room) {
    Coder c = {*state, words, bits};
    Room left = {room, n_room, 0, 0};
    Matrix m = {n_rows, n_columns, band_edges(n_columns, 0), 0, 0, values};
    if (!n_rows || !n_columns) return FINE;
    m.edges = TAKE(&left, int64_t, m.n_bands + 1);
    m.extents = TAKE(&left, int64_t, n_rows);
    if (!has_room(&c, &left)) return done(state, &c);
    band_edges(n_columns, m.edges);
    code_extents(&c, &m);
    if (m.n_rows && !c.at.status) {
        if (mixed)
            code_mixed(&c, &m, (int)grow, &left);
        else
            code_waves(&c, &m, &left);
    }
    return done(state, &c);
}

/* Code triangles, in the order of a walk, and the order of the vertices. */
MM_EXPORT(mm_faces)
int32_t mm_faces(State *state, uint32_t *words, uint8_t *bits, int64_t n_vertices, int64_t n_faces,
                 int64_t n_relations, int32_t *faces, int64_t grow, uint8_t *room,
                 int64_t n_room) {
    Coder c = {*state, words, bits};
    Room left = {room, n_room, 0, 0};
    const Shape shape = {(int32_t)n_vertices, (int32_t)n_faces, (int32_t)n_relations};
    if (n_vertices < 1 || n_vertices >= 1 << 28 || n_faces < 0 || n_faces >= 1 << 28 ||
        n_relations < 0 || n_relations > MOST_RELATIONS)
        fail(&c, TOO_MANY);
    else
        code_surface(&c, &shape, faces, (int)grow, &left);
    return done(state, &c);
}

/* Label each of n vertices with its patch of at most `largest`; the room is 5 n + 2 numbers. */
MM_EXPORT(mm_halve)
void mm_halve(int64_t n, const int64_t *offsets, const int64_t *neighbours, int64_t largest,
              int64_t *label, int64_t *room) {
    const Graph g = {n, offsets, neighbours};
    room[3 * n] = room[4 * n + 1] = 0;
    halve(&g, largest, label, room, room + n, room + 2 * n, room + 3 * n, room + 4 * n + 1);
}
