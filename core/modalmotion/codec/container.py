"""The container of a stream: its header, its sections and the faces.

Two passes: the triangles of nodes numbered as a walk meets them, then which node each vertex is;
`native/triangles.h` and `native/order.h` code them.
"""

import struct
import zlib
from dataclasses import dataclass
from typing import Final

import numpy as np

from modalmotion.codec.coder import Coder, damaged, parsing, read_varint, read_varints, write_varint
from modalmotion.codec.spatial_modes import ENDS
from modalmotion.errors import LimitError, MalformedFileError
from modalmotion.limits import ReadLimits
from modalmotion.mesh.sequence import MM_PER_UNIT
from modalmotion.modes.topologies import CLOSED, Topology
from modalmotion.representation import Bytes, Floats, Ints, shown

LARGEST_BLOCK: Final = 2**26
"""Coordinates of the largest block, unless a single frame has more."""

MAGIC: Final = b"MMSQ"
VERSION: Final = 1

_NONSENSE: Final = "The header of the stream makes no sense."
_UNITS: Final = (None, *MM_PER_UNIT)
_DTYPES: Final = (np.dtype(np.float32), np.dtype(np.float64))


@shown("n_frames", "n_vertices", "n_faces", "topology", "unit", "rms", "max_error", "kg_error")
@dataclass(frozen=True)
class Header:
    """Facts that a stream states before anything is decoded.

    Parameters
    ----------
    n_frames, n_vertices, n_faces : int
    is_double : bool
        Whether the vertices are float64.
    unit : str or None
    topology : Topology or None
        As the sender stated it.
    grid : tuple of int or None
    times : (frames,) float64, s, or None
    modes : bytes
        Section that names the modes of the stream.
    rms, max_error : float, length unit
        Measured after decoding: root mean square of the distances of vertices, and the largest.
    kg_error : float, percent
        100 |A - A'| / |A - E|, E the centroid of each frame.
    block_frames : tuple of int
        Frames of each block.
    """

    n_frames: int
    n_vertices: int
    n_faces: int
    is_double: bool
    unit: str | None
    topology: Topology | None
    grid: tuple[int, ...] | None
    times: Floats | None
    modes: bytes
    rms: float
    max_error: float
    kg_error: float
    block_frames: tuple[int, ...]

    @property
    def dtype(self) -> np.dtype[np.floating]:
        """Type of the decoded vertices."""
        return _DTYPES[self.is_double]


def write_stream(header: Header, faces: bytes, blocks: list[bytes]) -> bytes:
    """Put a stream together: magic, version, then sections with length and CRC-32."""
    parts = [MAGIC, bytes([VERSION])]
    for section in (_write_header(header), faces, *blocks):
        parts += [write_varint(len(section)), section, struct.pack("<I", zlib.crc32(section))]
    return b"".join(parts)


def read_header(data: bytes, limits: ReadLimits) -> tuple[Header, int]:
    """Read the header of a stream.

    Returns
    -------
    header : Header
    position : int
        Where the section of the faces begins.

    Raises
    ------
    MalformedFileError
        If the bytes are not a stream, or one of another version, cut or damaged.
    LimitError
        If it declares more than the limits accept.
    """
    if data[: len(MAGIC)] != MAGIC:
        raise MalformedFileError(
            f"These {len(data)} bytes are not an encoded sequence: they begin with {data[:4]!r}, "
            f"not {MAGIC!r}.",
            remedy="Send a stream that `modalmotion encode` wrote.",
        )
    version = data[4] if len(data) > 4 else None
    if version != VERSION:
        raise MalformedFileError(
            f"The stream has the version {version}; this decoder reads version {VERSION}.",
            remedy="Decode it with the release that wrote it, or a later one.",
        )
    section, position = read_section(data, 5)
    return _parse_header(section, limits), position


def read_section(data: bytes, position: int) -> tuple[bytes, int]:
    """Read one section and check it.

    Raises
    ------
    MalformedFileError
        If it is cut, or its checksum is wrong.
    """
    end = skip_section(data, position) - 4
    _, position = read_varint(data, position)
    section = data[position:end]
    if zlib.crc32(section) != struct.unpack_from("<I", data, end)[0]:
        raise damaged(f"A checksum is wrong: the bytes from {position} to {end} are damaged.")
    return section, end + 4


