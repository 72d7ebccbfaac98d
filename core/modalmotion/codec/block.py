"""A block of frames as coefficients, parts of a surface that move as one, and exact values.

A part is a set of pieces of the connectivity. What a temporal component does to a part is a
combination of four functions of its vertices: the constant, and the coordinates of the shape,
made orthonormal in their order. So a limb that turns takes four numbers for each component, and
its details are told once, with the shape.
"""

import lzma
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np

from modalmotion.codec.coder import (
    Coder,
    Guards,
    code_corrections,
    code_guards,
    damaged,
    parsing,
    read_varints,
    unzigzag,
    write_varint,
    zigzag,
)
from modalmotion.codec.spatial_modes import OrthonormalModes
from modalmotion.codec.temporal import Quantiser, Temporal, TimeBasis, cosine_basis, restore_basis
from modalmotion.errors import MalformedFileError
from modalmotion.representation import FloatArray, Floats, Ints

N_FUNCTIONS: Final = 4
MOST_PARTS: Final = 256
FLAT: Final = 1.0 / 64.0
"""Of the extent of a part: what less than this is left of a coordinate is no function."""


@dataclass(frozen=True, eq=False)
class Parts:
    """Which vertices move as one.

    Parameters
    ----------
    largest : int
        Vertices of the largest piece that parts are made of.
    pieces : list of (n,) int64
        Vertices of each piece, ascending; the pieces by their lowest.
    labels : (pieces,) int64
        Part of each piece.
    count : int
        Number of parts.
    """

    largest: int
    pieces: Sequence[Ints]
    labels: Ints
    count: int

    @cached_property
    def members(self) -> list[Ints]:
        """Vertices of each part, ascending."""
        owner = np.empty(sum(map(len, self.pieces)), dtype=np.int64)
        for piece, label in zip(self.pieces, self.labels.tolist(), strict=True):
            owner[piece] = label
        order = np.argsort(owner, kind="stable")
        return np.split(order, np.searchsorted(owner[order], np.arange(1, self.count)))

    def functions(self, shape: Floats) -> Floats:
        """Orthonormal functions of each part: the constant, and what x, y and z add.

        Parameters
        ----------
        shape : (3, vertices) float64

        Returns
        -------
        (4, vertices) float64
            Zero where a coordinate is, but for a 64th of the extent, a combination of those before.
        """
        found = np.zeros((N_FUNCTIONS, shape.shape[1]))
        for part in self.members:
            if len(part):
                found[:, part] = _orthonormal(shape[:, part])
        return found

    def spread(self, numbers: Floats, functions: Floats) -> Floats:
        """Combine functions, (rows, 4 x parts) to (rows, vertices); function slow, part fast."""
        values = np.empty((len(numbers), functions.shape[1]))
        for i, part in enumerate(self.members):
            values[:, part] = numbers[:, i :: self.count] @ functions[:, part]
        return values

    def gathered(self, values: Floats, functions: Floats) -> Floats:
        """Project on the functions, (rows, vertices) to (rows, 4 x parts)."""
        numbers = np.empty((len(values), N_FUNCTIONS * self.count))
        for i, part in enumerate(self.members):
            numbers[:, i :: self.count] = values[:, part] @ functions[:, part].T
        return numbers

    def apart(self, functions: Floats) -> Floats:
        """List the functions of all parts, (4 x parts, vertices); function slow, part fast."""
        rows = np.zeros((N_FUNCTIONS * self.count, functions.shape[1]))
        for i, part in enumerate(self.members):
            rows[i :: self.count, part] = functions[:, part]
        return rows


def code_labels(coder: Coder, n_pieces: int, count: int, labels: Ints | None) -> Ints:
    """Code the part of each piece: how many other parts came up since it last did.

    Parameters
    ----------
    coder : Coder
    n_pieces, count : int
        Pieces and parts.
    labels : (pieces,) int64, optional
        For a writer.

    Raises
    ------
    MalformedFileError
        If there is no such part.
    """
    latest = list(range(count))
    ranks = None
    if labels is not None:
        found = []
        for label in labels.tolist():
            found.append(latest.index(label))
            latest.insert(0, latest.pop(found[-1]))
        latest, ranks = list(range(count)), np.array(found, dtype=np.int64)
    ranks = coder.numbers(n_pieces, ranks)
    if n_pieces and ranks.max() >= count:
        raise damaged(f"The stream names part {ranks.max()} of {count}.")
    told = np.empty(n_pieces, dtype=np.int64)
    for i, rank in enumerate(ranks.tolist()):
        told[i] = label = latest.pop(rank)
        latest.insert(0, label)
    return told


def _orthonormal(shape: Floats) -> Floats:
    n = shape.shape[1]
    basis = np.zeros((N_FUNCTIONS, n))
    basis[0] = 1.0 / np.sqrt(n)
    centred = shape - shape.mean(axis=1, keepdims=True)
    extent = float(np.sqrt((centred**2).sum()))
    for j, coordinate in enumerate(centred, start=1):
        left = coordinate
        # Twice: once leaves rounding errors of what was taken off.
        for _ in range(2):
            left = left - (basis[:j] @ left) @ basis[:j]
        norm = float(np.sqrt((left**2).sum()))
        if norm > FLAT * extent:
            basis[j] = left / norm
    return basis


