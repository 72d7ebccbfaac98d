/* Spring modes of a mesh in patches, joined from those of leaves. docs/format.md, section 4. */
#ifndef MM_SPRINGS_H
#define MM_SPRINGS_H

#include "eigen.h"
#include "mesh.h"

enum { LARGEST_PATCH = 4096 };

static const double MOST_WORK = 2.0e11, NEAREST = 0.3;

/* Part of each vertex, counted by their lowest vertex; the vertices part after part. */
typedef struct {
    int64_t n, *owner, *starts, *vertices;
} Parting;

/* Between vertices with the same owner, if there are owners; all else is cut. */
static int part_graph(Parting *p, const Graph *g, const int64_t *owner, int64_t largest,
                      Room *room) {
    const int64_t n = g->n;
    p->owner = TAKE(room, int64_t, n);
    p->starts = TAKE(room, int64_t, n + 1);
    p->vertices = TAKE(room, int64_t, n);
    const int64_t used = room->used;
    int64_t *offsets = TAKE(room, int64_t, n + 1), *names = TAKE(room, int64_t, 6 * n + 6);
    int64_t *neighbours = TAKE(room, int64_t, g->offsets[n]), *spare = TAKE(room, int64_t, 5 * n + 2);
    if (room->used > room->size) return ROOM;
    int64_t at = 0;
    for (int64_t v = 0; v < n; v++) {
        for (int64_t i = g->offsets[v]; i < g->offsets[v + 1]; i++)
            if (!owner || owner[g->neighbours[i]] == owner[v]) neighbours[at++] = g->neighbours[i];
        offsets[v + 1] = at;
    }
    const Graph inside = {n, offsets, neighbours};
    halve(&inside, largest, p->owner, spare, spare + n, spare + 2 * n, spare + 3 * n,
          spare + 4 * n + 1);
    for (int64_t i = 0; i < 6 * n + 6; i++) names[i] = -1;
    for (int64_t v = 0; v < n; v++) {
        /* Three labels for each part and each cut, of which there are fewer than vertices. */
        int64_t *name = names + p->owner[v];
        if (*name < 0) *name = p->n++;
        p->owner[v] = *name;
        p->starts[*name + 1]++;
    }
    for (int64_t i = 0; i < p->n; i++) p->starts[i + 1] += p->starts[i];
    for (int64_t v = 0; v < n; v++) p->vertices[p->starts[p->owner[v]]++] = v;
    for (int64_t i = p->n; i > 0; i--) p->starts[i] = p->starts[i - 1];
    p->starts[0] = 0;
    room->used = used;
    return FINE;
}

/* A number in [0, 1) that looks random. */
static double scattered(uint64_t number, uint64_t seed) {
    uint64_t mixed = (number + 977 * seed + 1) * 2654435761u;
    mixed = (mixed ^ mixed >> 15) * 2246822519u & UINT32_MAX;
    mixed = (mixed ^ mixed >> 13) * 3266489917u & UINT32_MAX;
    return (double)(mixed >> 8) / 16777216.0;
}

/* Order the modes of several parts by their rank in a part over its size. */
static int rank_modes(const int64_t *starts, int64_t n_parts, int64_t *order, Room *room) {
    const int64_t used = room->used, n = starts[n_parts] - starts[0];
    uint64_t *keys = TAKE(room, uint64_t, n);
    if (room->used > room->size) return ROOM;
    for (int64_t part = 0, at = 0; part < n_parts; part++) {
        const int64_t size = starts[part + 1] - starts[part];
        for (int64_t rank = 0; rank < size; rank++)
            keys[at++] = rank ? (uint64_t)((2 * rank + 1) * (1 << 30) / size) + 1 : 0;
    }
    sort_places(keys, order, n, room);
    if (room->used > room->size) return ROOM;
    room->used = used;
    return FINE;
}

typedef struct {
    int64_t n, n_low; /* vertices, and modes that are joined */
    int64_t *places;  /* of its vertices in the patch */
    double *modes, *squares; /* modes in rows */
} Leaf;

typedef struct {
    int64_t leaf[2], place[2];
    double stiffness;
} Spring;

/* Spring modes of one patch: `turn` and `tilt` only if there are several leaves. */
typedef struct {
    int64_t n, n_leaves, n_joined, n_tilted, *ranks;
    Leaf *leaves;
    double *turn; /* joined modes in rows */
    double *tilt; /* (left over, tilted), half of what is added */
    double *core; /* (tilted, tilted), its Cholesky factor */
} Patch;

