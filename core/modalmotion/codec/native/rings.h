/* Neighbours of each node, in order around it, and walks among them: docs/format.md, section 10. */
#ifndef MM_RINGS_H
#define MM_RINGS_H

#include "triangles.h"

enum { NOWHERE = -1, MOST_LOOKS = 8, SCANNED = 16, MOST_AROUND = 512, MOST_TURNS = 512 };

/* Notes on the neighbours of the node whose ring is made: each is of the node that it is equal to,
 * less one. */
typedef struct {
    int32_t *seen, *after, *has_after, *has_before, *in_ring, *list;
} Notes;

typedef struct {
    Mixer *m;
    int32_t *ring, *neighbours; /* where the ring of each node begins, and all rings */
    int32_t *back;              /* of each entry, place of the node in that neighbour's ring */
    /* A search: nodes, which of them led to each, where it was entered; what was met when. */
    int32_t around[MOST_AROUND], parents[MOST_AROUND], entered[MOST_AROUND], way[MOST_AROUND];
    int32_t turns[MOST_TURNS];
    int32_t *stamp, n_stamps;
    Notes notes;
    int32_t *first, *pairs; /* of each node: the other two corners of its triangles, from there on */
} Rings;

static inline int32_t degree(const Rings *r, int32_t v) { return r->ring[v + 1] - r->ring[v]; }

static inline int32_t neighbour(const Rings *r, int32_t v, int32_t place) {
    return r->neighbours[r->ring[v] + place];
}

/* Place of a node in the ring of another, or -1. */
static int32_t place_in(const Rings *r, int32_t v, int32_t x) {
    const int32_t n = degree(r, v), *first = r->neighbours + r->ring[v];
    if (x < 0) return -1;
    if (n > SCANNED)
        return (int32_t)*value_of(r->m, TAG_RING | (uint64_t)v << 5, (uint64_t)x) - 1;
    for (int32_t place = 0; place < n; place++)
        if (first[place] == x) return place;
    return -1;
}

/* Put the neighbours of a node in order, from the other two corners of its triangles. */
static void make_ring(Rings *r, int32_t v, const int32_t *pair, const int32_t *end) {
    const Notes *n = &r->notes;
    const int32_t mark = v + 1, begin = r->ring[v];
    int32_t count = 0, place = 0;
    for (; pair < end; pair += 2) {
        const int32_t x = pair[0], y = pair[1];
        for (int i = 0; i < 2; i++)
            if (n->seen[pair[i]] != mark) {
                n->seen[pair[i]] = mark;
                n->list[count++] = pair[i];
            }
        if (n->has_after[x] != mark && n->has_before[y] != mark) {
            n->has_after[x] = n->has_before[y] = mark;
            n->after[x] = y;
        }
    }
    r->ring[v + 1] = begin + count;
    /* Chains begin at a border; what is left are closed rings. */
    for (int is_closed = 0; is_closed < 2; is_closed++)
        for (int32_t i = 0; i < count; i++) {
            if (!is_closed && n->has_before[n->list[i]] == mark) continue;
            for (int32_t x = n->list[i]; n->in_ring[x] != mark; x = n->after[x]) {
                n->in_ring[x] = mark;
                r->neighbours[begin + place++] = x;
                if (count > SCANNED)
                    *value_of(r->m, TAG_RING | (uint64_t)v << 5, (uint64_t)x) = place;
                if (n->has_after[x] != mark) break;
            }
        }
}

static void take_rings(Rings *r, Room *room, int64_t n_nodes, int64_t n_faces) {
    int32_t **notes[] = {&r->notes.seen,       &r->notes.after,   &r->notes.has_after,
                         &r->notes.has_before, &r->notes.in_ring, &r->notes.list};
    r->ring = TAKE(room, int32_t, n_nodes + 1);
    r->neighbours = TAKE(room, int32_t, 6 * n_faces);
    r->back = TAKE(room, int32_t, 6 * n_faces);
    r->stamp = TAKE(room, int32_t, n_nodes);
    r->first = TAKE(room, int32_t, n_nodes + 1);
    r->pairs = TAKE(room, int32_t, 6 * n_faces);
    for (int i = 0; i < 6; i++) *notes[i] = TAKE(room, int32_t, n_nodes);
}

