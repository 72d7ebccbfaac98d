"""Decoding: a stream back to a mesh sequence."""

from collections.abc import Iterator

import numpy as np

from modalmotion.codec import block, coder, container, spatial_modes
from modalmotion.errors import ParameterError
from modalmotion.limits import ReadLimits
from modalmotion.mesh import checks, sequence
from modalmotion.representation import FloatArray, Ints

DECODE_LIMITS = ReadLimits()


def decode(
    data: bytes,
    *,
    frames: range | None = None,
    limits: ReadLimits = DECODE_LIMITS,
) -> sequence.MeshSequence:
    """Decode a stream, or some of its frames.

    Parameters
    ----------
    data : bytes
        A stream that `encode` wrote.
    frames : range, optional
        Frames to decode, in steps of 1; only the blocks that contain them are read.
    limits : ReadLimits, optional
        Largest sequence to accept, compared with the sizes that the stream declares.

    Raises
    ------
    MalformedFileError
        If the bytes are not a stream, or one of another version, cut, damaged, or do not decode
        to the vertices that were encoded.
    LimitError
        If the stream declares more than the limits accept.
    ParameterError
        If the stream does not have these frames.
    """
    header, position = container.read_header(data, limits)
    span = range(header.n_frames) if frames is None else frames
    if span.step != 1 or not 0 <= span.start < span.stop <= header.n_frames:
        raise ParameterError(
            f"The frames {span.start} to {span.stop} in steps of {span.step} are not in a "
            f"stream of {header.n_frames}.",
            remedy=f"Ask for a range within 0 to {header.n_frames}, in steps of 1.",
        )
    faces, position = _read_faces(data, position, header)
    parts = [
        positions[max(0, span.start - first) : span.stop - first]
        for first, positions in _blocks(data, position, header, faces, span)
    ]
    positions: FloatArray = np.concatenate(parts)  # type: ignore[assignment]
    times = None if header.times is None else header.times[span.start : span.stop]
    return sequence.mesh_sequence(
        checks.given_up(positions),
        faces,
        grid=header.grid,
        topology=header.topology,
        times=times,
        unit=header.unit,
    )


def inspect(data: bytes, *, limits: ReadLimits = DECODE_LIMITS) -> container.Header:
    """Read the header of a stream, without decoding the rest.

    Raises
    ------
    MalformedFileError, LimitError
        As `decode`, as far as the header goes.
    """
    return container.read_header(data, limits)[0]


def _read_faces(data: bytes, position: int, header: container.Header) -> tuple[Ints, int]:
    section, position = container.read_section(data, position)
    if not header.n_faces:
        return np.zeros((0, 3), dtype=np.int64), position
    return container.read_faces(
        section, header.n_faces, header.n_vertices, _grid_of(header)
    ), position


def _grid_of(header: container.Header) -> container.Grid | None:
    if header.grid is None or header.topology is None:
        return None
    return header.topology, header.grid


def _blocks(
    data: bytes, position: int, header: container.Header, faces: Ints, span: range
) -> Iterator[tuple[int, FloatArray]]:
    """First frame and positions of each block that overlaps a span of frames."""
    modes = None
    if header.modes != spatial_modes.STORED:
        modes = spatial_modes.read_modes(header.modes, header.n_vertices, faces)
    first = 0
    for n_frames in header.block_frames:
        if first >= span.stop or first + n_frames <= span.start:
            position = container.skip_section(data, position)
        else:
            section, position = container.read_section(data, position)
            size = n_frames, header.n_vertices
            if modes is None:
                yield first, block.restore_positions(section, *size, header.dtype)
            else:
                yield first, block.read_block(section, *size, modes, header.dtype)
        first += n_frames
    if position != len(data):
        raise coder.damaged(f"{len(data) - position} bytes follow the end of the stream.")