/* Turn modes so that their sum with the signs is positive. */
static void fix_signs(double *modes, int64_t n, const double *signs) {
    for (int64_t i = 0; i < n; i++) {
        double sum = 0.0, *row = modes + i * n;
        for (int64_t j = 0; j < n; j++) sum += signs[j] * row[j];
        for (int64_t j = 0; sum < 0.0 && j < n; j++) row[j] = -row[j];
    }
}

/* Lower factor of I + Y' Y, in place of it. */
static void factor_core(double *core, const double *Y, int64_t n_rows, int64_t k) {
    for (int64_t i = 0; i < k; i++)
        for (int64_t j = 0; j < k; j++) core[i * k + j] = i == j ? 1.0 : 0.0;
    for (int64_t row = 0; row < n_rows; row++)
        for (int64_t i = 0; i < k; i++) {
            const double share = Y[row * k + i];
            for (int64_t j = 0; j <= i; j++) core[i * k + j] += share * Y[row * k + j];
        }
    /* Column by column, so that what is left of the others is updated along rows. */
    for (int64_t c = 0; c < k; c++) {
        const double pivot = __builtin_sqrt(core[c * k + c]);
        for (int64_t i = c; i < k; i++) core[i * k + c] /= pivot;
        for (int64_t i = c + 1; i < k; i++) {
            const double share = core[i * k + c];
            /* The column c, by the row that mirrors it. */
            core[c * k + i] = share;
        }
        for (int64_t i = c + 1; i < k; i++) {
            const double share = core[c * k + i];
            for (int64_t j = c + 1; j <= i; j++) core[i * k + j] -= share * core[c * k + j];
        }
    }
}

/* Solve core x = x for many right-hand sides, (k, n), in place. */
static void solve_core(const double *core, int64_t k, double *x, int64_t n) {
    for (int64_t i = 0; i < k; i++) {
        for (int64_t j = 0; j < i; j++) {
            const double share = core[i * k + j];
            for (int64_t c = 0; c < n; c++) x[i * n + c] -= share * x[j * n + c];
        }
        for (int64_t c = 0; c < n; c++) x[i * n + c] /= core[i * k + i];
    }
    for (int64_t i = k - 1; i >= 0; i--) {
        for (int64_t j = i + 1; j < k; j++) {
            const double share = core[j * k + i];
            for (int64_t c = 0; c < n; c++) x[i * n + c] -= share * x[j * n + c];
        }
        for (int64_t c = 0; c < n; c++) x[i * n + c] /= core[i * k + i];
    }
}

typedef struct {
    const Graph *g;
    Parting patches, leaves;
    int64_t *order, share;
    int64_t *place, *leaf_of; /* of the vertices of the patch that is solved */
    Patch *solved;
} Springs;