CHECKSUM_BYTES: Final = 4
MOST_QUANTA: Final = 2**51
_NONSENSE: Final = "The header of a block is invalid."


@dataclass(frozen=True, eq=False)
class Block:
    """Everything a decoder needs for some frames.

    Parameters
    ----------
    kind : Temporal
    quantiser : Quantiser
    basis : (components, frames x 3) int64
        Learned components; none for a basis in closed form.
    coefficients : (rows, modes) int64
        Without the modes after the last one used.
    exponent : int
        The quantum is 2^exponent length units.
    origin : (3,) int64, quanta
    width : int
        Quanta of one step of the corrections; 0 without corrections.
    parts : Parts, optional
        What moves as one.
    maps : (components, 4 x parts) int64
        What each component does to each part, beside its coefficients.
    mixed : bool
        Whether the matrices are coded one by one, in fewer bits and more time.
    """

    kind: Temporal
    n_frames: int
    quantiser: Quantiser
    basis: Ints
    coefficients: Ints
    exponent: int
    origin: Ints
    width: int = 0
    parts: Parts | None = None
    maps: Ints = field(default_factory=lambda: np.zeros((0, 0), dtype=np.int64))
    mixed: bool = False

    def time_basis(self) -> TimeBasis:
        """Make the temporal components."""
        if self.kind == Temporal.DCT:
            return cosine_basis(self.n_frames)
        return restore_basis(self.kind, self.basis, self.n_frames, self.quantiser)

    def scaled(self, modes: OrthonormalModes) -> Floats:
        """Positions about the origin in quanta, before rounding, (frames, 3, vertices)."""
        rows = modes.synthesise(self.quantiser.restore(self.coefficients))
        if self.parts is not None:
            functions = self.parts.functions(rows[:3] / np.sqrt(self.n_frames))
            rows[3:] += self.parts.spread(self.quantiser.restore(self.maps), functions)
        return self.time_basis().superpose(rows)


def positions_of(block: Block, whole: Ints, dtype: np.dtype[np.floating]) -> FloatArray:
    """Whole quanta about the origin as coordinates, (frames, vertices, 3) in the length unit."""
    total = (whole + block.origin[:, None]).transpose(0, 2, 1).astype(np.float64)
    with np.errstate(over="ignore"):
        np.ldexp(total, block.exponent, out=total)
        positions: FloatArray = np.ascontiguousarray(total, dtype=dtype)
    return positions


def write_block(
    block: Block, guards: Guards, corrections: Ints | None, positions: FloatArray
) -> bytes:
    """Write a block.

    Parameters
    ----------
    block : Block
    guards : Guards
    corrections : (frames, 3, vertices) int64, optional
        In steps of `block.width` quanta.
    positions : (frames, vertices, 3)
        As decoded; only their checksum is written.
    """
    writer = Coder()
    n_values = positions.size
    if block.parts is not None:
        code_labels(writer, len(block.parts.pieces), block.parts.count, block.parts.labels)
    if block.basis.shape[0]:
        writer.matrix(block.basis.shape, block.basis, mixed=block.mixed)
    for numbers in (block.coefficients, block.maps):
        writer.matrix(numbers.shape, numbers, mixed=block.mixed)
    code_guards(writer, n_values, guards)
    if corrections is not None:
        code_corrections(writer, corrections.shape, corrections)
    head = struct.pack("<Bf3b", block.kind, block.quantiser.step, *block.quantiser.shifts)
    signed = (block.exponent, *block.origin.tolist())
    sizes = (block.width, *block.coefficients.shape, len(block.basis))
    head += b"".join(write_varint(n) for n in (*map(zigzag, signed), *sizes))
    head += bytes([block.mixed])
    if block.parts is not None:
        head += write_varint(block.parts.largest) + write_varint(block.parts.count)
    return checksum(positions) + head + writer.finish()


def read_block(
    data: bytes,
    n_frames: int,
    n_vertices: int,
    modes: OrthonormalModes,
    dtype: np.dtype[np.floating],
) -> FloatArray:
    """Decode a block, and compare the checksum of its positions.

    Raises
    ------
    MalformedFileError
        If the bytes are not a block, or the positions are not those that were encoded.
    """
    block, position = _read_head(data, n_frames, n_vertices, modes)
    reader = Coder(data[position:])
    basis, parts = block.basis, block.parts
    if parts is not None:
        parts = replace(parts, labels=code_labels(reader, len(parts.pieces), parts.count, None))
    if len(basis):
        basis = reader.matrix(basis.shape, None, mixed=block.mixed)
    coefficients = reader.matrix(block.coefficients.shape, None, mixed=block.mixed)
    maps = reader.matrix(block.maps.shape, None, mixed=block.mixed)
    guards = code_guards(reader, 3 * n_frames * n_vertices, None)
    block = replace(block, basis=basis, coefficients=coefficients, parts=parts, maps=maps)
    scaled = block.scaled(modes)
    if not (np.abs(scaled) < MOST_QUANTA).all():
        raise damaged("Decoded positions exceed the range of the stream's quantisation step.")
    whole = guards.round(scaled)
    if block.width:
        whole += block.width * code_corrections(reader, whole.shape, None)
    positions = positions_of(block, whole, dtype)
    if checksum(positions) != data[:CHECKSUM_BYTES]:
        raise MalformedFileError(
            "The decoded vertices are not those that were encoded.",
            remedy="The stream is damaged, or this machine computes its modes differently: "
            "send the stream again, or encode on this machine.",
        )
    return positions


