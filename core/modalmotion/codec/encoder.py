"""Encoding: a mesh sequence at a target error or size."""

import itertools
from typing import Final

import numpy as np

from modalmotion.codec import container, spatial_modes
from modalmotion.codec.block import store_positions
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
from modalmotion.codec.search import MOST_TRIALS, Encoded, Errors, measure, try_sizes
from modalmotion.errors import ParameterError
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.progress import Progress, Reporter, part_of, silent

LONGEST_BLOCK: Final = 512

RELATIONS: Final = {Effort.FAST: (2,), Effort.BALANCED: (container.MOST_RELATIONS, 2)}
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
    n_bytes: int | None = None,
    effort: Effort | str = Effort.BALANCED,
    progress: Reporter | None = None,
) -> Encoded:
    """Encode a mesh sequence at one of three targets.

    Without a target the largest error is 0.3 % of the diagonal of the bounding box.

    Parameters
    ----------
    sequence : MeshSequence
    rms : float, length unit, optional
        Root mean square of the distance of a vertex from its original, over all vertices and
        frames, that the stream does not exceed.
    max_error : float, length unit, optional
        Distance from its original that no vertex in any frame exceeds.
    n_bytes : int, optional
        Bytes that the stream does not exceed.
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
        If there are several targets, one is not positive, the effort is unknown, or no
        stream of so few bytes contains the sequence.
    """
    target = require_target(rms, max_error, n_bytes, _usual_error(sequence))
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
    if target.measure == Measure.BYTES:
        encoded = _within_bytes(sequence, choice, faces, int(target.value), rest)
    else:
        encoded = _at_error(sequence, choice, faces, target, rest)
    is_error = target.measure != Measure.BYTES
    if is_error and effort == Effort.BALANCED and sequence.n_vertices <= FEW:
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
        min(sequence.n_frames, -(-sequence.vertices.size // container.LARGEST_BLOCK)),
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
    data = container.write_stream(header, faces, [block.data for block in blocks])
    names = sorted({block.kind.name.lower() for block in blocks})
    return _encoded(sequence, data, errors, f"{choice.name}, {' and '.join(names)}")


def _store(sequence: MeshSequence, faces: bytes) -> Encoded:
    """Encode without loss: for errors finer than the numbers themselves hold."""
    errors = Errors(0.0, 0.0, 0.0)
    frames = [
        sequence.vertices[start : start + LONGEST_BLOCK]
        for start in range(0, sequence.n_frames, LONGEST_BLOCK)
    ]
    header = _header(sequence, spatial_modes.STORED, errors, tuple(len(part) for part in frames))
    data = container.write_stream(header, faces, [store_positions(part) for part in frames])
    return _encoded(sequence, data, errors, "stored without loss")


def _within_bytes(
    sequence: MeshSequence, choice: Choice, faces: bytes, n_bytes: int, report: Reporter
) -> Encoded:
    """Search the error whose stream just fits."""
    stored = _store(sequence, faces)
    best = stored if stored.n_bytes <= n_bytes else None
    extent = float(np.ptp(sequence.vertices.astype(np.float64), axis=(0, 1)).max())
    if best is not None or not (np.isfinite(extent) and extent > 0):
        return _require_fit(best, stored.n_bytes, n_bytes)
    trials: list[Encoded] = []

    def size(log_rms: float) -> int | None:
        share = len(trials) / MOST_TRIALS
        inside = part_of(report, share, share + 1 / MOST_TRIALS)
        target = Target(Measure.RMS, float(np.exp(log_rms)))
        trials.append(_at_error(sequence, choice, faces, target, inside))
        return None if trials[-1].rms == 0.0 else trials[-1].n_bytes

    bracket = np.log(extent) - 23.0, np.log(extent) + 2.0
    a_bit_each = sequence.vertices.size / (8.0 * np.log(2.0))
    try_sizes(size, n_bytes, bracket, np.log(extent) - 6.0, a_bit_each)
    fitting = [trial for trial in trials if trial.n_bytes <= n_bytes]
    best = min(fitting, key=lambda trial: trial.rms, default=None)
    return _require_fit(best, min(one.n_bytes for one in (stored, *trials)), n_bytes)


def _require_fit(best: Encoded | None, smallest: int, n_bytes: int) -> Encoded:
    if best is None:
        raise ParameterError(
            f"No stream of {n_bytes} bytes contains this sequence; the smallest has {smallest}.",
            remedy="Allow more bytes: connectivity and header alone take up some of them.",
            details={"smallest": smallest},
        )
    return best


def _faces_section(sequence: MeshSequence, n_relations: tuple[int, ...]) -> bytes:
    if not len(sequence.faces):
        return b""
    lattice = None
    if sequence.grid is not None and sequence.topology is not None:
        lattice = (sequence.topology, sequence.grid)
    return container.write_faces(sequence.n_vertices, lattice, sequence.faces, n_relations)


def _header(
    sequence: MeshSequence, modes: bytes, errors: Errors, block_frames: tuple[int, ...]
) -> container.Header:
    return container.Header(
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
