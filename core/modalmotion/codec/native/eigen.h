/* Eigenvectors of a dense symmetric matrix, the same bits everywhere.
 *
 * Householder's reduction to three diagonals, then implicit QL (H. Bowdler, R. S. Martin, C. Reinsch,
 * J. H. Wilkinson, The QR and QL algorithms for symmetric matrices, Numerische Mathematik, 1968). The
 * rotations are noted, and many applied to a few columns at a time, which stay in the cache. */
#ifndef MM_EIGEN_H
#define MM_EIGEN_H

#include "coder.h"

enum { WIDTH = 8, MOST_ROTATIONS = 1 << 15, MOST_SWEEPS = 60 };

typedef struct {
    int64_t row;
    double c, s;
} Rotation;

static double size_of_both(double a, double b) { return __builtin_sqrt(a * a + b * b); }
static double positive(double x) { return x < 0.0 ? -x : x; }

/* Take v w' + w v' off a row right of its place, and multiply what is left with the next v.
 *
 * The sums of a row are kept in eight, so that they are the same however they are computed. */
static double update_row(double *at, int64_t from, int64_t n, double a, double b, const double *v,
                         const double *w, const double *next, double share, double *p) {
    double sums[WIDTH] = {0};
    int64_t j = from;
    for (; j + WIDTH <= n; j += WIDTH)
        for (int i = 0; i < WIDTH; i++) {
            const double left = at[j + i] - a * w[j + i] - b * v[j + i];
            at[j + i] = left;
            p[j + i] += share * left;
            sums[i] += left * next[j + i];
        }
    for (int i = 0; j < n; j++, i++) {
        const double left = at[j] - a * w[j] - b * v[j];
        at[j] = left;
        p[j] += share * left;
        sums[i] += left * next[j];
    }
    return sums[0] + sums[1] + sums[2] + sums[3] + (sums[4] + sums[5] + sums[6] + sums[7]);
}

/* Reduce the upper half of A, (n, n), to a diagonal and what is beside it.
 *
 * A becomes the transformation: the vector of the place k is row k of it, before the rotations. */
static void reduce(double *A, int64_t n, double *diagonal, double *beside, double *room) {
    double *v = room, *w = room + n, *p = room + 2 * n, *next = room + 3 * n;
    for (int64_t i = 0; i < 4 * n; i++) room[i] = 0.0;
    for (int64_t k = 0; k < n; k++) {
        double *row = A + k * n, square = 0.0;
        for (int64_t j = k; j < n; j++) row[j] -= v[k] * w[j] + w[k] * v[j];
        diagonal[k] = row[k];
        beside[k] = 0.0;
        if (k + 1 >= n) break;
        for (int64_t j = k + 1; j < n; j++) square += row[j] * row[j];
        double alpha = __builtin_sqrt(square);
        if (row[k + 1] > 0.0) alpha = -alpha;
        beside[k] = alpha;
        const double half = square - alpha * row[k + 1]; /* |v|^2 / 2 */
        for (int64_t j = 0; j < n; j++) {
            next[j] = j > k && half > 0.0 ? row[j] : 0.0;
            p[j] = 0.0;
        }
        if (half > 0.0) next[k + 1] -= alpha;
        for (int64_t i = k + 1; i < n; i++) {
            double *at = A + i * n;
            at[i] -= 2.0 * v[i] * w[i];
            p[i] += next[i] * at[i];
            p[i] += update_row(at, i + 1, n, v[i], w[i], v, w, next, next[i], p);
        }
        double along = 0.0;
        for (int64_t j = k + 1; j < n; j++) along += next[j] * p[j];
        along /= half > 0.0 ? 2.0 * half * half : 1.0;
        for (int64_t j = 0; j < n; j++) {
            v[j] = next[j];
            w[j] = half > 0.0 ? p[j] / half - along * v[j] : 0.0;
        }
        /* Kept in the row, of unit energy, for the transformation. */
        const double unit = half > 0.0 ? __builtin_sqrt(1.0 / half) : 0.0;
        for (int64_t j = k + 1; j < n; j++) row[j] = v[j] * unit;
    }
    /* Product of the reflections, the last first; each row of A gives way to one of it. */
    for (int64_t k = n - 1; k >= 0; k--) {
        double *row = A + k * n;
        for (int64_t j = 0; j < n; j++) {
            v[j] = j > k ? row[j] : 0.0;
            p[j] = 0.0;
            row[j] = j == k ? 1.0 : 0.0;
        }
        for (int64_t i = k + 1; i < n; i++) {
            double *at = A + i * n;
            at[k] = 0.0;
            for (int64_t j = k + 1; j < n; j++) p[j] += v[i] * at[j];
        }
        for (int64_t i = k + 1; i < n; i++) {
            double *at = A + i * n;
            for (int64_t j = k + 1; j < n; j++) at[j] -= v[i] * p[j];
        }
    }
}