/* Make all rings of triangles of nodes. */
static void make_rings(Rings *r, Mixer *m, int32_t n_nodes, int32_t n_faces, const int32_t *faces) {
    const int64_t n_corners = 3 * (int64_t)n_faces;
    int32_t *first = r->first;
    r->m = m;
    for (int64_t i = 0; i < n_corners; i++) first[faces[i] + 1]++;
    for (int32_t v = 0; v < n_nodes; v++) first[v + 1] += first[v];
    /* The first of a node is its cursor, and ends where that of the next one began. */
    for (int64_t i = 0; i < n_corners; i++) {
        const int32_t *face = faces + i / 3 * 3;
        int32_t *to = r->pairs + 2 * (int64_t)first[faces[i]]++;
        to[0] = face[(i + 1) % 3];
        to[1] = face[(i + 2) % 3];
    }
    for (int32_t v = 0, start = 0; v < n_nodes; start = first[v++])
        make_ring(r, v, r->pairs + 2 * (int64_t)start, r->pairs + 2 * (int64_t)first[v]);
    for (int32_t v = 0; v < n_nodes; v++)
        for (int32_t i = r->ring[v]; i < r->ring[v + 1]; i++)
            r->back[i] = place_in(r, r->neighbours[i], v);
}

/* Walk along turns; NOWHERE if a node has too few neighbours. */
static int32_t follow(const Rings *r, int32_t node, int32_t origin, const int32_t *turns,
                      int32_t n_turns) {
    int32_t place = n_turns ? place_in(r, node, origin) : 0;
    for (int32_t i = 0; i < n_turns; i++) {
        const int32_t begin = r->ring[node], n = degree(r, node);
        if (turns[i] >= n) return NOWHERE;
        place += 1 + turns[i];
        const int32_t entry = begin + (place < n ? place : place - n);
        node = r->neighbours[entry];
        place = r->back[entry];
    }
    return node;
}

/* List the nodes around a node, near ones first, up to a goal; their number. */
static int32_t search(Rings *r, int32_t node, int32_t origin, int32_t largest, int32_t goal) {
    const int32_t mark = ++r->n_stamps;
    int32_t n = 1, looks = MOST_LOOKS * largest;
    r->entered[0] = place_in(r, node, origin);
    r->around[0] = node;
    r->parents[0] = -1;
    r->stamp[node] = mark;
    for (int32_t parent = 0; parent < n; parent++) {
        const int32_t begin = r->ring[r->around[parent]], size = degree(r, r->around[parent]);
        /* A hub has more neighbours than there is time for. */
        looks -= size;
        if (looks <= 0) break;
        int32_t place = r->entered[parent];
        for (int32_t i = 0; i < size; i++) {
            place = place + 1 < size ? place + 1 : 0;
            const int32_t there = r->neighbours[begin + place];
            if (r->stamp[there] == mark) continue;
            r->stamp[there] = mark;
            r->around[n] = there;
            r->parents[n] = parent;
            r->entered[n++] = r->back[begin + place];
            if (there == goal || n > largest) return n;
        }
    }
    return n;
}

/* List the nodes from a place of the search back to its first; their number. */
static int32_t way_back(Rings *r, int32_t place) {
    int32_t n = 0;
    for (; place >= 0; place = r->parents[place]) r->way[n++] = r->around[place];
    return n;
}

/* List the turns along the way of n nodes, or along it backwards; their number. */
static int32_t path_along(Rings *r, int32_t origin, int32_t n, int is_back) {
    for (int32_t i = 0; i < n - 1; i++) {
        const int32_t here = r->way[is_back ? i : n - 1 - i];
        const int32_t there = r->way[is_back ? i + 1 : n - 2 - i];
        const int32_t turn = place_in(r, here, there) - place_in(r, here, origin) - 1;
        r->turns[i] = turn >= 0 ? turn : turn + degree(r, here);
        origin = here;
    }
    return n - 1;
}

#endif
