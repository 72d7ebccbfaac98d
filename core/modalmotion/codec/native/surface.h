/* Connectivity: triangles, then the order of the vertices. docs/format.md, section 10. */
#ifndef MM_SURFACE_H
#define MM_SURFACE_H

#include "order.h"

enum { KEYS_EACH = 8 /* in the hash table, for each triangle and vertex of common meshes */ };

typedef struct {
    int32_t n_vertices, n_faces, n_relations;
} Shape;

/* Of a writer: its triangles of vertices, and what is written of them so far. */
typedef struct {
    const int32_t *faces;
    int32_t *node_of, *vertex_of; /* node of each vertex or -1, and vertex of each node */
    int32_t *next_beside;         /* of each corner, the next one with the same edge to the next */
    uint8_t *used;
    int32_t *met;                 /* triangles of nodes, in the order of writing */
} Written;

/* Write a triangle, beginning with one of its corners. */
static void write_triangle(Walk *w, Written *written, int32_t face, int32_t first) {
    int32_t *met = written->met + 3 * (int64_t)w->n_done;
    for (int32_t i = 0; i < 3; i++) {
        const int32_t vertex = written->faces[3 * (int64_t)face + (first + i) % 3];
        int32_t *node = written->node_of + vertex;
        if (*node < 0) {
            *node = w->n_met;
            written->vertex_of[*node] = vertex;
        }
        met[i] = code_corner(w, *node);
    }
}

static int64_t *corner_beside(Walk *w, int32_t start, int32_t end) {
    return value_of(w->m, TAG_BESIDE | (uint64_t)start << 5, (uint64_t)end);
}

/* Find a triangle on an open edge that leaves the pivot, or -1. */
static int32_t waiting(Walk *w, Written *written, int32_t pivot) {
    for (int32_t edge = w->last_ahead[pivot]; edge; edge = w->edges[edge].earlier_ahead) {
        const int32_t end = written->vertex_of[w->edges[edge].end];
        int64_t *corner = corner_beside(w, written->vertex_of[pivot], end);
        /* Triangles that are written never wait again. */
        while (*corner && written->used[(*corner - 1) / 3])
            *corner = written->next_beside[*corner - 1];
        if (*corner) return (int32_t)((*corner - 1) / 3);
    }
    return -1;
}

/* Go round one pivot after the other. */
static void write_fans(Walk *w, Written *written, int32_t n_faces) {
    for (int32_t corner = 3 * n_faces - 1; corner >= 0; corner--) {
        const int32_t next = corner % 3 < 2 ? corner + 1 : corner - 2;
        int64_t *latest = corner_beside(w, written->faces[corner], written->faces[next]);
        written->next_beside[corner] = (int32_t)*latest;
        *latest = corner + 1;
    }
    for (int32_t unused = 0, n = 0; n < n_faces && !w->m->c.at.status;) {
        const int32_t pivot = pivot_of(w);
        while (written->used[unused]) unused++;
        const int32_t face = pivot < 0 ? unused : waiting(w, written, pivot);
        if (face < 0) {
            code_corner(w, GIVEN_UP);
            continue;
        }
        const int32_t *corners = written->faces + 3 * (int64_t)face;
        const int32_t vertex = pivot < 0 ? corners[0] : written->vertex_of[pivot];
        int32_t first = 0;
        while (first < 2 && corners[first] != vertex) first++;
        written->used[face] = 1;
        n++;
        write_triangle(w, written, face, first);
    }
}

static void read_triangles(Walk *w, int32_t *met, int32_t n_faces) {
    for (int64_t n = 0; n < 3 * (int64_t)n_faces && !w->m->c.at.status;) {
        const int32_t node = code_corner(w, 0);
        if (node != GIVEN_UP) met[n++] = node;
    }
}

/* Code triangles, and the order of the vertices. */
static void code_surface(Coder *c, const Shape *shape, int32_t *faces, int grow, Room *room) {
    const int32_t n = shape->n_vertices, n_faces = shape->n_faces;
    const int64_t n_corners = 3 * (int64_t)n_faces;
    Mixer *m = take_mixer(room, KEYS_EACH * ((int64_t)n_faces + n), grow);
    Walk *w = TAKE(room, Walk, 1);
    int32_t *met = TAKE(room, int32_t, n_corners);
    Written written = {.faces = faces, .met = met};
    if (!c->at.reads) {
        written.node_of = TAKE(room, int32_t, n);
        written.vertex_of = TAKE(room, int32_t, n);
        written.next_beside = TAKE(room, int32_t, n_corners);
        written.used = TAKE(room, uint8_t, n_faces);
    }
    if (w) take_walk(w, room, n, n_faces);
    Order *o = take_order(room, m, n, n_faces, shape->n_relations);
    if (!has_room(c, room)) return;
    m->c = *c;
    w->m = m;
    if (c->at.reads) {
        read_triangles(w, met, n_faces);
    } else {
        for (int32_t v = 0; v < n; v++) written.node_of[v] = -1;
        write_fans(w, &written, n_faces);
    }
    if (!m->c.at.status) {
        make_rings(&o->r, m, n, n_faces, met);
        begin_order(o, m);
        for (int32_t vertex = 0; vertex < n && !m->c.at.status; vertex++) {
            const int32_t node = c->at.reads ? 0 : written.node_of[vertex];
            code_vertex(o, node < 0 ? w->n_met : node);
        }
        if (c->at.reads && !m->c.at.status)
            for (int64_t i = 0; i < n_corners; i++) faces[i] = o->number[met[i]];
    }
    *c = m->c;
}

#endif