/* Join the lowest modes of the leaves of a patch. */
static int join_leaves(Patch *p, const Spring *across, int64_t n_across, const double *sums,
                       Room *room) {
    const int64_t c = p->n_joined, k = c / 2, n_high = p->n - c;
    p->turn = TAKE(room, double, c * c);
    p->tilt = TAKE(room, double, n_high * k);
    p->core = TAKE(room, double, k * k);
    const int64_t used = room->used;
    double *squares = TAKE(room, double, c), *left = TAKE(room, double, n_high + 1);
    double *pull = TAKE(room, double, c), *force = TAKE(room, double, (n_across + 1) * (k + 1));
    int64_t *low = TAKE(room, int64_t, p->n_leaves + 1), *high = TAKE(room, int64_t, p->n_leaves + 1);
    if (room->used > room->size) return ROOM;
    double *A = p->turn;
    for (int64_t i = 0; i < p->n_leaves; i++) {
        const Leaf *leaf = p->leaves + i;
        low[i + 1] = low[i] + leaf->n_low;
        high[i + 1] = high[i] + leaf->n - leaf->n_low;
        for (int64_t j = 0; j < leaf->n_low; j++) A[(low[i] + j) * (c + 1)] = leaf->squares[j];
        for (int64_t j = leaf->n_low; j < leaf->n; j++)
            left[high[i] + j - leaf->n_low] = leaf->squares[j];
    }
    for (int64_t s = 0; s < n_across; s++) {
        const Spring *spring = across + s;
        for (int end = 0; end < 2; end++) {
            const Leaf *leaf = p->leaves + spring->leaf[end];
            for (int64_t j = 0; j < leaf->n_low; j++)
                pull[low[spring->leaf[end]] + j] =
                    (end ? -1.0 : 1.0) * leaf->modes[j * leaf->n + spring->place[end]];
            for (int64_t j = leaf->n_low; j < leaf->n; j++) {
                const double value = leaf->modes[j * leaf->n + spring->place[end]];
                left[high[spring->leaf[end]] + j - leaf->n_low] += spring->stiffness * value * value;
            }
        }
        for (int end = 0; end < 2; end++)
            for (int other = 0; other < 2; other++) {
                const int64_t a = spring->leaf[end], b = spring->leaf[other];
                for (int64_t i = low[a]; i < low[a + 1]; i++) {
                    const double share = spring->stiffness * pull[i];
                    for (int64_t j = low[b]; j < low[b + 1]; j++) A[i * c + j] += share * pull[j];
                }
            }
    }
    if (solve_symmetric(A, c, squares, room)) return ROOM;
    fix_signs(A, c, sums);
    p->n_tilted = n_high ? k : 0;
    double mean = 0.0;
    for (int64_t i = 0; i < n_high; i++) mean += left[i] / (double)n_high;
    for (int64_t s = 0; s < n_across && p->n_tilted; s++) {
        const Spring *spring = across + s;
        for (int64_t j = 0; j < k; j++) force[j] = 0.0;
        for (int end = 0; end < 2; end++) {
            const Leaf *leaf = p->leaves + spring->leaf[end];
            for (int64_t j = 0; j < k; j++) {
                const double *joined = A + j * c + low[spring->leaf[end]];
                double sum = 0.0;
                for (int64_t m = 0; m < leaf->n_low; m++)
                    sum += leaf->modes[m * leaf->n + spring->place[end]] * joined[m];
                force[j] += end ? -sum : sum;
            }
        }
        for (int end = 0; end < 2; end++) {
            const Leaf *leaf = p->leaves + spring->leaf[end];
            for (int64_t m = leaf->n_low; m < leaf->n; m++) {
                double *row = p->tilt + (high[spring->leaf[end]] + m - leaf->n_low) * k;
                const double share = (end ? -1.0 : 1.0) * spring->stiffness *
                                     leaf->modes[m * leaf->n + spring->place[end]];
                for (int64_t j = 0; j < k; j++) row[j] += share * force[j];
            }
        }
    }
    for (int64_t i = 0; i < n_high; i++)
        for (int64_t j = 0; j < p->n_tilted; j++) {
            const double distance = left[i] - squares[j], nearest = NEAREST * mean;
            p->tilt[i * k + j] *= -0.5 / (distance > nearest ? distance : nearest);
        }
    if (p->n_tilted) factor_core(p->core, p->tilt, n_high, k);
    room->used = used;
    return FINE;
}

