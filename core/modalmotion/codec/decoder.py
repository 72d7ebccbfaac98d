"""Decoding: a stream back to a mesh sequence."""

from __future__ import annotations

import lzma
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from modalmotion.codec.block import HASH_BYTES, digest, read_block
from modalmotion.codec.connectivity.faces import Grid, read_faces
from modalmotion.codec.container import Header, read_header, read_section, skip_section
from modalmotion.codec.modes.modes_section import STORED, read_modes
from modalmotion.errors import MalformedFileError, ParameterError
from modalmotion.limits import ReadLimits
from modalmotion.mesh.checks import FloatArray
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence

DECODE_LIMITS = ReadLimits()


def decode(
    data: bytes, *, frames: range | None = None, limits: ReadLimits = DECODE_LIMITS
) -> MeshSequence:
    """Decode a stream, or some of its frames.

    Parameters
    ----------
    data : bytes
        What `encode` wrote.
    frames : range, optional
        Frames wanted, in steps of 1; only the blocks that hold them are decoded.
    limits : ReadLimits, optional
        Largest sequence that is accepted, compared with what the stream declares.

    Raises
    ------
    MalformedFileError
        If the bytes are no stream, of another version, cut, damaged, or do not decode to the
        vertices that were encoded.
    LimitError
        If the stream declares more than the limits accept.
    ParameterError
        If there are no such frames.
    """
    header, position = read_header(data, limits)
    wanted = range(header.n_frames) if frames is None else frames
    if wanted.step != 1 or not 0 <= wanted.start < wanted.stop <= header.n_frames:
        raise ParameterError(
            f"The frames {wanted.start} to {wanted.stop} in steps of {wanted.step} are not in a "
            f"stream of {header.n_frames}.",
            remedy=f"Ask for a range within 0 to {header.n_frames}, in steps of 1.",
        )
    faces, position = _read_faces(data, position, header)
    parts = [
        positions[max(0, wanted.start - first) : wanted.stop - first]
        for first, positions in _blocks(data, position, header, faces, wanted)
    ]
    times = None if header.times is None else header.times[wanted.start : wanted.stop]
    positions: FloatArray = np.concatenate(parts)  # type: ignore[assignment]
    return _sequence(header, positions, faces, times)


def inspect(data: bytes, *, limits: ReadLimits = DECODE_LIMITS) -> Header:
    """Read what a stream says of itself, without decoding it.

    Raises
    ------
    MalformedFileError, LimitError
        As `decode`, as far as the header goes.
    """
    return read_header(data, limits)[0]


def store_positions(positions: FloatArray) -> bytes:
    """Write positions without loss: bytes of equal significance together, compressed."""
    plain = positions.astype(positions.dtype.newbyteorder("<"), copy=False)
    width = plain.dtype.itemsize
    planes = np.frombuffer(np.ascontiguousarray(plain).tobytes(), np.uint8).reshape(-1, width)
    packed = lzma.compress(
        planes.T.tobytes(), format=lzma.FORMAT_ALONE, filters=[{"id": lzma.FILTER_LZMA1}]
    )
    return digest(positions) + packed


def _restore_positions(data: bytes, n_frames: int, header: Header) -> FloatArray:
    shape = (n_frames, header.n_vertices, 3)
    n_bytes = int(np.prod(shape)) * header.dtype.itemsize
    try:
        inflate = lzma.LZMADecompressor(lzma.FORMAT_ALONE, memlimit=2**28)
        plain = inflate.decompress(data[HASH_BYTES:], n_bytes + 1)
    except (lzma.LZMAError, EOFError) as error:
        raise MalformedFileError(
            "A stored block does not unpack.", remedy="The stream is damaged: send it again."
        ) from error
    if len(plain) != n_bytes:
        raise MalformedFileError(
            f"A stored block holds {len(plain)} bytes, not {n_bytes}.",
            remedy="The stream is damaged: send it again.",
        )
    planes = np.frombuffer(plain, np.uint8).reshape(header.dtype.itemsize, -1)
    raw = np.frombuffer(planes.T.tobytes(), header.dtype.newbyteorder("<"))
    positions: FloatArray = raw.astype(header.dtype).reshape(shape)
    if digest(positions) != data[:HASH_BYTES]:
        raise MalformedFileError(
            "The decoded vertices are not those that were encoded.",
            remedy="The stream is damaged: send it again.",
        )
    return positions


def _read_faces(data: bytes, position: int, header: Header) -> tuple[NDArray[np.int64], int]:
    section, position = read_section(data, position)
    if not header.n_faces:
        return np.zeros((0, 3), dtype=np.int64), position
    return read_faces(section, header.n_faces, header.n_vertices, _grid_of(header)), position


def _grid_of(header: Header) -> Grid | None:
    if header.grid is None or header.topology is None:
        return None
    return header.topology, header.grid


def _blocks(
    data: bytes, position: int, header: Header, faces: NDArray[np.int64], wanted: range
) -> Iterator[tuple[int, FloatArray]]:
    """First frame and positions of each block that holds a wanted frame."""
    stored = header.modes == STORED
    modes = None if stored else read_modes(header.modes, header.n_vertices, faces)
    first = 0
    for n_frames in header.block_frames:
        if first >= wanted.stop or first + n_frames <= wanted.start:
            position = skip_section(data, position)
        else:
            section, position = read_section(data, position)
            if len(section) < HASH_BYTES:
                raise MalformedFileError("A block is cut short.", remedy="Send the stream again.")
            if modes is None:
                yield first, _restore_positions(section, n_frames, header)
            else:
                yield first, read_block(section, n_frames, header.n_vertices, modes, header.dtype)
        first += n_frames
    if position != len(data):
        raise MalformedFileError(
            f"{len(data) - position} bytes follow the end of the stream.",
            remedy="The stream is damaged: send it again.",
        )


def _sequence(
    header: Header,
    positions: FloatArray,
    faces: NDArray[np.int64],
    times: NDArray[np.float64] | None,
) -> MeshSequence:
    return mesh_sequence(
        positions,
        faces,
        grid=header.grid,
        topology=header.topology,
        times=times,
        unit=header.unit,
    )
