/* Modes of a lattice in closed form. docs/format.md, section 4. */
#ifndef MM_LATTICE_H
#define MM_LATTICE_H

#include "sorting.h"
#include "stream.h"
#include "transforms.h"

enum { OPEN_ENDS, CLOSED_ENDS, POLE_OPEN_ENDS, POLE_POLE_ENDS };

typedef struct {
    int64_t n_axes, ends[MOST_AXES], shape[MOST_AXES], fine[MOST_AXES], n_nodes;
    int64_t *order; /* number of the product of each mode */
} Lattice;

/* Quarter periods along an axis of its function i. */
static int64_t quarters(int is_closed, int64_t i) { return is_closed ? 4 * ((i + 1) / 2) : 2 * i; }

/* Whether what goes round the pole with the function i of the axis behind is odd there. */
static int is_odd(int64_t i) { return (int)((i + 1) / 2 % 2); }

static int read_lattice(Lattice *l, Bytes *b, int64_t n_vertices, Room *room) {
    l->n_axes = (int64_t)next_number(b, 1);
    if (l->n_axes < 1 || l->n_axes > 3) return NONSENSE;
    l->n_nodes = 1;
    for (int i = 0; i < l->n_axes; i++) {
        l->ends[i] = (int64_t)next_number(b, 1);
        l->fine[i] = (int64_t)next_number(b, 1);
        l->shape[i] = next_varint(b);
        if (l->ends[i] > POLE_POLE_ENDS || l->shape[i] < 1 || l->shape[i] > n_vertices)
            return NONSENSE;
        l->n_nodes *= l->shape[i];
        if (l->n_nodes > n_vertices) return NONSENSE;
    }
    for (int i = 0; i < l->n_axes; i++)
        if (l->ends[i] >= POLE_OPEN_ENDS &&
            (i + 1 >= l->n_axes || l->ends[i + 1] != CLOSED_ENDS || l->shape[i + 1] % 2))
            return NONSENSE;
    if (b->status || b->at != b->end || l->n_nodes != n_vertices) return NONSENSE;
    uint64_t *keys = TAKE(room, uint64_t, n_vertices);
    l->order = TAKE(room, int64_t, n_vertices);
    if (room->used > room->size) return ROOM;
    for (int64_t node = 0; node < n_vertices; node++) {
        int64_t key = 0, rest = node, index[3] = {0};
        for (int64_t i = l->n_axes - 1; i >= 0; i--) {
            index[i] = rest % l->shape[i];
            rest /= l->shape[i];
        }
        for (int i = 0; i < l->n_axes; i++) {
            int64_t along = quarters(l->ends[i] == CLOSED_ENDS, index[i]);
            if (l->ends[i] >= POLE_OPEN_ENDS)
                along += is_odd(index[i + 1]) * (l->ends[i] == POLE_OPEN_ENDS ? 1 : 2);
            key += l->fine[i] * along * l->fine[i] * along;
        }
        keys[node] = (uint64_t)key;
    }
    sort_places(keys, l->order, n_vertices, room);
    return room->used > room->size ? ROOM : FINE;
}

static int lattice_values(const Lattice *l, const double *numbers, int64_t n_rows, int64_t n_modes,
                          double *values, Room *room) {
    const int64_t used = room->used, n = l->n_nodes;
    /* The rows of one node after those of another: all lines are transformed side by side. */
    double *array = TAKE(room, double, n * n_rows), *spare = TAKE(room, double, n * n_rows);
    Transform even[3] = {0}, odd[3] = {0};
    for (int i = 0; i < l->n_axes; i++) {
        const int64_t ends = l->ends[i];
        even[i] = take_transform(room, ends == CLOSED_ENDS ? TURN_BACK : FROM_COSINES, l->shape[i]);
        if (ends >= POLE_OPEN_ENDS)
            odd[i] = take_transform(room, ends == POLE_OPEN_ENDS ? ODD_SINES : FROM_SINES,
                                    l->shape[i]);
    }
    if (room->used > room->size) return ROOM;
    for (int64_t mode = 0; mode < n_modes; mode++)
        for (int64_t row = 0; row < n_rows; row++)
            array[l->order[mode] * n_rows + row] = numbers[row * n_modes + mode];
    /* Open axes first: those with a pole depend on the turns around it. */
    for (int closed = 0; closed < 2; closed++)
        for (int64_t i = l->n_axes - 1; i >= 0; i--) {
            if ((l->ends[i] == CLOSED_ENDS) != closed) continue;
            int64_t columns = n_rows;
            for (int64_t j = i + 1; j < l->n_axes; j++) columns *= l->shape[j];
            const int64_t size = columns * l->shape[i];
            const int has_pole = l->ends[i] >= POLE_OPEN_ENDS;
            const int64_t each = has_pole ? columns / l->shape[i + 1] : columns;
            for (double *part = array; part < array + n * n_rows; part += size)
                for (int64_t c = 0; c < columns; c += each)
                    transform(has_pole && is_odd(c / each) ? odd + i : even + i, part, columns, c,
                              c + each, spare);
        }
    for (int64_t v = 0; v < n; v++)
        for (int64_t row = 0; row < n_rows; row++) values[row * n + v] = array[v * n_rows + row];
    room->used = used;
    return FINE;
}

#endif
