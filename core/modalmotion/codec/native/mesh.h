/* The graph of a mesh. */
#ifndef MM_MESH_H
#define MM_MESH_H

#include "graph.h"
#include "sorting.h"
#include "stream.h"

/* The graph of a mesh: loops and repeated edges left out. */
static int mesh_graph(Graph *g, int64_t n_vertices, const uint32_t *faces, int64_t n_faces,
                      Room *room) {
    int64_t *offsets = TAKE(room, int64_t, n_vertices + 1);
    int64_t *neighbours = TAKE(room, int64_t, 6 * n_faces), n = 0, n_ends = 0;
    const int64_t used = room->used;
    uint64_t *ends = TAKE(room, uint64_t, 6 * n_faces);
    int64_t *order = TAKE(room, int64_t, 6 * n_faces);
    if (room->used > room->size) return ROOM;
    for (int64_t i = 0; i < 3 * n_faces; i++) {
        const uint64_t a = faces[i], b = faces[i % 3 < 2 ? i + 1 : i - 2];
        if (a == b) continue;
        ends[n_ends++] = a << 32 | b;
        ends[n_ends++] = b << 32 | a;
    }
    sort_places(ends, order, n_ends, room);
    if (room->used > room->size) return ROOM;
    for (int64_t i = 0; i < n_ends; i++) {
        if (i && ends[i] == ends[i - 1]) continue;
        neighbours[n++] = (int64_t)(ends[i] & UINT32_MAX);
        offsets[(ends[i] >> 32) + 1]++;
    }
    for (int64_t v = 0; v < n_vertices; v++) offsets[v + 1] += offsets[v];
    *g = (Graph){n_vertices, offsets, neighbours};
    room->used = used;
    return FINE;
}

#endif