def checksum(positions: FloatArray) -> bytes:
    """CRC-32 of the positions, little-endian, (frame, vertex, direction)."""
    plain = positions.astype(positions.dtype.newbyteorder("<"), copy=False)
    return struct.pack("<I", zlib.crc32(np.ascontiguousarray(plain).data))


def _read_head(
    data: bytes, n_frames: int, n_vertices: int, modes: OrthonormalModes
) -> tuple[Block, int]:
    with parsing(_NONSENSE):
        block, position = _parse_head(data, n_frames, n_vertices)
        if block.kind != Temporal.PARTS:
            return block, position
        (largest, count), position = read_varints(data, position, 2)
        # As many vertices as numbers for each component: more no encoder writes.
        if not (largest and 0 < count <= MOST_PARTS and N_FUNCTIONS * count <= n_vertices):
            raise ValueError
        pieces = modes.pieces(min(largest, n_vertices))
        if pieces is None:
            raise ValueError
    labels = np.zeros(len(pieces), dtype=np.int64)
    maps = np.zeros((len(block.basis), N_FUNCTIONS * count), dtype=np.int64)
    return replace(block, parts=Parts(largest, pieces, labels, count), maps=maps), position


def _parse_head(data: bytes, n_frames: int, n_vertices: int) -> tuple[Block, int]:
    code, step, *shifts = struct.unpack_from("<Bf3b", data, CHECKSUM_BYTES)
    kind = Temporal(code)
    numbers, position = read_varints(data, CHECKSUM_BYTES + 8, 8)
    mixed = data[position]
    exponent = unzigzag(numbers[0])
    origin = np.array([unzigzag(n) for n in numbers[1:4]], dtype=np.int64)
    width, n_rows, n_modes, n_components = numbers[4:]
    closed_form = kind == Temporal.DCT
    rows = n_rows if closed_form else 3 + n_components
    columns = 3 * n_frames
    if (
        not (np.isfinite(step) and step > 0)
        or not -1074 <= exponent <= 1023
        or np.abs(origin).max() > MOST_QUANTA
        or width > MOST_QUANTA
        or n_rows != rows
        or n_rows % 3 * closed_form
        or n_rows > 3 * n_frames + 3
        or n_components > (0 if closed_form else columns)
        or not n_modes <= n_vertices
        or mixed > 1
    ):
        raise damaged(_NONSENSE)
    return (
        Block(
            kind,
            n_frames,
            Quantiser(step, tuple(shifts)),
            np.zeros((n_components, columns), dtype=np.int64),
            np.zeros((n_rows, n_modes), dtype=np.int64),
            exponent,
            origin,
            width,
            mixed=bool(mixed),
        ),
        position + 1,
    )


def store_positions(positions: FloatArray) -> bytes:
    """Write positions without loss: bytes of equal significance together, compressed."""
    plain = positions.astype(positions.dtype.newbyteorder("<"), copy=False)
    width = plain.dtype.itemsize
    planes = np.frombuffer(np.ascontiguousarray(plain).tobytes(), np.uint8).reshape(-1, width)
    packed = lzma.compress(
        planes.T.tobytes(), format=lzma.FORMAT_ALONE, filters=[{"id": lzma.FILTER_LZMA1}]
    )
    return checksum(positions) + packed


def restore_positions(
    data: bytes, n_frames: int, n_vertices: int, dtype: np.dtype[np.floating]
) -> FloatArray:
    """Undo `store_positions`, (frames, vertices, 3).

    Raises
    ------
    MalformedFileError
        If the bytes do not unpack to the positions that were stored.
    """
    shape = (n_frames, n_vertices, 3)
    n_bytes = int(np.prod(shape)) * dtype.itemsize
    try:
        inflate = lzma.LZMADecompressor(lzma.FORMAT_ALONE, memlimit=2**28)
        plain = inflate.decompress(data[CHECKSUM_BYTES:], n_bytes + 1)
    except (lzma.LZMAError, EOFError) as error:
        raise damaged("A stored block cannot be unpacked.") from error
    if len(plain) != n_bytes:
        raise damaged(f"A stored block contains {len(plain)} bytes, not {n_bytes}.")
    planes = np.frombuffer(plain, np.uint8).reshape(dtype.itemsize, -1)
    raw = np.frombuffer(planes.T.tobytes(), dtype.newbyteorder("<"))
    positions: FloatArray = raw.astype(dtype).reshape(shape)
    if checksum(positions) != data[:CHECKSUM_BYTES]:
        raise damaged("The decoded vertices are not those that were encoded.")
    return positions
