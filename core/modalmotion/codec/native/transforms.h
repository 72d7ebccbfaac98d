/* Orthonormal cosine, sine and Fourier transforms of lines. docs/format.md, section 4.
 *
 * Short lines by the matrix, longer ones by a discrete Fourier transform of any length
 * (L. Bluestein, A linear filtering approach to the computation of discrete Fourier transform, IEEE
 * Transactions on Audio and Electroacoustics, 1970). */
#ifndef MM_TRANSFORMS_H
#define MM_TRANSFORMS_H

#include "coder.h"

enum { FROM_COSINES, FROM_SINES, ODD_SINES, TURN_BACK, N_TRANSFORMS };
enum { LONGEST_MATRIX = 256 };

/* cos(pi p / q), p of either sign. */
static double cosine(int64_t p, int64_t q) {
    p = (p < 0 ? -p : p) % (2 * q);
    if (p > q) p = 2 * q - p;
    double sign = 1.0;
    if (2 * p > q) {
        p = q - p;
        sign = -1.0;
    }
    const int is_low = 4 * p > q; /* nearer to 0: by the sine of what is left to a right angle */
    const double x = 3.14159265358979323846 * (is_low ? 0.5 * (double)(q - 2 * p) : (double)p) / (double)q;
    double term = is_low ? x : 1.0, sum = 0.0;
    for (int k = is_low; k < 24; k += 2) {
        sum += term;
        term *= -x * x / ((k + 1) * (k + 2));
    }
    return sign * sum;
}

static double sine(int64_t p, int64_t q) { return cosine(2 * p - q, 2 * q); }

/* Share of the input k in the output i. */
static double entry_of(int kind, int64_t n, int64_t i, int64_t k) {
    const double scale = __builtin_sqrt(2.0 / (double)n);
    switch (kind) {
    case FROM_COSINES:
        return k ? scale * cosine(k * (2 * i + 1), 2 * n) : __builtin_sqrt(1.0 / (double)n);
    case FROM_SINES:
        return (i % 2 ? -1.0 : 1.0) * entry_of(FROM_COSINES, n, i, n - 1 - k);
    case ODD_SINES:
        return scale * sine((2 * i + 1) * (2 * k + 1), 4 * n);
    default:
        if (!k || (n % 2 == 0 && k == n - 1))
            return (k && i % 2 ? -1.0 : 1.0) * __builtin_sqrt(1.0 / (double)n);
        return scale * (k % 2 ? cosine((k + 1) * i, n) : sine(k * i, n));
    }
}

typedef struct {
    double re, im;
} Complex;

static Complex product(Complex a, Complex b) {
    return (Complex){a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re};
}

/* Transform of a power of 2, in place; roots[k] = exp(2 pi i k / m). */
static void power_transform(Complex *z, int64_t m, const Complex *roots) {
    for (int64_t i = 1, j = 0; i < m; i++) {
        int64_t bit = m >> 1;
        for (; j & bit; bit >>= 1) j ^= bit;
        j ^= bit;
        if (i < j) {
            const Complex other = z[i];
            z[i] = z[j];
            z[j] = other;
        }
    }
    for (int64_t half = 1; half < m; half *= 2)
        for (int64_t start = 0; start < m; start += 2 * half)
            for (int64_t k = 0; k < half; k++) {
                const Complex a = z[start + k];
                const Complex b = product(z[start + k + half], roots[k * (m / (2 * half))]);
                z[start + k] = (Complex){a.re + b.re, a.im + b.im};
                z[start + k + half] = (Complex){a.re - b.re, a.im - b.im};
            }
}

/* A line's transform of one kind and length. */
typedef struct {
    int kind;
    int64_t n, m;          /* m: the power of 2, 0 for a matrix */
    double *matrix;
    Complex *roots, *chirp, *filter, *z;
} Transform;

static int64_t power_over(int64_t n) {
    int64_t m = 1;
    while (m < n) m *= 2;
    return m;
}

/* Length of the Fourier transform behind one of this kind. */
static int64_t points(int kind, int64_t n) { return kind == TURN_BACK ? n : 2 * n; }

