/* Triangles as a walk over their corners: docs/format.md, section 10.
 *
 * Nodes are numbered in the order in which they are met. */
#ifndef MM_TRIANGLES_H
#define MM_TRIANGLES_H

#include "bits.h"

enum { NEW, AHEAD, BEHIND, OLDER };
enum { GIVEN_UP = -1, NOBODY = -1, OLDER_BIT = 12, GIVEN_UP_CODE = 64 };

/* Kinds of keys in the hash table; those of a bit's contexts have 1 in their lowest bits. */
enum { TAG_EDGE = 2, TAG_BESIDE, TAG_RING, TAG_PATH, TAG_PAIR, TAG_TAKEN, TAG_STEPS };

/* An edge that is open `count` times, and its neighbours in the lists of its two ends. */
typedef struct {
    int32_t start, end, count;
    int32_t earlier_ahead, later_ahead, earlier_behind, later_behind;
} Edge;

typedef struct {
    Mixer *m;
    int32_t n_nodes, n_met, n_done, n_edges, corner, kinds;
    uint64_t codes;                 /* of the last six triangles, seven bits each */
    int32_t face[3];                /* corners of the triangle so far */
    int32_t *pivots, first_pivot, n_pivots;
    int32_t *n_around; /* triangles so far at each node */
    Edge *edges;                    /* from 1 on */
    int32_t *last_ahead, *last_behind;
    uint8_t at_corner[3];           /* kind of the latest of each number */
} Walk;

static void take_walk(Walk *w, Room *room, int32_t n_nodes, int32_t n_faces) {
    w->n_nodes = n_nodes;
    w->pivots = TAKE(room, int32_t, n_nodes);
    w->n_around = TAKE(room, int32_t, n_nodes);
    w->last_ahead = TAKE(room, int32_t, n_nodes);
    w->last_behind = TAKE(room, int32_t, n_nodes);
    w->edges = TAKE(room, Edge, 3 * (int64_t)n_faces + 1);
}

static inline int32_t pivot_of(const Walk *w) {
    return w->first_pivot == w->n_pivots ? NOBODY : w->pivots[w->first_pivot];
}

static void unlink_edge(Walk *w, int32_t edge) {
    Edge *edges = w->edges, *e = edges + edge;
    if (e->earlier_ahead) edges[e->earlier_ahead].later_ahead = e->later_ahead;
    if (e->later_ahead)
        edges[e->later_ahead].earlier_ahead = e->earlier_ahead;
    else
        w->last_ahead[e->start] = e->earlier_ahead;
    if (e->earlier_behind) edges[e->earlier_behind].later_behind = e->later_behind;
    if (e->later_behind)
        edges[e->later_behind].earlier_behind = e->earlier_behind;
    else
        w->last_behind[e->end] = e->earlier_behind;
}

static void link_last(Walk *w, int32_t edge) {
    Edge *e = w->edges + edge;
    e->earlier_ahead = w->last_ahead[e->start];
    e->earlier_behind = w->last_behind[e->end];
    e->later_ahead = e->later_behind = 0;
    if (e->earlier_ahead) w->edges[e->earlier_ahead].later_ahead = edge;
    if (e->earlier_behind) w->edges[e->earlier_behind].later_behind = edge;
    w->last_ahead[e->start] = w->last_behind[e->end] = edge;
}

/* Close the open edge that this one lies on, or open one for a triangle beyond it. */
static void pass_edge(Walk *w, int32_t start, int32_t end) {
    int32_t edge = (int32_t)*value_of(w->m, TAG_EDGE | (uint64_t)start << 5, (uint64_t)end);
    if (edge && w->edges[edge].count) {
        if (!--w->edges[edge].count) unlink_edge(w, edge);
        return;
    }
    int64_t *found = value_of(w->m, TAG_EDGE | (uint64_t)end << 5, (uint64_t)start);
    if (!*found) {
        *found = ++w->n_edges;
        w->edges[*found] = (Edge){.start = end, .end = start};
    }
    edge = (int32_t)*found;
    if (w->edges[edge].count++) unlink_edge(w, edge);
    link_last(w, edge);
}

/* Drop pivots whose fan has closed, even if an edge of it opens again. */
static void drop_closed(Walk *w) {
    while (w->first_pivot < w->n_pivots && !w->last_ahead[pivot_of(w)]) w->first_pivot++;
}

