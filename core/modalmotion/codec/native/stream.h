/* The container: sections, checksums, header. docs/format.md, sections 2 and 3. */
#ifndef MM_STREAM_H
#define MM_STREAM_H

#include "coder.h"

/* Beside the statuses of a coder. */
enum {
    NO_STREAM = 32,   /* the bytes begin otherwise */
    OTHER_VERSION,
    CUT_OFF,          /* the stream ends within a section, or goes on behind its end */
    WRONG_CHECKSUM,
    NONSENSE,         /* numbers that no encoder writes */
    OTHER_POSITIONS,  /* the positions are not those that were encoded */
    STORED_WHOLE,     /* positions without loss, which this decoder does not unpack */
};

enum { MAGIC = 0x51534D4D /* MMSQ */, VERSION = 1, MOST_AXES = 8, LARGEST_BLOCK = 1 << 26 };

static const int64_t MOST_NUMBERS = INT64_C(1) << 40;

/* Bytes that are read one after the other; what lies behind the end is 0, and is noted. */
typedef struct {
    const uint8_t *at, *end;
    int status;
} Bytes;

static void refuse(Bytes *b, int status) {
    if (!b->status) b->status = status;
    b->at = b->end;
}

static uint64_t next_number(Bytes *b, int n_bytes) {
    uint64_t value = 0;
    if (b->end - b->at < n_bytes) {
        refuse(b, NONSENSE);
        return 0;
    }
    for (int i = 0; i < n_bytes; i++) value |= (uint64_t)*b->at++ << 8 * i;
    return value;
}

static double next_double(Bytes *b) {
    const uint64_t bits = next_number(b, 8);
    double value;
    __builtin_memcpy(&value, &bits, 8);
    return value;
}

static double next_single(Bytes *b) {
    const uint32_t bits = (uint32_t)next_number(b, 4);
    float value;
    __builtin_memcpy(&value, &bits, 4);
    return value;
}

/* A number of 7 bits a byte, the low ones first. */
static int64_t next_varint(Bytes *b) {
    uint64_t value = 0;
    for (int shift = 0; shift < 63; shift += 7) {
        const uint64_t byte = next_number(b, 1);
        value |= (byte & 127) << shift;
        if (byte < 128) return (int64_t)value;
    }
    refuse(b, NONSENSE);
    return 0;
}

static int64_t next_signed(Bytes *b) {
    const uint64_t value = (uint64_t)next_varint(b);
    return (int64_t)(value >> 1) ^ -(int64_t)(value & 1);
}

/* The n next bytes, or none if there are fewer. */
static Bytes next_bytes(Bytes *b, int64_t n) {
    if (n < 0 || b->end - b->at < n) {
        refuse(b, NONSENSE);
        n = 0;
    }
    b->at += n;
    return (Bytes){b->at - n, b->at, b->status};
}

static uint32_t checksum(const uint8_t *at, const uint8_t *end) {
    static const uint32_t of_half_bytes[16] = {
        0x00000000, 0x1db71064, 0x3b6e20c8, 0x26d930ac, 0x76dc4190, 0x6b6b51f4,
        0x4db26158, 0x5005713c, 0xedb88320, 0xf00f9344, 0xd6d6a3e8, 0xcb61b38c,
        0x9b64c2b0, 0x86d3d2d4, 0xa00ae278, 0xbdbdf21c};
    uint32_t crc = UINT32_MAX;
    for (; at < end; at++) {
        crc ^= *at;
        for (int i = 0; i < 2; i++) crc = crc >> 4 ^ of_half_bytes[crc & 15];
    }
    return ~crc;
}

/* The next section; what is only stepped over is not looked at. */
static Bytes next_section(Bytes *b, int is_wanted) {
    const int64_t n = next_varint(b);
    if (b->end - b->at < 4 || n > b->end - b->at - 4) {
        refuse(b, CUT_OFF);
        return *b;
    }
    Bytes section = {b->at, b->at + n, 0};
    b->at += n;
    const uint32_t stated = (uint32_t)next_number(b, 4);
    if (is_wanted && checksum(section.at, section.end) != stated) refuse(b, WRONG_CHECKSUM);
    section.status = b->status;
    return section;
}

typedef struct {
    int64_t n_frames, n_vertices, n_faces, n_axes, n_grid, n_blocks;
    int is_double, unit, times;  /* times: 0 none, 1 regular, 2 one by one */
    int64_t ends[MOST_AXES], grid[MOST_AXES];
    double start, step, rms, max_error, kg_error;
    Bytes each_time, modes, blocks;
} Header;

static Header read_header(Bytes *b) {
    Header h = {0};
    if (next_number(b, 4) != MAGIC) {
        b->status = 0;
        refuse(b, NO_STREAM);
        return h;
    }
    if (next_number(b, 1) != VERSION) refuse(b, OTHER_VERSION);
    Bytes s = next_section(b, 1);
    h.n_frames = next_varint(&s);
    h.n_vertices = next_varint(&s);
    h.n_faces = next_varint(&s);
    h.is_double = (int)next_number(&s, 1);
    h.unit = (int)next_number(&s, 1);
    h.n_axes = (int64_t)next_number(&s, 1);
    if (h.n_axes > MOST_AXES) refuse(&s, NONSENSE);
    for (int i = 0; i < h.n_axes && !s.status; i++) h.ends[i] = (int64_t)next_number(&s, 1);
    h.n_grid = (int64_t)next_number(&s, 1);
    if (h.n_grid > MOST_AXES) refuse(&s, NONSENSE);
    for (int i = 0; i < h.n_grid && !s.status; i++) h.grid[i] = next_varint(&s);
    h.times = (int)next_number(&s, 1);
    if (h.times == 1) {
        h.start = next_double(&s);
        h.step = next_double(&s);
    } else if (h.times == 2) {
        h.each_time = next_bytes(&s, 8 * h.n_frames);
    }
    h.modes = next_bytes(&s, next_varint(&s));
    h.rms = next_single(&s);
    h.max_error = next_single(&s);
    h.kg_error = next_single(&s);
    h.n_blocks = next_varint(&s);
    h.blocks = s;
    int64_t n_frames = 0;
    for (int64_t i = 0; i < h.n_blocks && !s.status; i++) {
        const int64_t n = next_varint(&s);
        if (!n || n > h.n_frames - n_frames) refuse(&s, NONSENSE);
        if (n > 1 && h.n_vertices > 2 * LARGEST_BLOCK / 3 / n) refuse(&s, TOO_MANY);
        n_frames += n;
    }
    if (s.at != s.end || h.is_double > 1 || h.times > 2 || !h.n_frames || !h.n_vertices ||
        n_frames != h.n_frames)
        refuse(&s, NONSENSE);
    if (!s.status &&
        (h.n_vertices >= 1 << 28 || h.n_faces >= 1 << 28 || h.n_frames > MOST_NUMBERS / h.n_vertices))
        refuse(&s, TOO_MANY);
    if (s.status) refuse(b, s.status);
    return h;
}

#endif