def skip_section(data: bytes, position: int) -> int:
    """Where the section after this one begins.

    Raises
    ------
    MalformedFileError
        If the stream ends before.
    """
    length, position = read_varint(data, position)
    end = position + length + 4
    if end > len(data):
        raise damaged(f"The stream ends after {len(data)} bytes, within a section up to {end}.")
    return end


def _write_header(header: Header) -> bytes:
    parts = [
        write_varint(header.n_frames),
        write_varint(header.n_vertices),
        write_varint(header.n_faces),
        bytes([header.is_double, _UNITS.index(header.unit)]),
    ]
    ends = () if header.topology is None else header.topology.ends
    parts += [bytes([len(ends)]), bytes(ENDS.index(e) for e in ends)]
    grid = header.grid or ()
    parts += [bytes([len(grid)]), *(write_varint(n) for n in grid)]
    parts += [_write_times(header.times)]
    parts += [write_varint(len(header.modes)), header.modes]
    parts += [
        struct.pack("<3f", *(_up(x) for x in (header.rms, header.max_error, header.kg_error)))
    ]
    parts += [write_varint(len(header.block_frames))]
    parts += [write_varint(n) for n in header.block_frames]
    return b"".join(parts)


@parsing(_NONSENSE)
def _parse_header(section: bytes, limits: ReadLimits) -> Header:
    counts, position = read_varints(section, 0, 3)
    for name, count in zip(("frames", "vertices", "faces"), counts, strict=True):
        limits.require(**{name: count})
    n_frames, n_vertices, n_faces = counts
    is_double, unit, n_axes = section[position], section[position + 1], section[position + 2]
    limits.require(decompressed_bytes=n_frames * n_vertices * 3 * (8 if is_double else 4))
    position += 3
    ends = tuple(ENDS[code] for code in section[position : position + n_axes])
    position += n_axes
    grid, position = read_varints(section, position + 1, section[position])
    times, position = _read_times(section, position, n_frames)
    length, position = read_varint(section, position)
    modes, position = section[position : position + length], position + length
    rms, max_error, kg_error = struct.unpack_from("<3f", section, position)
    n_blocks, position = read_varint(section, position + 12)
    frames, position = read_varints(section, position, min(n_blocks, n_frames + 1))
    longest = max(frames, default=0)
    if longest > 1 and longest * n_vertices * 3 > 2 * LARGEST_BLOCK:
        raise LimitError(
            f"A block of {longest} frames of {n_vertices} vertices takes too much memory.",
            remedy="No encoder of this project writes such a stream: refuse its sender.",
            limit="block",
        )
    if (
        position != len(section)
        or is_double > 1
        or not n_frames
        or not n_vertices
        or sum(frames) != n_frames
        or 0 in frames
    ):
        raise damaged(_NONSENSE)
    return Header(
        n_frames,
        n_vertices,
        n_faces,
        bool(is_double),
        _UNITS[unit],
        Topology(ends) if ends else None,
        tuple(grid) or None,
        times,
        modes,
        rms,
        max_error,
        kg_error,
        tuple(frames),
    )


def _write_times(times: Floats | None) -> bytes:
    if times is None:
        return b"\x00"
    if len(times) > 1:
        start, step = float(times[0]), float(times[1] - times[0])
        if np.array_equal(start + step * np.arange(len(times)), times):
            return b"\x01" + struct.pack("<2d", start, step)
    return b"\x02" + times.astype("<f8").tobytes()


def _read_times(section: bytes, position: int, n_frames: int) -> tuple[Floats | None, int]:
    kind, position = section[position], position + 1
    if kind == 0:
        return None, position
    if kind == 1:
        start, step = struct.unpack_from("<2d", section, position)
        return start + step * np.arange(n_frames), position + 16
    if kind != 2:
        raise damaged("The times of the stream make no sense.")
    times = np.frombuffer(section, "<f8", n_frames, position).astype(np.float64)
    return times, position + 8 * n_frames


def _up(value: float) -> float:
    """Round to float32, never down: a stream never claims an error below the true one."""
    with np.errstate(over="ignore"):
        near = np.float32(value)
    # As float64: beside a float32 NumPy would round the value too.
    return float(near if float(near) >= value else np.nextafter(near, np.float32(np.inf)))