/* Apply rotations of neighbouring rows to blocks of columns, (blocks, n, WIDTH). */
static void rotate(double *blocks, int64_t n, const Rotation *rotations, int64_t n_rotations) {
    for (int64_t block = 0; block < (n + WIDTH - 1) / WIDTH; block++) {
        double *z = blocks + block * n * WIDTH;
        for (int64_t i = 0; i < n_rotations; i++) {
            const double c = rotations[i].c, s = rotations[i].s;
            double *low = z + rotations[i].row * WIDTH, *high = low + WIDTH;
            for (int j = 0; j < WIDTH; j++) {
                const double a = low[j], b = high[j];
                high[j] = s * a + c * b;
                low[j] = c * a - s * b;
            }
        }
    }
}

/* Eigenvalues of A, ascending, and its eigenvectors in the rows of A. */
static int solve_symmetric(double *A, int64_t n, double *values, Room *room) {
    const int64_t used = room->used, n_blocks = (n + WIDTH - 1) / WIDTH;
    double *d = TAKE(room, double, n + 1), *e = TAKE(room, double, n + 1);
    double *vectors = TAKE(room, double, 4 * n), *blocks = TAKE(room, double, n_blocks * n * WIDTH);
    Rotation *rotations = TAKE(room, Rotation, MOST_ROTATIONS + n);
    int64_t *order = TAKE(room, int64_t, n), n_rotations = 0;
    if (room->used > room->size) return ROOM;
    reduce(A, n, d, e, vectors);
    /* Component j of the vector i: the transposed transformation, which is that of its columns. */
    for (int64_t i = 0; i < n; i++)
        for (int64_t j = 0; j < n; j++)
            blocks[(i / WIDTH * n + j) * WIDTH + i % WIDTH] = A[i * n + j];
    double shift = 0.0, largest = 0.0;
    for (int64_t l = 0; l < n; l++) {
        const double here = positive(d[l]) + positive(e[l]);
        if (here > largest) largest = here;
        int64_t m = l;
        while (m < n - 1 && positive(e[m]) > 0x1p-53 * largest) m++;
        for (int sweep = 0; m > l && sweep < MOST_SWEEPS; sweep++) {
            double g = d[l], p = (d[l + 1] - g) / (2.0 * e[l]), r = size_of_both(p, 1.0);
            if (p < 0.0) r = -r;
            d[l] = e[l] / (p + r);
            d[l + 1] = e[l] * (p + r);
            const double next = d[l + 1], h = g - d[l];
            for (int64_t i = l + 2; i < n; i++) d[i] -= h;
            shift += h;
            p = d[m];
            double c = 1.0, c2 = 1.0, c3 = 1.0, s = 0.0, s2 = 0.0;
            const double first = e[l + 1];
            for (int64_t i = m - 1; i >= l; i--) {
                c3 = c2;
                c2 = c;
                s2 = s;
                g = c * e[i];
                const double scaled = c * p;
                r = size_of_both(p, e[i]);
                e[i + 1] = s * r;
                s = e[i] / r;
                c = p / r;
                p = c * d[i] - s * g;
                d[i + 1] = scaled + s * (c * g + s * d[i]);
                rotations[n_rotations++] = (Rotation){i, c, s};
            }
            p = -s * s2 * c3 * first * e[l] / next;
            e[l] = s * p;
            d[l] = c * p;
            if (n_rotations >= MOST_ROTATIONS) {
                rotate(blocks, n, rotations, n_rotations);
                n_rotations = 0;
            }
            if (positive(e[l]) <= 0x1p-53 * largest) break;
        }
        d[l] += shift;
        e[l] = 0.0;
    }
    rotate(blocks, n, rotations, n_rotations);
    for (int64_t i = 0; i < n; i++) {
        int64_t at = i;
        for (; at > 0 && d[order[at - 1]] > d[i]; at--) order[at] = order[at - 1];
        order[at] = i;
    }
    for (int64_t i = 0; i < n; i++) {
        values[i] = d[order[i]];
        for (int64_t j = 0; j < n; j++)
            A[i * n + j] = blocks[(j / WIDTH * n + order[i]) * WIDTH + j % WIDTH];
    }
    room->used = used;
    return FINE;
}

#endif