/* Solve for the modes of one patch. */
static int solve_patch(const Springs *s, int64_t number, Room *room) {
    Patch *p = s->solved + number;
    const Graph *g = s->g;
    const int64_t *vertices = s->patches.vertices + s->patches.starts[number];
    p->n = s->patches.starts[number + 1] - s->patches.starts[number];
    int64_t n_modes = 0;
    /* Leaves come by their lowest vertex: those of a patch are found along its vertices. */
    int64_t *names = TAKE(room, int64_t, p->n), *place = s->place, *leaf_of = s->leaf_of;
    if (room->used > room->size) return ROOM;
    for (int64_t i = 0; i < p->n; i++) {
        const int64_t leaf = s->leaves.owner[vertices[i]], first = s->leaves.starts[leaf];
        if (s->leaves.vertices[first] == vertices[i]) names[p->n_leaves++] = leaf;
    }
    p->leaves = TAKE(room, Leaf, p->n_leaves);
    int64_t *starts = TAKE(room, int64_t, p->n_leaves + 1), *order = TAKE(room, int64_t, p->n);
    p->ranks = TAKE(room, int64_t, p->n);
    double *sums = TAKE(room, double, p->n);
    if (room->used > room->size) return ROOM;
    for (int64_t i = 0; i < p->n; i++) place[vertices[i]] = i;
    for (int64_t i = 0; i < p->n_leaves; i++) {
        Leaf *leaf = p->leaves + i;
        const int64_t *own = s->leaves.vertices + s->leaves.starts[names[i]];
        leaf->n = s->leaves.starts[names[i] + 1] - s->leaves.starts[names[i]];
        leaf->places = TAKE(room, int64_t, leaf->n);
        leaf->modes = TAKE(room, double, leaf->n * leaf->n);
        leaf->squares = TAKE(room, double, leaf->n);
        if (room->used > room->size) return ROOM;
        starts[i + 1] = starts[i] + leaf->n;
        for (int64_t j = 0; j < leaf->n; j++) {
            leaf->places[j] = place[own[j]];
            leaf_of[own[j]] = i;
        }
    }
    p->n_joined = p->n;
    if (p->n_leaves > 1) p->n_joined = most(p->n_leaves, least(p->n, p->n * s->share / 256));
    if (rank_modes(starts, p->n_leaves, order, room)) return ROOM;
    for (int64_t rank = 0; rank < p->n; rank++) {
        int64_t leaf = 0;
        while (starts[leaf + 1] <= order[rank]) leaf++;
        if (rank < p->n_joined)
            p->leaves[leaf].n_low++;
        else
            p->ranks[order[rank]] = rank - p->n_joined;
    }
    /* Ranks of those left over alone, leaf after leaf. */
    for (int64_t i = 0, at = 0; i < p->n_leaves; i++)
        for (int64_t j = p->leaves[i].n_low; j < p->leaves[i].n; j++)
            p->ranks[at++] = p->ranks[starts[i] + j];
    /* Places within leaves from here on. */
    for (int64_t i = 0; i < p->n_leaves; i++) {
        const int64_t *own = s->leaves.vertices + s->leaves.starts[names[i]];
        for (int64_t j = 0; j < p->leaves[i].n; j++) place[own[j]] = j;
    }
    int64_t n_across = 0, most_across = 0;
    for (int64_t i = 0; i < p->n; i++)
        most_across += g->offsets[vertices[i] + 1] - g->offsets[vertices[i]];
    Spring *across = TAKE(room, Spring, most_across);
    double *signs = TAKE(room, double, p->n);
    if (room->used > room->size) return ROOM;
    for (int64_t i = 0; i < p->n_leaves; i++) {
        Leaf *leaf = p->leaves + i;
        const int64_t *own = s->leaves.vertices + s->leaves.starts[names[i]];
        for (int64_t j = 0; j < leaf->n; j++) {
            const int64_t a = own[j];
            signs[j] = scattered((uint64_t)a, 1) - 0.5;
            for (int64_t at = g->offsets[a]; at < g->offsets[a + 1]; at++) {
                const int64_t b = g->neighbours[at];
                if (b < a || s->patches.owner[b] != number) continue;
                const uint64_t both = (uint64_t)a << 20;
                const double k = 1.0 + scattered(both + (uint64_t)b, 0) / 8.0;
                if (leaf_of[b] != i) {
                    across[n_across++] = (Spring){{i, leaf_of[b]}, {j, place[b]}, k};
                    continue;
                }
                leaf->modes[j * leaf->n + place[b]] = leaf->modes[place[b] * leaf->n + j] = -k;
            }
        }
        for (int64_t j = 0; j < leaf->n; j++) {
            double *row = leaf->modes + j * leaf->n, sum = 0.0;
            for (int64_t m = 0; m < leaf->n; m++) sum += row[m];
            row[j] = -sum;
        }
        if (solve_symmetric(leaf->modes, leaf->n, leaf->squares, room)) return ROOM;
        fix_signs(leaf->modes, leaf->n, signs);
        for (int64_t m = 0; m < leaf->n_low; m++, n_modes++)
            for (int64_t j = 0; j < leaf->n; j++)
                sums[n_modes] += signs[j] * leaf->modes[m * leaf->n + j];
    }
    return p->n_leaves > 1 ? join_leaves(p, across, n_across, sums, room) : FINE;
}

static int read_springs(Springs *s, Bytes *b, const Graph *g, Room *room) {
    const int64_t n = g->n;
    s->g = g;
    int64_t patch = next_varint(b), leaf = next_varint(b);
    s->share = (int64_t)next_number(b, 1);
    if (b->status || b->at != b->end || leaf < 1 || leaf > patch) return NONSENSE;
    patch = least(patch, n);
    leaf = least(leaf, n);
    double joined = 0.0;
    if (leaf < patch)
        joined = (double)most((2 * patch + leaf - 1) / leaf, least(patch, patch * s->share / 256));
    const double work = (double)leaf * (double)leaf + joined * joined * joined / (double)patch;
    if (patch > LARGEST_PATCH || work * (double)n > MOST_WORK) return TOO_MANY;
    if (part_graph(&s->patches, g, 0, patch, room)) return ROOM;
    if (part_graph(&s->leaves, g, s->patches.owner, leaf, room)) return ROOM;
    s->solved = TAKE(room, Patch, s->patches.n);
    s->order = TAKE(room, int64_t, n);
    s->place = TAKE(room, int64_t, n);
    s->leaf_of = TAKE(room, int64_t, n);
    if (room->used > room->size) return ROOM;
    for (int64_t i = 0; i < s->patches.n; i++)
        if (solve_patch(s, i, room)) return ROOM;
    return rank_modes(s->patches.starts, s->patches.n, s->order, room);
}

