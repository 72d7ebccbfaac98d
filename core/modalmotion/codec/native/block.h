/* Blocks: frames that are coded on their own. docs/format.md, sections 5 and 6. */
#ifndef MM_BLOCK_H
#define MM_BLOCK_H

#include "lattice.h"
#include "mixed.h"
#include "springs.h"

enum { BY_COSINES, BY_TRAJECTORIES, BY_PARTS, N_KINDS };
enum { LATTICE_MODES = 1, SPRING_MODES = 2, N_FUNCTIONS = 4, MOST_PARTS = 256 };

static const double MOST_QUANTA = 0x1p51;

typedef struct {
    int kind;
    const Graph *mesh;
    Lattice lattice;
    Springs springs;
} Modes;

static int read_modes(Modes *m, Bytes b, const Graph *mesh, Room *room) {
    m->mesh = mesh;
    m->kind = (int)next_number(&b, 1);
    if (m->kind == LATTICE_MODES) return read_lattice(&m->lattice, &b, mesh->n, room);
    if (m->kind == SPRING_MODES) return read_springs(&m->springs, &b, mesh, room);
    return m->kind ? NONSENSE : STORED_WHOLE;
}

/* Values, (rows, vertices), of coefficients, (rows, modes). */
static int values_of(const Modes *m, const double *numbers, int64_t n_rows, int64_t n_modes,
                     double *values, Room *room) {
    if (m->kind == LATTICE_MODES)
        return lattice_values(&m->lattice, numbers, n_rows, n_modes, values, room);
    return spring_values(&m->springs, numbers, n_rows, n_modes, values, room);
}

typedef struct {
    int kind, is_mixed;
    uint32_t checksum;
    int64_t n_frames, n_vertices, exponent, origin[3], width, n_rows, n_modes, n_components;
    int64_t largest, n_parts;
    double step, shifts[4];
} Block;

static Block read_block_head(Bytes *s, int64_t n_frames, int64_t n_vertices) {
    Block b = {.n_frames = n_frames, .n_vertices = n_vertices};
    b.checksum = (uint32_t)next_number(s, 4);
    b.kind = (int)next_number(s, 1);
    b.step = next_single(s);
    for (int i = 1; i < 4; i++) b.shifts[i] = (double)(int8_t)next_number(s, 1) / 256.0;
    b.exponent = next_signed(s);
    for (int i = 0; i < 3; i++) b.origin[i] = next_signed(s);
    b.width = next_varint(s);
    b.n_rows = next_varint(s);
    b.n_modes = next_varint(s);
    b.n_components = next_varint(s);
    b.is_mixed = (int)next_number(s, 1);
    const int is_closed = b.kind == BY_COSINES;
    int is_wrong = b.kind >= N_KINDS || !(b.step > 0.0) || b.step > 0x1p127 * 2.0 ||
                   b.exponent < -1074 || b.exponent > 1023 || b.width > 1ll << 51 ||
                   b.n_rows > 3 * n_frames + 3 || b.n_modes > n_vertices || b.is_mixed > 1;
    for (int i = 0; i < 3; i++)
        is_wrong |= b.origin[i] > 1ll << 51 || b.origin[i] < -(1ll << 51);
    if (is_closed)
        is_wrong |= b.n_rows % 3 != 0 || b.n_components || b.n_rows > 3 * n_frames;
    else
        is_wrong |= b.n_components > 3 * n_frames || b.n_rows != 3 + b.n_components;
    if (b.kind == BY_PARTS) {
        b.largest = next_varint(s);
        b.n_parts = next_varint(s);
        is_wrong |= !b.largest || b.n_parts < 1 || b.n_parts > MOST_PARTS ||
                    N_FUNCTIONS * b.n_parts > n_vertices;
    }
    if (is_wrong) refuse(s, NONSENSE);
    return b;
}

/* A reader of the rest of a section. */
static int begin_reading(Coder *c, Bytes *s, Room *room) {
    const int64_t n_words = next_varint(s);
    const Bytes words = next_bytes(s, n_words > (s->end - s->at) / 4 ? -1 : 4 * n_words);
    if (s->status) return s->status;
    *c = (Coder){{.range = UINT64_MAX, .n_words = n_words, .reads = 1}, 0, (uint8_t *)s->at};
    c->at.n_bits = 8 * (s->end - s->at);
    c->words = TAKE(room, uint32_t, n_words);
    if (room->used > room->size) return ROOM;
    memcpy(c->words, words.at, (size_t)n_words * 4);
    c->at.point = (uint64_t)next_word(c) << 32;
    c->at.point |= next_word(c);
    return FINE;
}

