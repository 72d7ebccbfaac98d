/* Decoding of whole streams: bytes to positions, triangles and times. docs/format.md
 *
 * The caller asks what a stream declares, decides whether it wants that, and hands over room. */
#include "block.h"
#include "surface.h"

enum { CELLS = 1, N_FACTS = 32 };

/* Triangles of a lattice whose cells are all cut alike, by a pattern of 13 bits. */
static int cell_faces(const Header *h, Bytes *s, int32_t *faces) {
    const uint64_t bytes = next_number(s, 1), both = bytes << 8 | next_number(s, 1);
    if (s->status || s->at != s->end || h->n_grid != 2 || h->n_axes != 2) return NONSENSE;
    int64_t cells[2];
    for (int i = 0; i < 2; i++)
        cells[i] = h->grid[i] - !(h->ends[i] == CLOSED_ENDS && h->grid[i] > 2);
    if (cells[0] < 1 || cells[1] < 1 || h->grid[0] > h->n_vertices ||
        h->grid[0] * h->grid[1] != h->n_vertices || 2 * cells[0] * cells[1] != h->n_faces)
        return NONSENSE;
    const int is_together = (int)(both >> 15 & 1);
    for (int64_t cell = 0; cell < cells[0] * cells[1]; cell++)
        for (int face = 0; face < 2; face++) {
            const int64_t number = is_together ? 2 * cell + face : cell + face * cells[0] * cells[1];
            for (int corner = 0; corner < 3; corner++) {
                const int bit = 14 - (6 * face + 2 * corner);
                const int64_t row = cell / cells[1] + (int64_t)(both >> bit & 1);
                const int64_t column = cell % cells[1] + (int64_t)(both >> (bit - 1) & 1);
                faces[3 * number + corner] = (int32_t)(row % h->grid[0] * h->grid[1] +
                                                       column % h->grid[1]);
            }
        }
    return FINE;
}

static int stream_faces(const Header *h, Bytes s, int32_t *faces, Room *room) {
    if (!h->n_faces) return FINE;
    const int rule = (int)next_number(&s, 1);
    if (rule == CELLS) return cell_faces(h, &s, faces);
    const int32_t relations = (int32_t)next_number(&s, 1);
    if (rule || s.status || relations > MOST_RELATIONS) return NONSENSE;
    const Shape shape = {(int32_t)h->n_vertices, (int32_t)h->n_faces, relations};
    const int64_t used = room->used;
    Coder c;
    const int status = begin_reading(&c, &s, room);
    if (status) return status;
    const State before = c.at;
    const int64_t inside = room->used;
    for (int grow = 0;; grow++) {
        code_surface(&c, &shape, faces, grow, room);
        if (c.at.status != KEYS) break;
        c.at = before;
        room->used = inside;
    }
    if (!c.at.status) room->used = used;
    return (int)c.at.status;
}

/* What a stream declares: as doubles, in which all of it is exact. */
MM_EXPORT(mm_inspect) int32_t mm_inspect(const uint8_t *data, size_t size, double *facts) {
    Bytes b = {data, data + size, 0};
    const Header h = read_header(&b);
    const double found[N_FACTS] = {
        (double)h.n_frames, (double)h.n_vertices, (double)h.n_faces, h.is_double, h.unit, h.times,
        h.rms, h.max_error, h.kg_error, (double)h.n_axes, (double)h.n_grid};
    for (int i = 0; i < N_FACTS; i++) facts[i] = found[i];
    for (int i = 0; i < 4 && !b.status; i++) {
        facts[12 + i] = (double)h.ends[i];
        facts[16 + i] = (double)h.grid[i];
    }
    return b.status;
}

/* Decode some frames, from the first of them on.
 *
 * Positions are (frames, vertices, 3), doubles or singles as the stream declares; times one a frame.
 * If the room is too small, `needed` says how large it has to be at least. */
MM_EXPORT(mm_decode)
int32_t mm_decode(const uint8_t *data, size_t size, size_t first_frame, size_t n_frames,
                  void *positions, uint32_t *faces, double *times, uint8_t *work, size_t work_size,
                  double *needed) {
    Bytes b = {data, data + size, 0};
    Room room = {work, (int64_t)work_size, 0, (int64_t)work_size};
    Header h = read_header(&b);
    const int64_t first = (int64_t)first_frame, end = first + (int64_t)n_frames;
    Bytes s = b.status ? b : next_section(&b, 1);
    int status = b.status;
    Graph mesh = {0};
    Modes modes = {0};
    if (!status && end > h.n_frames) status = NONSENSE;
    for (int64_t i = 0; !status && h.times && i < h.n_frames; i++) {
        const double time = h.times == 1 ? h.start + h.step * (double)i : next_double(&h.each_time);
        if (i >= first && i < end) times[i - first] = time;
    }
    if (!status) status = stream_faces(&h, s, (int32_t *)faces, &room);
    if (!status) status = mesh_graph(&mesh, h.n_vertices, faces, h.n_faces, &room);
    if (!status) status = read_modes(&modes, h.modes, &mesh, &room);
    const int64_t each = h.n_vertices * 3 * (h.is_double ? 8 : 4);
    uint8_t *to = positions;
    for (int64_t i = 0, at = 0; !status && i < h.n_blocks; i++) {
        const int64_t n = next_varint(&h.blocks), from = most(first, at), stop = least(end, at + n);
        s = next_section(&b, from < stop);
        status = b.status;
        if (!status && from < stop) {
            const int64_t used = room.used;
            const int is_whole = stop - from == n;
            uint8_t *all = is_whole ? to : TAKE(&room, uint8_t, n * each);
            if (room.used > room.size)
                status = ROOM;
            else
                status = read_block(s, n, &modes, h.is_double, all, &room);
            if (!status && !is_whole)
                memcpy(to, all + (from - at) * each, (size_t)((stop - from) * each));
            to += (stop - from) * each;
            if (!status) room.used = used;
        }
        at += n;
    }
    if (!status && b.at != b.end) status = CUT_OFF;
    *needed = (double)room.used;
    return status;
}
