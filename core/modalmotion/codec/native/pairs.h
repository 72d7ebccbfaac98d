/* Modes of pairs: vertices merged two by two. docs/format.md, section 4. */
#ifndef MM_PAIRS_H
#define MM_PAIRS_H

#include "graph.h"
#include "sorting.h"
#include "stream.h"

enum { MOST_LEVELS = 64, FEWEST_PAIRS = 16 };

/* The graph of nodes, each of one or several of other ones; loops and repeated edges left out.
 *
 * Ends are pairs of the numbers `place` gives them, one after the other. */
static int join_nodes(Graph *g, int64_t n, const int64_t *ends, int64_t n_ends,
                      const int64_t *place, Room *room) {
    int64_t *offsets = TAKE(room, int64_t, n + 2), *neighbours = TAKE(room, int64_t, n_ends);
    if (room->used > room->size) return ROOM;
    for (int pass = 0; pass < 2; pass++) {
        for (int64_t i = 0; i < n_ends; i += 2) {
            const int64_t a = place ? place[ends[i]] : ends[i];
            const int64_t b = place ? place[ends[i + 1]] : ends[i + 1];
            if (a == b) continue;
            if (pass) {
                neighbours[offsets[a + 1]++] = b;
                neighbours[offsets[b + 1]++] = a;
            } else {
                offsets[a + 2]++;
                offsets[b + 2]++;
            }
        }
        for (int64_t v = 0; v < n && !pass; v++) offsets[v + 1] += offsets[v];
    }
    int64_t from = 0, to = 0;
    for (int64_t v = 0; v < n; v++) {
        const int64_t next = offsets[v + 1], count = sort_once(neighbours + from, next - from);
        memmove(neighbours + to, neighbours + from, (size_t)count * sizeof *neighbours);
        offsets[v] = to;
        to += count;
        from = next;
    }
    offsets[n] = to;
    *g = (Graph){n, offsets, neighbours};
    return FINE;
}

/* The edges of a graph, lower end first, in the order of both. */
static int64_t *take_edges(const Graph *g, int64_t *n_ends, Room *room) {
    int64_t *ends = TAKE(room, int64_t, g->offsets[g->n]), n = 0;
    *n_ends = g->offsets[g->n];
    for (int64_t v = 0; ends && v < g->n; v++)
        for (int64_t at = g->offsets[v]; at < g->offsets[v + 1]; at++)
            if (g->neighbours[at] > v) {
                ends[n++] = v;
                ends[n++] = g->neighbours[at];
            }
    return ends;
}

/* The graph of a mesh. */
static int mesh_graph(Graph *g, int64_t n_vertices, const uint32_t *faces, int64_t n_faces,
                      Room *room) {
    int64_t *ends = TAKE(room, int64_t, 6 * n_faces);
    if (room->used > room->size) return ROOM;
    for (int64_t i = 0; i < 3 * n_faces; i++) {
        ends[2 * i] = faces[i];
        ends[2 * i + 1] = faces[i % 3 < 2 ? i + 1 : i - 2];
    }
    return join_nodes(g, n_vertices, ends, 6 * n_faces, 0, room);
}

typedef struct {
    Graph g;
    int64_t n_pairs, *parent, *mate, *weight;
    double taken;
} Level;

typedef struct {
    int64_t n_levels, n_roots, *roots;
    Level *levels;
} Pairs;

