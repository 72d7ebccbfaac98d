/* Eigenvectors of a dense symmetric matrix, the same bits everywhere.
 *
 * Householder's reduction to three diagonals, then implicit QL (H. Bowdler, R. S. Martin, C. Reinsch,
 * J. H. Wilkinson, The QR and QL algorithms for symmetric matrices, Numerische Mathematik, 1968). The
 * rotations are noted, and many applied to a few columns at a time, which stay in the cache. */
#ifndef MM_EIGEN_H
#define MM_EIGEN_H

#include "coder.h"

enum { WIDTH = 16, MOST_ROTATIONS = 1 << 15, MOST_SWEEPS = 60 };

typedef struct {
    int64_t row;
    double c, s;
} Rotation;

static double size_of_both(double a, double b) { return __builtin_sqrt(a * a + b * b); }
static double positive(double x) { return x < 0.0 ? -x : x; }

/* Reduce A, (n, n), to a diagonal and what is beside it.
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
        /* Take the reflection before off what is left, and multiply that with the next one. */
        for (int64_t i = k + 1; i < n; i++) {
            double *at = A + i * n;
            const double a = v[i], b = w[i], share = next[i];
            for (int64_t j = k + 1; j < n; j++) {
                at[j] -= a * w[j] + b * v[j];
                p[j] += share * at[j];
            }
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

/* Rotate neighbouring rows of a matrix, (n, n). */
static void rotate(double *matrix, int64_t n, const Rotation *rotations, int64_t n_rotations) {
    for (int64_t start = 0; start < n; start += WIDTH) {
        const int64_t width = least(WIDTH, n - start);
        for (int64_t i = 0; i < n_rotations; i++) {
            const double c = rotations[i].c, s = rotations[i].s;
            double *low = matrix + rotations[i].row * n + start, *high = low + n;
            for (int64_t j = 0; j < width; j++) {
                const double a = low[j], b = high[j];
                high[j] = s * a + c * b;
                low[j] = c * a - s * b;
            }
        }
    }
}

/* Eigenvalues of A, ascending, and its eigenvectors in the rows of A. */
static int solve_symmetric(double *A, int64_t n, double *values, Room *room) {
    const int64_t used = room->used;
    double *d = TAKE(room, double, n + 1), *e = TAKE(room, double, n + 1);
    double *spare = TAKE(room, double, 4 * n), *vectors = TAKE(room, double, n * n);
    Rotation *rotations = TAKE(room, Rotation, MOST_ROTATIONS + n);
    int64_t *order = TAKE(room, int64_t, n), n_rotations = 0;
    if (room->used > room->size) return ROOM;
    reduce(A, n, d, e, spare);
    for (int64_t i = 0; i < n; i++)
        for (int64_t j = 0; j < n; j++) vectors[j * n + i] = A[i * n + j];
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
                rotate(vectors, n, rotations, n_rotations);
                n_rotations = 0;
            }
            if (positive(e[l]) <= 0x1p-53 * largest) break;
        }
        d[l] += shift;
        e[l] = 0.0;
    }
    rotate(vectors, n, rotations, n_rotations);
    for (int64_t i = 0; i < n; i++) {
        int64_t at = i;
        for (; at > 0 && d[order[at - 1]] > d[i]; at--) order[at] = order[at - 1];
        order[at] = i;
    }
    for (int64_t i = 0; i < n; i++) {
        values[i] = d[order[i]];
        memcpy(A + i * n, vectors + order[i] * n, (size_t)n * sizeof *A);
    }
    room->used = used;
    return FINE;
}

#endif