/* Read a matrix of whole numbers. */
static int64_t *read_matrix(Coder *c, int64_t n_rows, int64_t n_columns, int is_mixed, Room *room) {
    int64_t *values = TAKE(room, int64_t, n_rows * n_columns);
    const int64_t used = room->used;
    const State before = c->at;
    for (int grow = 0; n_rows && n_columns; grow++) {
        Matrix m = {n_rows, n_columns, band_edges(n_columns, 0), 0, 0, values};
        m.edges = TAKE(room, int64_t, m.n_bands + 1);
        m.extents = TAKE(room, int64_t, n_rows);
        if (!has_room(c, room)) break;
        band_edges(n_columns, m.edges);
        code_extents(c, &m);
        if (m.n_rows && !c->at.status) {
            if (is_mixed)
                code_mixed(c, &m, grow, room);
            else
                code_waves(c, &m, room);
        }
        if (c->at.status != KEYS) break;
        c->at = before;
        room->used = used;
        memset(values, 0, (size_t)(n_rows * n_columns) * sizeof *values);
    }
    if (c->at.status != ROOM) room->used = used;
    return values;
}

/* Coefficients of whole numbers, in quanta. */
static double *restored(const Block *b, const int64_t *numbers, int64_t n, Room *room) {
    double *values = TAKE(room, double, n);
    for (int64_t i = 0; values && i < n; i++) {
        const int64_t magnitude = magnitude_of(numbers[i]);
        const double value = ((double)magnitude - b->shifts[least(magnitude, 3)]) * b->step;
        values[i] = numbers[i] ? numbers[i] < 0 ? -value : value : 0.0;
    }
    return values;
}

/* Learned components over time, (frames x 3, components). */
static double *learned_basis(const Block *b, const int64_t *numbers, Room *room) {
    const int64_t n = 3 * b->n_frames, k = b->n_components;
    double *basis = TAKE(room, double, n * k);
    const int64_t used = room->used;
    double *components = restored(b, numbers, n * k, room), *spare = TAKE(room, double, n);
    const Transform t = take_transform(room, FROM_COSINES, b->n_frames);
    if (room->used > room->size) return basis;
    for (int64_t c = 0; c < k; c++) {
        double *component = components + c * n, square = 0.0;
        for (int64_t i = 0; i < n; i++) square += component[i] * component[i];
        const double norm = square > 0.0 ? __builtin_sqrt(square) : 1.0;
        for (int64_t i = 0; i < n; i++) component[i] /= norm;
        transform(&t, component, 3, 0, 3, spare);
        for (int64_t i = 0; i < n; i++) basis[i * k + c] = component[i];
    }
    room->used = used;
    return basis;
}

/* Functions of one part: the constant, and what its coordinates add. (4, vertices) */
static void orthonormal(const int64_t *part, int64_t n, const double *shape, int64_t n_vertices,
                        double *functions, double *left) {
    double extent = 0.0, means[3] = {0};
    for (int64_t i = 0; i < n; i++) functions[part[i]] = 1.0 / __builtin_sqrt((double)n);
    for (int j = 0; j < 3; j++) {
        for (int64_t i = 0; i < n; i++) means[j] += shape[j * n_vertices + part[i]];
        means[j] /= (double)n;
        for (int64_t i = 0; i < n; i++) {
            const double x = shape[j * n_vertices + part[i]] - means[j];
            extent += x * x;
        }
    }
    extent = __builtin_sqrt(extent);
    for (int j = 0; j < 3; j++) {
        double square = 0.0;
        for (int64_t i = 0; i < n; i++) left[i] = shape[j * n_vertices + part[i]] - means[j];
        /* Twice: once leaves rounding errors of what was taken off. */
        for (int pass = 0; pass < 2; pass++) {
            double along[N_FUNCTIONS] = {0};
            for (int m = 0; m <= j; m++)
                for (int64_t i = 0; i < n; i++)
                    along[m] += functions[m * n_vertices + part[i]] * left[i];
            for (int m = 0; m <= j; m++)
                for (int64_t i = 0; i < n; i++)
                    left[i] -= along[m] * functions[m * n_vertices + part[i]];
        }
        for (int64_t i = 0; i < n; i++) square += left[i] * left[i];
        const double norm = __builtin_sqrt(square);
        for (int64_t i = 0; i < n && norm > extent / 64.0; i++)
            functions[(j + 1) * n_vertices + part[i]] = left[i] / norm;
    }
}

