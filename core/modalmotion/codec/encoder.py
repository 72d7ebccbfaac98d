"""Encoding: a mesh sequence at a target error or size."""

from __future__ import annotations

import itertools
from typing import Final

import numpy as np

from modalmotion.codec.block import store_positions
from modalmotion.codec.container import (
    LARGEST_BLOCK,
    MOST_RELATIONS,
    Header,
    write_faces,
    write_stream,
)
from modalmotion.codec.frames import (
    USUAL_SHARE,
    Choice,
    Effort,
    EncodedBlock,
    Measure,
    Target,
    choose,
    encode_frames,
    require_target,
)
from modalmotion.codec.search import Encoded, Errors, measure
from modalmotion.codec.spatial_modes import STORED
from modalmotion.errors import ParameterError
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.progress import Progress, Reporter, part_of, silent

LONGEST_BLOCK: Final = 512

RELATIONS: Final = {Effort.FAST: (2,), Effort.BALANCED: (MOST_RELATIONS, 2)}
"""Numbers of relations to try in the numbering of the vertices: six take twice as long as none."""

FEW: Final = 512
"""Vertices of meshes whose modes are much the same at any effort: both are tried."""

# Connectivity beside the motion, roughly.
SHARE_OF_FACES: Final = 0.1


def encode(
    sequence: MeshSequence,
    *,
    rms: float | None = None,
    max_error: float | None = None,
    effort: Effort | str = Effort.BALANCED,
    progress: Reporter | None = None,
) -> Encoded:
    """Encode a mesh sequence at a given error.

    Without a target the largest error is 0.3 % of the diagonal of the bounding box.

    Parameters
    ----------
    sequence : MeshSequence
    rms : float, length unit, optional
        Root mean square of the distance of a vertex from its original, over all vertices and
        frames, that the stream does not exceed.
    max_error : float, length unit, optional
        Distance from its original that no vertex in any frame exceeds.
    effort : {"fast", "balanced"}
        How many transforms are tried, and for meshes without a lattice how large the
        eigenproblems of a decoder are: "fast" takes a third of the time, and on surfaces a sixth
        more bits. Vertices keep their order and triangles their orientation; the order of the
        triangles changes.
    progress : callable, optional
        Called with the percent that is done, and 100.

    Returns
    -------
    Encoded

    Raises
    ------
    ParameterError
        If there are two targets, one is not positive, or the effort is unknown.
    """
    target = require_target(rms, max_error, _usual_error(sequence))
    try:
        effort = Effort(effort)
    except ValueError:
        raise ParameterError(
            f"The effort {effort!r} is unknown.", remedy=f"Use one of {', '.join(Effort)}."
        ) from None
    report = progress or silent
    report(Progress(0.0))
    choice = choose(sequence, effort)
    faces = _faces_section(sequence, RELATIONS[effort])
    report(Progress(SHARE_OF_FACES))
    rest = part_of(report, SHARE_OF_FACES, 1.0)
    encoded = _at_error(sequence, choice, faces, target, rest)
    if effort == Effort.BALANCED and sequence.n_vertices <= FEW:
        quick = encode(sequence, rms=rms, max_error=max_error, effort=Effort.FAST)
        encoded = min(encoded, quick, key=lambda one: one.n_bytes)
    report(Progress(1.0))
    return encoded


def _usual_error(sequence: MeshSequence) -> float:
    corners = sequence.vertices.min(axis=(0, 1)), sequence.vertices.max(axis=(0, 1))
    return USUAL_SHARE * float(np.linalg.norm(np.subtract(*corners, dtype=np.float64)))


def _at_error(
    sequence: MeshSequence, choice: Choice, faces: bytes, target: Target, report: Reporter
) -> Encoded:
    # Finer than float64 distinguishes positions, or than its squares: only the numbers themselves
    # do.
    finest = float(np.finfo(np.float64).eps) * float(np.abs(sequence.vertices).max())
    if target.value <= max(finest, 1e-150):
        return _store(sequence, faces)
    blocks: list[EncodedBlock] = []
    n_blocks = max(
        -(-sequence.n_frames // LONGEST_BLOCK),
        min(sequence.n_frames, -(-sequence.vertices.size // LARGEST_BLOCK)),
    )
    bounds = [sequence.n_frames * i // n_blocks for i in range(n_blocks + 1)]
    for start, stop in itertools.pairwise(bounds):
        shares = start / sequence.n_frames, stop / sequence.n_frames
        inside = part_of(report, *shares)
        block = encode_frames(sequence.vertices[start:stop], choice, target, inside)
        if block is None:
            return _store(sequence, faces)
        blocks.append(block)
        inside(Progress(1.0))
    decoded = np.concatenate([block.positions for block in blocks])
    errors = measure(sequence.vertices, decoded)
    reached = errors.rms if target.measure == Measure.RMS else errors.max_error
    if not reached <= target.value:
        return _store(sequence, faces)
    frames = tuple(len(block.positions) for block in blocks)
    header = _header(sequence, choice.modes.write(), errors, frames)
    data = write_stream(header, faces, [block.data for block in blocks])
    names = sorted({block.kind.name.lower() for block in blocks})
    return _encoded(sequence, data, errors, f"{choice.name}, {' and '.join(names)}")


def _store(sequence: MeshSequence, faces: bytes) -> Encoded:
    """Encode without loss: for errors finer than the numbers themselves hold."""
    errors = Errors(0.0, 0.0, 0.0)
    frames = [
        sequence.vertices[start : start + LONGEST_BLOCK]
        for start in range(0, sequence.n_frames, LONGEST_BLOCK)
    ]
    header = _header(sequence, STORED, errors, tuple(len(part) for part in frames))
    data = write_stream(header, faces, [store_positions(part) for part in frames])
    return _encoded(sequence, data, errors, "stored without loss")


def _faces_section(sequence: MeshSequence, n_relations: tuple[int, ...]) -> bytes:
    if not len(sequence.faces):
        return b""
    lattice = None
    if sequence.grid is not None and sequence.topology is not None:
        lattice = (sequence.topology, sequence.grid)
    return write_faces(sequence.n_vertices, lattice, sequence.faces, n_relations)


def _header(
    sequence: MeshSequence, modes: bytes, errors: Errors, block_frames: tuple[int, ...]
) -> Header:
    return Header(
        sequence.n_frames,
        sequence.n_vertices,
        len(sequence.faces),
        sequence.vertices.dtype == np.float64,
        sequence.unit,
        sequence.topology,
        sequence.grid,
        sequence.times,
        modes,
        errors.rms,
        errors.max_error,
        errors.kg_error,
        block_frames,
    )


def _encoded(sequence: MeshSequence, data: bytes, errors: Errors, transform: str) -> Encoded:
    return Encoded(
        data,
        errors.rms,
        errors.max_error,
        errors.kg_error,
        sequence.n_frames,
        sequence.n_vertices,
        transform,
    )