static int read_pairs(Pairs *p, Bytes *b, const Graph *mesh, Room *room) {
    Graph g = *mesh;
    p->levels = TAKE(room, Level, MOST_LEVELS);
    int64_t *weight = TAKE(room, int64_t, g.n);
    if (room->used > room->size) return ROOM;
    for (int64_t v = 0; v < g.n; v++) weight[v] = 1;
    while (g.offsets[g.n] && p->n_levels < MOST_LEVELS) {
        Level l = {.g = g, .weight = weight};
        l.mate = TAKE(room, int64_t, g.n);
        l.parent = TAKE(room, int64_t, g.n);
        int64_t *above = TAKE(room, int64_t, g.n), n = 0, n_ends;
        if (room->used > room->size) return ROOM;
        pair(&g, weight, l.mate);
        for (int64_t v = 0; v < g.n; v++) {
            const int64_t mate = l.mate[v];
            l.n_pairs += mate > v;
            l.parent[v] = mate < v ? l.parent[mate] : n;
            if (mate >= v) above[n++] = weight[v] + (mate > v ? weight[mate] : 0);
        }
        if (FEWEST_PAIRS * l.n_pairs < g.n) break;
        l.taken = (double)next_number(b, 1) / 128.0;
        p->levels[p->n_levels++] = l;
        const int64_t *ends = take_edges(&g, &n_ends, room);
        if (!ends || join_nodes(&g, n, ends, n_ends, l.parent, room)) return ROOM;
        weight = above;
    }
    p->n_roots = g.n;
    p->roots = weight;
    return b->status || b->at != b->end ? NONSENSE : FINE;
}

/* Add the mean of what the level above has beside a node to one row, so many times. */
static void add_around(const Level *l, int64_t node, const double *means, int64_t n_rows,
                       double times, double *sum, double *row) {
    int64_t n = 0;
    for (int64_t i = 0; i < n_rows; i++) sum[i] = 0.0;
    for (int64_t at = l->g.offsets[node]; at < l->g.offsets[node + 1]; at++) {
        const int64_t beside = l->parent[l->g.neighbours[at]];
        if (beside == l->parent[node]) continue;
        for (int64_t i = 0; i < n_rows; i++) sum[i] += means[beside * n_rows + i];
        n++;
    }
    /* Who has no neighbour but its mate expects what its own parent has. */
    if (!n) {
        for (int64_t i = 0; i < n_rows; i++) sum[i] = means[l->parent[node] * n_rows + i];
        n = 1;
    }
    for (int64_t i = 0; i < n_rows; i++) row[i] += times * (sum[i] / (double)n);
}

static int pair_values(const Pairs *p, const double *numbers, int64_t n_rows, int64_t n_modes,
                       double *values, int64_t n_vertices, Room *room) {
    const int64_t used = room->used;
    double *means = TAKE(room, double, n_vertices * n_rows);
    double *below = TAKE(room, double, n_vertices * n_rows);
    double *difference = TAKE(room, double, n_rows), *sum = TAKE(room, double, n_rows);
    if (room->used > room->size) return ROOM;
    int64_t at = p->n_roots;
    for (int64_t node = 0; node < least(at, n_modes); node++) {
        const double scale = __builtin_sqrt((double)p->roots[node]);
        for (int64_t i = 0; i < n_rows; i++)
            means[node * n_rows + i] = numbers[i * n_modes + node] / scale;
    }
    for (int64_t level = p->n_levels - 1; level >= 0; level--) {
        const Level *l = p->levels + level;
        for (int64_t a = 0; a < l->g.n; a++) {
            const int64_t b = l->mate[a];
            const double *mean = means + l->parent[a] * n_rows;
            double *of_a = below + a * n_rows, *of_b = below + b * n_rows;
            if (b < a) continue;
            if (b == a) {
                for (int64_t i = 0; i < n_rows; i++) of_a[i] = mean[i];
                continue;
            }
            const double m = (double)l->weight[a], n = (double)l->weight[b];
            const double scale = __builtin_sqrt(m * n / (m + n));
            for (int64_t i = 0; i < n_rows; i++)
                difference[i] = at < n_modes ? numbers[i * n_modes + at] / scale : 0.0;
            add_around(l, b, means, n_rows, l->taken, sum, difference);
            add_around(l, a, means, n_rows, -l->taken, sum, difference);
            for (int64_t i = 0; i < n_rows; i++) {
                of_a[i] = mean[i] - n / (m + n) * difference[i];
                of_b[i] = mean[i] + m / (m + n) * difference[i];
            }
            at++;
        }
        double *other = means;
        means = below;
        below = other;
    }
    for (int64_t v = 0; v < n_vertices; v++)
        for (int64_t i = 0; i < n_rows; i++) values[i * n_vertices + v] = means[v * n_rows + i];
    room->used = used;
    return FINE;
}

#endif