/* Part of each vertex: which part each piece of the mesh is of. */
static int read_parts(Coder *c, const Block *b, const Modes *modes, int64_t *part_of, Room *room) {
    Parting pieces = {0};
    const int64_t largest = least(b->largest, b->n_vertices);
    if (modes->kind != SPRING_MODES) return NONSENSE;
    if (part_graph(&pieces, modes->mesh, 0, largest, room)) return ROOM;
    int64_t *labels = TAKE(room, int64_t, pieces.n), latest[MOST_PARTS];
    if (room->used > room->size) return ROOM;
    for (int64_t i = 0; i < b->n_parts; i++) latest[i] = i;
    code_list(c, pieces.n, labels);
    if (c->at.status) return FINE;
    for (int64_t i = 0; i < pieces.n; i++) {
        const int64_t rank = labels[i];
        if (rank >= b->n_parts) return NONSENSE;
        labels[i] = latest[rank];
        for (int64_t j = rank; j > 0; j--) latest[j] = latest[j - 1];
        latest[0] = labels[i];
    }
    for (int64_t v = 0; v < b->n_vertices; v++) part_of[v] = labels[pieces.owner[v]];
    return FINE;
}

/* Add what each component does to each part to rows of values, (components, vertices). */
static int add_parts(const Block *b, const int64_t *part_of, const int64_t *maps, double *rows,
                     Room *room) {
    const int64_t used = room->used, n = b->n_vertices, n_parts = b->n_parts;
    const int64_t width = N_FUNCTIONS * n_parts;
    double *shape = TAKE(room, double, 3 * n), *functions = TAKE(room, double, N_FUNCTIONS * n);
    double *left = TAKE(room, double, n), *numbers = restored(b, maps, b->n_components * width, room);
    int64_t *part = TAKE(room, int64_t, n);
    if (room->used > room->size) return ROOM;
    for (int64_t i = 0; i < 3 * n; i++) shape[i] = rows[i] / __builtin_sqrt((double)b->n_frames);
    for (int64_t p = 0; p < n_parts; p++) {
        int64_t size = 0;
        for (int64_t v = 0; v < n; v++)
            if (part_of[v] == p) part[size++] = v;
        if (size) orthonormal(part, size, shape, n, functions, left);
    }
    for (int64_t c = 0; c < b->n_components; c++)
        for (int64_t v = 0; v < n; v++)
            for (int m = 0; m < N_FUNCTIONS; m++)
                rows[(3 + c) * n + v] +=
                    numbers[c * width + m * n_parts + part_of[v]] * functions[m * n + v];
    room->used = used;
    return FINE;
}

/* Combine components: rows of values to (frames, 3, vertices), in quanta. */
static int superpose(const Block *b, const int64_t *numbers, const double *rows, double *scaled,
                     Room *room) {
    const int64_t used = room->used, n = b->n_vertices, n_frames = b->n_frames;
    if (b->kind == BY_COSINES) {
        const Transform t = take_transform(room, FROM_COSINES, n_frames);
        double *spare = t.m ? TAKE(room, double, n_frames * 3 * n) : 0;
        if (room->used > room->size) return ROOM;
        memset(scaled, 0, (size_t)(n_frames * 3 * n) * sizeof *scaled);
        if (t.m) {
            memcpy(scaled, rows, (size_t)(b->n_rows * n) * sizeof *scaled);
            transform(&t, scaled, 3 * n, 0, 3 * n, spare);
        }
        for (int64_t i = 0; i < n_frames && !t.m; i++)
            for (int64_t k = 0; k < b->n_rows / 3; k++) {
                const double share = t.matrix[i * n_frames + k];
                for (int64_t j = 0; j < 3 * n; j++)
                    scaled[i * 3 * n + j] += share * rows[k * 3 * n + j];
            }
        room->used = used;
        return FINE;
    }
    const double *basis = learned_basis(b, numbers, room);
    const int64_t k = b->n_components;
    if (room->used > room->size) return ROOM;
    memset(scaled, 0, (size_t)(n_frames * 3 * n) * sizeof *scaled);
    for (int64_t i = 0; i < 3 * n_frames; i++) {
        double *to = scaled + i * n;
        for (int64_t c = 0; c < k; c++) {
            const double share = basis[i * k + c];
            const double *from = rows + (3 + c) * n;
            for (int64_t j = 0; j < n; j++) to[j] += share * from[j];
        }
    }
    const double length = __builtin_sqrt((double)n_frames);
    for (int64_t i = 0; i < n_frames; i++)
        for (int64_t j = 0; j < 3 * n; j++) scaled[i * 3 * n + j] += rows[j] / length;
    room->used = used;
    return FINE;
}

static double rounded(double x) {
    const double whole = positive(x) + 0x1p52 - 0x1p52;
    return x < 0.0 ? -whole : whole;
}