Grid = tuple[Topology, tuple[int, ...]]

MOST_RELATIONS: Final = 6
LARGEST_RELATED: Final = 10_000
"""Vertices of the largest mesh whose numbering uses relations: smaller, but slower."""

_NO_FACES: Final = "The faces of the stream make no sense."
_WALK: Final = 0
_CELLS: Final = 1
_PATTERN_BITS: Final = 13


def write_faces(
    n_vertices: int,
    grid: Grid | None,
    faces: Ints,
    n_relations: tuple[int, ...] = (MOST_RELATIONS,),
) -> bytes:
    """Write triangles by the cheapest of a few rules, fan by fan in the same orientation.

    Parameters
    ----------
    n_vertices : int
    grid : (Topology, tuple of int), optional
        Lattice whose nodes the vertices are.
    faces : (faces, 3) int64
    n_relations : tuple of int, optional
        Numbers of relations that the numbering of the vertices may use: the smallest wins.
    """
    cells = None if grid is None else _cells_of(grid, faces)
    if cells is not None:
        return bytes([_CELLS]) + np.packbits(cells).tobytes()

    def coded(n_relations: int) -> bytes:
        coder = Coder()
        coder.faces((n_vertices, len(faces), n_relations), faces)
        return bytes([_WALK, n_relations]) + coder.finish()

    return min(map(coded, n_relations if n_vertices <= LARGEST_RELATED else (0,)), key=len)


def read_faces(data: bytes, n_faces: int, n_vertices: int, grid: Grid | None) -> Ints:
    """Read triangles.

    Raises
    ------
    MalformedFileError
        If the bytes are not triangles of these vertices.
    """
    if not data or data[0] > _CELLS or (data[0] == _CELLS and grid is None):
        raise damaged(_NO_FACES)
    if data[0] == _CELLS and grid is not None:
        pattern = np.unpackbits(np.frombuffer(data[1:], np.uint8))
        faces = _faces_of(grid, pattern[:_PATTERN_BITS], n_faces) if len(pattern) == 16 else None
        if faces is None:
            raise damaged(_NO_FACES)
        return faces
    if len(data) < 2 or data[1] > MOST_RELATIONS:
        raise damaged(_NO_FACES)
    return Coder(data[2:]).faces((n_vertices, n_faces, data[1]), None)


def _cells_of(grid: Grid, faces: Ints) -> Bytes | None:
    """Pattern in which every cell of a lattice is cut into two triangles, if there is one.

    Returns
    -------
    (13,) uint8 or None
        Whether the two triangles of a cell follow each other, then for each of their corners
        the step along the first and the second axis.
    """
    shape = grid[1]
    if len(shape) != 2 or len(faces) < 2 or len(faces) % 2:
        return None
    columns = shape[1]
    for together in (1, 0):
        second = 1 if together else len(faces) // 2
        bits = [together]
        for face in (faces[0], faces[second]):
            for vertex in face.tolist():
                row, column = divmod(vertex, columns)
                bits += [min(row, 1), min(column, 1)]
        pattern = np.array(bits, dtype=np.uint8)
        rebuilt = _faces_of(grid, pattern, len(faces))
        if rebuilt is not None and np.array_equal(rebuilt, faces):
            return pattern
    return None


def _faces_of(grid: Grid, pattern: Bytes, n_faces: int) -> Ints | None:
    topology, shape = grid
    if len(shape) != 2 or len(topology.ends) != 2:
        return None
    # A closed axis has one cell more, from its last node to its first.
    n_cells = [
        n if ends == CLOSED and n > 2 else n - 1
        for n, ends in zip(shape, topology.ends, strict=True)
    ]
    if min(n_cells) < 1 or 2 * n_cells[0] * n_cells[1] != n_faces:
        return None
    row, column = (i.reshape(-1, 1, 1) for i in np.indices(n_cells))
    steps = pattern[1:].astype(np.int64).reshape(1, 2, 3, 2)
    rows = (row + steps[..., 0]) % shape[0]
    columns = (column + steps[..., 1]) % shape[1]
    both = rows * shape[1] + columns
    if not pattern[0]:
        both = both.transpose(1, 0, 2)
    return np.ascontiguousarray(both.reshape(-1, 3))
