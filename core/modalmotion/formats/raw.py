"""Raw numbers: frame by frame, vertex by vertex, x y z, little-endian, nothing else."""

from __future__ import annotations

from math import prod
from typing import Final

import numpy as np

from modalmotion.errors import MalformedFileError, NonFiniteError, ParameterError
from modalmotion.formats.result import Reading
from modalmotion.limits import DEFAULT_LIMITS, ReadLimits
from modalmotion.mesh.checks import single_precision
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence

RAW_TYPES: Final = {"float32": "<f4", "float64": "<f8"}
"""Types of raw numbers."""


def read_raw(
    data: bytes,
    n_vertices: int | None = None,
    *,
    grid: tuple[int, ...] | None = None,
    dtype: str = "float32",
    limits: ReadLimits = DEFAULT_LIMITS,
) -> Reading:
    """Read positions from raw numbers.

    Parameters
    ----------
    data : bytes
    n_vertices : int, optional
        Vertices a frame; the product of `grid` by default.
    grid : tuple of int, optional
        Nodes along each axis of a lattice.
    dtype : {"float32", "float64"}
    limits : ReadLimits, optional

    Raises
    ------
    ParameterError
        If the number of vertices is missing or below 1, or the type is unknown.
    MalformedFileError
        If the bytes are not a whole number of frames.
    LimitError
        If it holds more frames or vertices than `limits` accept.
    InputError
        If a number is not finite.
    """
    if n_vertices is None and grid is not None:
        n_vertices = prod(grid)
    if n_vertices is None or n_vertices < 1:
        raise ParameterError(
            f"Raw numbers say nothing of their shape, and the number of vertices is {n_vertices}.",
            remedy="State the number of vertices per frame, or the grid.",
        )
    if dtype not in RAW_TYPES:
        raise ParameterError(
            f"The type {dtype[:20]!r} is not understood.",
            remedy="Send little-endian float32 or float64.",
        )
    kind = np.dtype(RAW_TYPES[dtype])
    frame_bytes = n_vertices * 3 * kind.itemsize
    n_frames, rest = divmod(len(data), frame_bytes)
    if rest or not n_frames:
        raise MalformedFileError(
            f"{len(data)} bytes are not a whole number of frames of {n_vertices} vertices as "
            f"{dtype} ({frame_bytes} bytes each).",
            remedy="Check the number of vertices and the type; the file may be cut short.",
            details={"bytes": len(data), "frame_bytes": frame_bytes},
        )
    limits.require("frames", n_frames)
    limits.require("vertices", n_vertices)
    vertices = np.frombuffer(data, kind).reshape(n_frames, n_vertices, 3)
    try:
        sequence = mesh_sequence(vertices, grid=grid)
    except NonFiniteError as error:
        # The first sign of numbers of another type or byte order.
        error.remedy = (
            f"Check that the numbers are little-endian {dtype}, and repair or leave out the "
            "frame if they are."
        )
        raise
    return Reading(sequence, format="raw")


def write_raw(sequence: MeshSequence, dtype: str = "float32") -> bytes:
    """Write the positions as raw little-endian numbers, and nothing else.

    Raises
    ------
    ParameterError
        If the type is neither "float32" nor "float64", or a position is beyond it.
    """
    if dtype not in RAW_TYPES:
        raise ParameterError(
            f"The type {dtype[:20]!r} is not understood.", remedy="Use float32 or float64."
        )
    if dtype == "float32":
        return single_precision(sequence.vertices, "A position").tobytes()
    return sequence.vertices.astype(RAW_TYPES[dtype]).tobytes()