/* Round to whole quanta, where the stream says how, and add its corrections. */
static int round_all(Coder *c, const Block *b, double *scaled, Room *room) {
    const int64_t used = room->used, n = b->n_frames * 3 * b->n_vertices;
    int64_t n_guards = 0, n_corrections = 0, width = 1;
    while (width < 63 && n >> width) width++;
    code_list(c, 1, &n_guards);
    if (n_guards > n) return NONSENSE;
    int64_t *places = TAKE(room, int64_t, n_guards);
    if (room->used > room->size) return ROOM;
    for (int64_t i = 0; i < n_guards && !c->at.status; i++) {
        places[i] = code_bits(c, (int)width, 0);
        if (places[i] >= n || (i && places[i] <= places[i - 1])) return NONSENSE;
    }
    for (int64_t i = 0, at = 0; i < n; i++) {
        const double x = scaled[i];
        if (!(positive(x) < MOST_QUANTA)) return NONSENSE;
        scaled[i] = rounded(x);
        if (at == n_guards || places[at] != i) continue;
        at++;
        const double floor = scaled[i] > x ? scaled[i] - 1.0 : scaled[i];
        scaled[i] = floor + (double)code_bits(c, 1, 0);
    }
    if (b->width && !c->at.status) {
        code_list(c, 1, &n_corrections);
        if (n_corrections > n) return NONSENSE;
        int64_t *gaps = TAKE(room, int64_t, n_corrections);
        int64_t *sizes = TAKE(room, int64_t, n_corrections), at = -1;
        if (room->used > room->size) return ROOM;
        code_list(c, n_corrections, gaps);
        code_list(c, n_corrections, sizes);
        for (int64_t i = 0; i < n_corrections && !c->at.status; i++) {
            if (gaps[i] >= n - 1 - at) return NONSENSE;
            at += gaps[i] + 1;
            const double more = (double)b->width * (double)(sizes[i] + 1);
            scaled[at] += code_bits(c, 1, 0) ? -more : more;
        }
    }
    room->used = used;
    return FINE;
}

/* 2^n, n from -1022 to 1023 */
static double power_of_2(int64_t n) {
    const uint64_t bits = (uint64_t)(n + 1023) << 52;
    double value;
    __builtin_memcpy(&value, &bits, 8);
    return value;
}

/* Decode the positions of a block, (frames, vertices, 3). */
static int read_block(Bytes s, int64_t n_frames, const Modes *modes, int is_double, void *positions,
                      Room *room) {
    const int64_t used = room->used, n = modes->mesh->n;
    const Block b = read_block_head(&s, n_frames, n);
    Coder c = {0};
    int status = s.status;
    if (status || (status = begin_reading(&c, &s, room))) return status;
    int64_t *part_of = TAKE(room, int64_t, b.n_parts ? n : 0), *maps = 0, *basis = 0;
    if (room->used > room->size) return ROOM;
    if (b.n_parts && (status = read_parts(&c, &b, modes, part_of, room))) return status;
    const int64_t columns = 3 * n_frames, width = N_FUNCTIONS * b.n_parts;
    if (b.n_components) basis = read_matrix(&c, b.n_components, columns, b.is_mixed, room);
    const int64_t *numbers = read_matrix(&c, b.n_rows, b.n_modes, b.is_mixed, room);
    if (b.n_parts) maps = read_matrix(&c, b.n_components, width, b.is_mixed, room);
    if (c.at.status) return (int)c.at.status;
    double *scaled = TAKE(room, double, n_frames * 3 * n);
    double *rows = TAKE(room, double, b.n_rows * n);
    const double *coefficients = restored(&b, numbers, b.n_rows * b.n_modes, room);
    if (room->used > room->size) return ROOM;
    if (values_of(modes, coefficients, b.n_rows, b.n_modes, rows, room)) return ROOM;
    if (maps && add_parts(&b, part_of, maps, rows, room)) return ROOM;
    if (superpose(&b, basis, rows, scaled, room)) return ROOM;
    if ((status = round_all(&c, &b, scaled, room))) return status;
    if (c.at.status) return (int)c.at.status;
    /* In two steps: neither is a power beyond those of a number. */
    const double first = power_of_2(b.exponent / 2), second = power_of_2(b.exponent - b.exponent / 2);
    for (int64_t frame = 0; frame < n_frames; frame++)
        for (int64_t v = 0; v < n; v++)
            for (int64_t i = 0; i < 3; i++) {
                const double whole = scaled[(frame * 3 + i) * n + v] + (double)b.origin[i];
                const int64_t at = (frame * n + v) * 3 + i;
                if (is_double)
                    ((double *)positions)[at] = whole * first * second;
                else
                    ((float *)positions)[at] = (float)(whole * first * second);
            }
    const uint8_t *bytes = positions;
    if (checksum(bytes, bytes + n_frames * n * 3 * (is_double ? 8 : 4)) != b.checksum)
        return OTHER_POSITIONS;
    room->used = used;
    return FINE;
}

#endif
