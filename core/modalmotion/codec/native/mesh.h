/* The graph of a mesh. */
#ifndef MM_MESH_H
#define MM_MESH_H

#include "graph.h"
#include "sorting.h"
#include "stream.h"

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

#endif
