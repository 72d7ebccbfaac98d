/* Patches of the vertices of a mesh: docs/format.md, section 4.
 *
 * A graph is where the neighbours of each vertex begin, and all neighbours, ascending. */
#ifndef MM_GRAPH_H
#define MM_GRAPH_H

#include "coder.h"

typedef struct {
    int64_t n;
    const int64_t *offsets, *neighbours;
} Graph;

/* List what is connected to a vertex and has its label, give it a new one, and count it. */
static int64_t label_connected(const Graph *g, int64_t *label, int64_t *order, int64_t first,
                               int64_t new) {
    const int64_t old = label[first];
    int64_t n = 1;
    label[first] = new;
    order[0] = first;
    for (int64_t i = 0; i < n; i++)
        for (int64_t at = g->offsets[order[i]]; at < g->offsets[order[i] + 1]; at++) {
            const int64_t v = g->neighbours[at];
            if (label[v] != old) continue;
            label[v] = new;
            order[n++] = v;
        }
    return n;
}

/* Label each vertex with its patch: a connected part, halved until it is small enough. */
static void halve(const Graph *g, int64_t largest, int64_t *label, int64_t *order, int64_t *pool,
                  int64_t *part, int64_t *starts, int64_t *labels) {
    int64_t n_labels = 1, n_parts = 1, top = g->n;
    /* The vertices of each part that waits, one after the other; the last is taken first. */
    for (int64_t v = 0; v < g->n; v++) {
        pool[v] = v;
        label[v] = 0;
    }
    while (n_parts) {
        n_parts--;
        const int64_t start = starts[n_parts], this = labels[n_parts], size = top - start;
        for (int64_t i = 0; i < size; i++) part[i] = pool[start + i];
        top = start;
        for (int64_t i = 0; i < size; i++) {
            if (label[part[i]] != this) continue;
            int64_t n = label_connected(g, label, order, part[i], n_labels);
            if (n > largest) {
                n = label_connected(g, label, order, order[n - 1], n_labels + 1);
                for (int64_t place = n / 2; place < n; place++) label[order[place]] = n_labels + 2;
                for (int64_t half = n_labels + 1; half < n_labels + 3; half++) {
                    starts[n_parts] = top;
                    labels[n_parts++] = half;
                    for (int64_t j = i; j < size; j++)
                        if (label[part[j]] == half) pool[top++] = part[j];
                }
            }
            n_labels += 3;
        }
    }
}

#endif