static void set_walk_contexts(Walk *w, int32_t behind) {
    const int64_t kinds = w->kinds, corner = w->corner, codes = (int64_t)w->codes;
    const int32_t at = w->corner ? w->face[0] : pivot_of(w);
    const int64_t first = at >= 0 ? w->n_around[at] + 1 : 0;
    const int64_t second = w->corner == 2 ? w->n_around[w->face[1]] + 1 : 0;
    const int64_t third = behind >= 0 ? w->n_around[behind] + 1 : 0;
    set_context(w->m, 0, kinds, corner << 21 | (codes & 0x1FFFFF));
    set_context(w->m, 1, kinds, corner << 42 | codes);
    set_context(w->m, 2, third << 4 | kinds, second << 32 | first);
    set_context(w->m, 3, (codes & 0x3FFF) << 4 | kinds, third << 32 | first);
    set_context(w->m, 4, (codes & 0x7F) << 4 | kinds, first);
    set_context(w->m, 5, kinds, second << 32 | first);
    set_context(w->m, 6, w->at_corner[corner] << 4 | kinds, corner);
}

/* Code a node by how many were met since it was. */
static int32_t code_older(Walk *w, int32_t node) {
    set_context(w->m, 0, 0, w->corner);
    const int64_t since = code_number(w->m, OLDER_BIT, 1, most(w->n_met - 1 - node, 0));
    return since < w->n_met ? w->n_met - 1 - (int32_t)since : NOBODY;
}

static void take_corner(Walk *w, int32_t node, int kind) {
    if (kind == NEW) {
        w->n_met++;
        w->pivots[w->n_pivots++] = node;
    }
    w->at_corner[w->corner] = (uint8_t)kind;
    w->kinds = 4 * w->kinds + kind;
    w->face[w->corner++] = node;
    if (w->corner < 3) return;
    for (int i = 0; i < 3; i++) {
        pass_edge(w, w->face[i], w->face[(i + 1) % 3]);
        w->n_around[w->face[i]]++;
    }
    w->codes = (w->codes << 7 | (uint64_t)w->kinds) & ((UINT64_C(1) << 42) - 1);
    w->corner = w->kinds = 0;
    w->n_done++;
    drop_closed(w);
}

/* Code a corner: its node, or GIVEN_UP. */
static int32_t code_corner(Walk *w, int32_t node) {
    static const uint8_t asked[3][3] = {
        {AHEAD, BEHIND, NEW}, {AHEAD, NEW, BEHIND}, {NEW, BEHIND, AHEAD}};
    int32_t ahead = pivot_of(w), behind = NOBODY;
    if (w->corner) {
        const int32_t leaves = w->last_ahead[w->face[w->corner - 1]];
        const int32_t reaches_it = w->last_behind[w->face[0]];
        ahead = leaves ? w->edges[leaves].end : NOBODY;
        behind = reaches_it ? w->edges[reaches_it].start : NOBODY;
    }
    int wanted = OLDER, kind = OLDER;
    if (node == GIVEN_UP || (node == behind && node != ahead))
        wanted = BEHIND;
    else if (node == ahead)
        wanted = AHEAD;
    else if (node >= w->n_met)
        wanted = NEW;
    set_walk_contexts(w, behind);
    for (int turn = 0; turn < 3 && kind == OLDER; turn++) {
        const int candidate = asked[w->corner][turn];
        if (candidate == AHEAD && ahead < 0) continue;
        if (candidate == BEHIND && (w->corner ? behind : ahead) < 0) continue;
        if (code_bit(w->m, 4 * w->corner + candidate, 0, 7, wanted == candidate)) kind = candidate;
    }
    if (!w->corner && kind == BEHIND) {
        w->first_pivot++;
        drop_closed(w);
        w->codes = (w->codes << 7 | GIVEN_UP_CODE) & ((UINT64_C(1) << 42) - 1);
        return GIVEN_UP;
    }
    if (kind == AHEAD)
        node = ahead;
    else if (kind == BEHIND)
        node = behind;
    else
        node = kind == NEW ? w->n_met : code_older(w, node);
    if (node < 0 || node >= w->n_nodes) {
        fail(&w->m->c, NO_VERTEX);
        return 0;
    }
    take_corner(w, node, kind);
    return node;
}

#endif