/* Values of a patch, (rows, n), of coefficients, (n, rows). */
static void patch_values(const Patch *p, double *numbers, int64_t n_rows, double *upper,
                         double *joined, double *values) {
    const int64_t c = p->n_joined, k = p->n_tilted, n_high = p->n - c;
    for (int64_t i = 0; i < n_high; i++)
        memcpy(upper + i * n_rows, numbers + (c + p->ranks[i]) * n_rows,
               (size_t)n_rows * sizeof *upper);
    if (k) {
        double *u = joined; /* (k, rows): first the right-hand side */
        memcpy(u, numbers, (size_t)(k * n_rows) * sizeof *u);
        for (int64_t i = 0; i < n_high; i++)
            for (int64_t j = 0; j < k; j++) {
                const double share = p->tilt[i * k + j];
                for (int64_t row = 0; row < n_rows; row++)
                    u[j * n_rows + row] -= share * upper[i * n_rows + row];
            }
        solve_core(p->core, k, u, n_rows);
        for (int64_t i = 0; i < n_high; i++)
            for (int64_t j = 0; j < k; j++) {
                const double share = 2.0 * p->tilt[i * k + j];
                for (int64_t row = 0; row < n_rows; row++)
                    upper[i * n_rows + row] += share * u[j * n_rows + row];
            }
        for (int64_t i = 0; i < k * n_rows; i++) numbers[i] = 2.0 * u[i] - numbers[i];
    }
    const double *lower = numbers;
    if (p->turn) {
        for (int64_t i = 0; i < c * n_rows; i++) joined[i] = 0.0;
        for (int64_t j = 0; j < c; j++)
            for (int64_t i = 0; i < c; i++) {
                const double share = p->turn[j * c + i];
                for (int64_t row = 0; row < n_rows; row++)
                    joined[i * n_rows + row] += share * numbers[j * n_rows + row];
            }
        lower = joined;
    }
    for (int64_t i = 0; i < p->n_leaves; i++) {
        const Leaf *leaf = p->leaves + i;
        for (int64_t j = 0; j < leaf->n; j++) {
            double *to = values + leaf->places[j] * n_rows;
            for (int64_t row = 0; row < n_rows; row++) to[row] = 0.0;
            for (int64_t m = 0; m < leaf->n; m++) {
                const double share = leaf->modes[m * leaf->n + j];
                const double *from = m < leaf->n_low ? lower + m * n_rows
                                                     : upper + (m - leaf->n_low) * n_rows;
                for (int64_t row = 0; row < n_rows; row++) to[row] += share * from[row];
            }
        }
        lower += leaf->n_low * n_rows;
        upper += (leaf->n - leaf->n_low) * n_rows;
    }
}

static int spring_values(const Springs *s, const double *numbers, int64_t n_rows, int64_t n_modes,
                         double *values, Room *room) {
    const int64_t used = room->used, n = s->g->n;
    double *flat = TAKE(room, double, n * n_rows), *upper = TAKE(room, double, n * n_rows);
    double *joined = TAKE(room, double, n * n_rows), *found = TAKE(room, double, n * n_rows);
    if (room->used > room->size) return ROOM;
    for (int64_t mode = 0; mode < n_modes; mode++)
        for (int64_t row = 0; row < n_rows; row++)
            flat[s->order[mode] * n_rows + row] = numbers[row * n_modes + mode];
    for (int64_t i = 0; i < s->patches.n; i++) {
        const int64_t start = s->patches.starts[i];
        patch_values(s->solved + i, flat + start * n_rows, n_rows, upper, joined, found);
        for (int64_t j = 0; j < s->solved[i].n; j++)
            for (int64_t row = 0; row < n_rows; row++)
                values[row * n + s->patches.vertices[start + j]] = found[j * n_rows + row];
    }
    room->used = used;
    return FINE;
}

#endif