static Transform take_transform(Room *room, int kind, int64_t n) {
    Transform t = {.kind = kind, .n = n};
    if (n <= LONGEST_MATRIX) {
        t.matrix = TAKE(room, double, n * n);
        for (int64_t i = 0; t.matrix && i < n; i++)
            for (int64_t k = 0; k < n; k++) t.matrix[i * n + k] = entry_of(kind, n, i, k);
        return t;
    }
    const int64_t p = points(kind, n);
    t.m = power_over(2 * p);
    t.roots = TAKE(room, Complex, t.m);
    t.chirp = TAKE(room, Complex, p);
    t.filter = TAKE(room, Complex, t.m);
    t.z = TAKE(room, Complex, t.m);
    if (!t.z) return t;
    for (int64_t k = 0; k < t.m; k++)
        t.roots[k] = (Complex){cosine(2 * k, t.m), sine(2 * k, t.m)};
    for (int64_t k = 0; k < p; k++) {
        const int64_t square = (int64_t)((uint64_t)k * (uint64_t)k % (uint64_t)(2 * p));
        t.chirp[k] = (Complex){cosine(square, p), sine(square, p)};
        const Complex back = {t.chirp[k].re, -t.chirp[k].im};
        t.filter[k] = back;
        if (k) t.filter[t.m - k] = back;
    }
    power_transform(t.filter, t.m, t.roots);
    return t;
}

/* sum over k of z[k] exp(2 pi i j k / p), in the first p of z; the others come as zeros. */
static void any_transform(const Transform *t, int64_t p) {
    Complex *z = t->z;
    for (int64_t k = 0; k < p; k++) z[k] = product(z[k], t->chirp[k]);
    power_transform(z, t->m, t->roots);
    for (int64_t k = 0; k < t->m; k++) {
        z[k] = product(z[k], t->filter[k]);
        z[k].im = -z[k].im;
    }
    power_transform(z, t->m, t->roots);
    for (int64_t k = 0; k < p; k++) {
        const Complex found = {z[k].re / (double)t->m, -z[k].im / (double)t->m};
        z[k] = product(found, t->chirp[k]);
    }
}

/* One long line, of so many numbers from one entry to the next. */
static void long_line(const Transform *t, const double *in, double *out, int64_t stride) {
    const int64_t n = t->n, p = points(t->kind, n);
    const double scale = __builtin_sqrt(1.0 / (double)n), both = __builtin_sqrt(2.0 / (double)n);
    Complex *z = t->z;
    memset(z, 0, (size_t)t->m * sizeof *z);
    if (t->kind == TURN_BACK) {
        z[0].re = scale * in[0];
        for (int64_t k = 1; k < n; k++) {
            const int64_t j = (k + 1) / 2;
            const int is_last = n % 2 == 0 && k == n - 1;
            if (is_last)
                z[j].re += scale * in[k * stride];
            else if (k % 2)
                z[j].re += both * in[k * stride];
            else
                z[j].im -= both * in[k * stride];
        }
    } else if (t->kind == ODD_SINES) {
        /* sin(pi (2 i + 1) (2 k + 1) / 4 n), of angles pi i k / n + pi (2 i + 2 k + 1) / 4 n */
        for (int64_t k = 0; k < n; k++)
            z[k] = (Complex){both * in[k * stride] * cosine(k, 2 * n),
                             both * in[k * stride] * sine(k, 2 * n)};
    } else {
        for (int64_t k = 0; k < n; k++) {
            const double x = in[(t->kind == FROM_SINES ? n - 1 - k : k) * stride];
            const double scaled = (k ? both : scale) * x;
            z[k] = (Complex){scaled * cosine(k, 2 * n), scaled * sine(k, 2 * n)};
        }
    }
    any_transform(t, p);
    for (int64_t i = 0; i < n; i++) {
        double x = z[i].re;
        if (t->kind == ODD_SINES) {
            const Complex turn = {cosine(2 * i + 1, 4 * n), sine(2 * i + 1, 4 * n)};
            x = product(z[i], turn).im;
        }
        out[i * stride] = t->kind == FROM_SINES && i % 2 ? -x : x;
    }
}

/* Transform columns first to last of an array (n, columns), in place; `spare` has n columns. */
static void transform(const Transform *t, double *array, int64_t columns, int64_t first,
                      int64_t last, double *spare) {
    if (t->m) {
        for (int64_t c = first; c < last; c++) {
            long_line(t, array + c, spare, columns);
            for (int64_t i = 0; i < t->n; i++) array[i * columns + c] = spare[i * columns];
        }
        return;
    }
    for (int64_t i = 0; i < t->n; i++) {
        double *to = spare + i * columns;
        for (int64_t c = first; c < last; c++) to[c] = 0.0;
        for (int64_t k = 0; k < t->n; k++) {
            const double share = t->matrix[i * t->n + k];
            const double *from = array + k * columns;
            for (int64_t c = first; c < last; c++) to[c] += share * from[c];
        }
    }
    for (int64_t i = 0; i < t->n; i++)
        for (int64_t c = first; c < last; c++) array[i * columns + c] = spare[i * columns + c];
}

#endif
