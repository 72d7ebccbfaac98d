"""Encoding of a sequence's frames: the requested error or size, and transforms to choose from."""

import math
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final

import numpy as np

from modalmotion.arguments.checking import real, whole
from modalmotion.codec import coder, joined_modes, spatial_modes
from modalmotion.codec.block import MOST_QUANTA, Block, positions_of, write_block
from modalmotion.codec.parts import Trial
from modalmotion.codec.search import ModalBlock, attempt, coarsest, least, measure
from modalmotion.codec.temporal import Temporal
from modalmotion.errors import ParameterError
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.modes.topologies import CLOSED, OPEN, OPEN_CURVE, Topology
from modalmotion.progress import Progress, Reporter, part_of, silent
from modalmotion.representation import FloatArray, Floats, Ints, with_article


class Effort(StrEnum):
    """How much time the encoder may spend on trials, and the decoder on modes."""

    FAST = "fast"
    BALANCED = "balanced"


class Measure(StrEnum):
    """The quantity that a target bounds."""

    RMS = "rms"
    MAX_ERROR = "max_error"
    BYTES = "n_bytes"


@dataclass(frozen=True)
class Target:
    """One bound, and its quantity."""

    measure: Measure
    value: float


USUAL_SHARE: Final = 0.003
"""Largest error, as a share of the diagonal of the sequence's bounding box, if no target is set."""


def require_target(
    rms: float | None, max_error: float | None, n_bytes: int | None, usual: float
) -> Target:
    """Check that there is at most one target, positive and finite.

    Parameters
    ----------
    rms, max_error : float or None, length unit
    n_bytes : int or None
    usual : float, length unit
        Largest error if none of them is given.

    Raises
    ------
    ParameterError
        Otherwise.
    """
    bounds = {
        Measure.RMS: rms,
        Measure.MAX_ERROR: max_error,
        Measure.BYTES: n_bytes,
    }
    targets = [(measure, value) for measure, value in bounds.items() if value is not None]
    if not targets:
        return Target(Measure.MAX_ERROR, usual)
    if len(targets) > 1:
        raise ParameterError(
            f"Several targets are set: {', '.join(m for m, _ in targets)}.",
            remedy="Set one of rms, max_error and bytes (in Python n_bytes).",
        )
    measure, value = targets[0]
    value = (whole if measure == Measure.BYTES else real)(measure.value, value)
    if not (math.isfinite(value) and value > 0):
        raise ParameterError(
            f"The target {measure} = {value} is not positive and finite.",
            remedy="Ask for an error in the unit of the vertices, or a number of bytes.",
        )
    return Target(measure, float(value))


CUTS = {
    Effort.FAST: spatial_modes.Cut(patch=2048, leaf=128, share=50),
    Effort.BALANCED: spatial_modes.Cut(patch=spatial_modes.LARGEST_PATCH, leaf=256, share=96),
}
"""How meshes are cut for their spring modes."""


@dataclass(frozen=True, eq=False)
class Choice:
    """Modes, and the temporal bases to try with them.

    Parameters
    ----------
    modes : OrthonormalModes
    kinds : tuple of Temporal
    effort : Effort
    name : str
        Name of the modes for people.
    """

    modes: spatial_modes.OrthonormalModes
    kinds: tuple[Temporal, ...]
    effort: Effort
    name: str


def choose(sequence: MeshSequence, effort: Effort) -> Choice:
    """Choose the modes of a sequence, and the temporal bases to try."""
    on_lattice = sequence.grid is not None or not len(sequence.faces)
    if on_lattice:
        lattice = _lattice_modes(sequence)
        modes: spatial_modes.OrthonormalModes = lattice
        name = f"closed-form modes of {with_article(str(lattice.topology))}"
    else:
        springs = _spring_modes(sequence, CUTS[effort])
        modes = springs
        name = f"spring modes, patches: {len(springs.patches)}"
    kinds = tuple(Temporal)[: 2 if on_lattice else 3]
    if effort == Effort.FAST:
        kinds = (Temporal.DCT if on_lattice else Temporal.TRAJECTORY,)
    return Choice(modes, kinds, effort, name)


def _lattice_modes(sequence: MeshSequence) -> spatial_modes.LatticeModes:
    grid = sequence.grid or (sequence.n_vertices,)
    topology = sequence.topology
    if topology is None or topology.n_axes != len(grid):
        # Cosines suit any numbers in a row.
        topology = OPEN_CURVE if len(grid) == 1 else Topology((OPEN,) * len(grid))
    frame = sequence.vertices[0].astype(np.float64).reshape(*grid, 3)
    frame = frame / max(float(np.abs(frame).max()), np.finfo(np.float64).tiny)
    lengths = []
    for axis, ends in enumerate(topology.ends):
        steps = np.linalg.norm(np.diff(frame, axis=axis), axis=-1).sum(axis=axis)
        length = float(steps.mean()) * (1.0 + (ends == CLOSED) / max(grid[axis] - 1, 1))
        lengths.append(length)
    shortest = min((length for length in lengths if length > 0), default=1.0)
    fineness = tuple(
        int(np.clip(np.rint(64.0 * shortest / length), 1, 255)) if length > 0 else 64
        for length in lengths
    )
    return spatial_modes.LatticeModes(topology, grid, fineness)


def _spring_modes(sequence: MeshSequence, cut: spatial_modes.Cut) -> spatial_modes.PatchModes:
    n = sequence.n_vertices
    cut = replace(cut, patch=min(cut.patch, n), leaf=min(cut.leaf, n))
    while cut.work(n) > spatial_modes.MOST_WORK and cut.patch > 1:
        patch = cut.patch // 2
        cut = replace(cut, patch=patch, leaf=min(cut.leaf, patch))
    return spatial_modes.PatchModes(joined_modes.edges_of(sequence.faces), n, cut)


QUANTA_PER_RMS: Final = 16
QUANTA_PER_MAX: Final = 64
MOST_UNCERTAIN: Final = 1e-2
# Rounding may take more than its average, and modes that are not orthonormal more than their
# coefficients: how often to ask for less, at least by so much, and by so much more than is over.
MOST_SHARES: Final = 5
LESS: Final = 0.995
ROOM: Final = 0.998
# Share of progress for projecting and solving for modes; the search takes the rest.
SHARE_OF_MODES: Final = 0.3
# Bits that coefficients coded one by one may take: a fifth of a microsecond each, for the decoder
# too. A zero takes one; magnitudes of an error that is fine take twenty and gain next to nothing.
MOST_TIGHTENED: Final = {Effort.FAST: 0, Effort.BALANCED: 2**19}
N_STEPS: Final = 14
"""Bits that a magnitude takes before it is a number."""

MOST_STEPS: Final = {Effort.FAST: 1, Effort.BALANCED: 5}
STEP_RATIO: Final = 1.35
"""Steps that are tried under a largest error, and how far apart they are."""

FIRST_STEP: Final = {Measure.RMS: 7.0, Measure.MAX_ERROR: 3.0}


@dataclass(frozen=True, eq=False)
class EncodedBlock:
    """A block's bytes, their contents, and the positions they decode to."""

    data: bytes
    positions: FloatArray
    block: Block
    guards: coder.Guards
    corrections: Ints | None

    @property
    def kind(self) -> Temporal:
        """Its temporal basis."""
        return self.block.kind

    def tightened(self, most: int) -> "EncodedBlock":
        """Write the same in fewer bytes and more time, for at most so many bits."""
        mixed = replace(self.block, mixed=True)
        if sum(map(count_bits, (mixed.basis, mixed.coefficients, mixed.maps))) > most:
            return self
        data = write_block(mixed, self.guards, self.corrections, self.positions)
        return self if len(data) >= len(self.data) else replace(self, data=data, block=mixed)


@dataclass(frozen=True, eq=False)
class _Frames:
    """Frames in quanta about a whole origin.

    Parameters
    ----------
    vertices : (frames, vertices, 3), length unit
    exponent : int
    origin : (3,) int64, quanta
    offsets : (frames, 3, vertices) float64, quanta
    motion : ModalBlock
    """

    vertices: FloatArray
    exponent: int
    origin: Ints
    offsets: Floats
    motion: ModalBlock


def encode_frames(
    vertices: FloatArray, choice: Choice, target: Target, report: Reporter = silent
) -> EncodedBlock | None:
    """Encode some frames at an error.

    Returns
    -------
    EncodedBlock or None
        None if the target is finer than this way of coding can guarantee.
    """
    frames = _prepare(vertices, choice, target)
    if frames is None:
        return None
    error = float(np.ldexp(target.value, -frames.exponent))
    search = _at_rms if target.measure == Measure.RMS else _at_max_error
    report(Progress(SHARE_OF_MODES))
    # Known before the search, which at such an error takes longest.
    if _least_uncertainty(frames, choice) > MOST_UNCERTAIN:
        return None
    best = search(frames, choice, target, error, part_of(report, SHARE_OF_MODES, 0.9))
    return None if best is None else best.tightened(MOST_TIGHTENED[choice.effort])


def _prepare(vertices: FloatArray, choice: Choice, target: Target) -> _Frames | None:
    finest = target.value / (
        np.sqrt(3.0) * QUANTA_PER_RMS if target.measure == Measure.RMS else QUANTA_PER_MAX
    )
    exponent = int(np.frexp(finest)[1]) - 1
    largest = float(np.abs(vertices).max())
    if exponent < -1070 or exponent > 1000 or np.frexp(largest)[1] - exponent > 50:
        return None
    scaled = np.ldexp(vertices.astype(np.float64), -exponent).transpose(0, 2, 1)
    origin = np.rint(scaled.mean(axis=(0, 2))).astype(np.int64)
    offsets = np.ascontiguousarray(scaled - origin[:, None])
    n_frames, _, n_vertices = offsets.shape
    amplitudes = choice.modes.analyse(offsets.reshape(-1, n_vertices))
    motion = ModalBlock(amplitudes.reshape(n_frames, 3, n_vertices), offsets, choice.modes)
    return _Frames(vertices, exponent, origin, offsets, motion)


def _at_rms(
    frames: _Frames, choice: Choice, target: Target, error: float, report: Reporter
) -> EncodedBlock | None:
    n_frames, _, n_vertices = frames.offsets.shape
    # Rounding to whole quanta adds a twelfth to each coordinate's square.
    allowed = (error**2 - 0.25) * n_frames * n_vertices
    start = FIRST_STEP[Measure.RMS] * error
    best: EncodedBlock | None = None
    for number, kind in enumerate(choice.kinds, start=1):
        if kind == Temporal.PARTS and not _is_promising(frames.motion, start):
            continue
        share = 1.0
        for _ in range(MOST_SHARES):
            trial = coarsest(frames.motion, kind, allowed * share, start)
            done = None if trial is None else _finish(frames, choice, trial)
            if trial is None or done is None:
                break
            start = trial.quantiser.step
            over = measure(frames.vertices, done.positions).rms / target.value
            if over <= 1.0:
                best = _shorter(best, done)
                break
            share *= min(LESS, ROOM / over**2)
        report(Progress(number, len(choice.kinds)))
    return best


def _at_max_error(
    frames: _Frames, choice: Choice, target: Target, error: float, report: Reporter
) -> EncodedBlock | None:
    # Half a step of each coordinate's correction and the rounding to the type of the vertices
    # stay within.
    largest = float(np.abs(frames.vertices).max())
    rounding = float(np.spacing(np.asarray(largest, dtype=frames.vertices.dtype)))
    room = (error - np.sqrt(3.0) * float(np.ldexp(rounding, -frames.exponent))) * (1.0 - 1e-6)
    width = int(np.floor(2.0 * room / np.sqrt(3.0)))
    if width < 2:
        return None
    blocks: dict[float, EncodedBlock | None] = {}
    best: EncodedBlock | None = None
    start = FIRST_STEP[Measure.MAX_ERROR] * error
    most = MOST_STEPS[choice.effort]
    for number, kind in enumerate(choice.kinds, start=1):
        if kind == Temporal.PARTS and not _is_promising(frames.motion, start):
            continue

        def size(step: float, kind: Temporal = kind) -> int:
            trial = attempt(frames.motion, kind, step)
            done = None if trial is None else _finish(frames, choice, trial, width, room)
            blocks[step] = done
            return 2**62 if done is None else len(done.data)

        start = least(size, start, STEP_RATIO, most)
        for done in blocks.values():
            if done is None or measure(frames.vertices, done.positions).max_error > target.value:
                continue
            best = _shorter(best, done)
        blocks.clear()
        report(Progress(number, len(choice.kinds)))
    return best


def _is_promising(motion: ModalBlock, step: float) -> bool:
    """Whether parts that move as one cost less than the motion as a whole, at one step."""
    parts = attempt(motion, Temporal.PARTS, step)
    whole = None if parts is None else attempt(motion, Temporal.TRAJECTORY, step)
    return parts is not None and (whole is None or parts.cost < whole.cost)


def _shorter(best: EncodedBlock | None, block: EncodedBlock) -> EncodedBlock:
    """Give the block of fewer bytes, the earlier one if they are equal."""
    return block if best is None or len(block.data) < len(best.data) else best


def _finish(
    frames: _Frames, choice: Choice, trial: Trial, width: int = 0, room: float = 0.0
) -> EncodedBlock | None:
    """Write a trial as a block, with guards and corrections from decoding it.

    Only vertices farther off than `room`, in quanta, are corrected, in steps of `width`. None if
    the numbers are too large, or other machines may round them otherwise.
    """
    if trial.largest > coder.LARGEST_MAGNITUDE:
        return None
    block = trial.block(len(frames.vertices), frames.exponent, frames.origin, width)
    scaled = block.scaled(choice.modes)
    if not np.abs(scaled).max() < MOST_QUANTA / 4:
        return None
    shaken = choice.modes.shaken
    uncertainty = _uncertainty(scaled, None if shaken is None else block.scaled(shaken))
    if uncertainty > MOST_UNCERTAIN:
        return None
    guards = coder.find_guards(scaled, uncertainty)
    whole = guards.round(scaled)
    corrections = None
    if width:
        corrections = fewest_corrections(frames.offsets - whole, width, room)
        whole += width * corrections
    positions = positions_of(block, whole, frames.vertices.dtype)
    data = write_block(block, guards, corrections, positions)
    return EncodedBlock(data, positions, block, guards, corrections)


def fewest_corrections(left: Floats, width: int, room: float) -> Ints:
    """Find steps that bring every vertex back within a distance, of as few coordinates as can be.

    Parameters
    ----------
    left : (frames, 3, vertices) float64, quanta
        Distances that are left of each coordinate.
    width : int, quanta
        Of a step; with all three coordinates corrected every vertex is back.
    room : float, quanta

    Returns
    -------
    (frames, 3, vertices) int64
        Steps to add.
    """
    corrections = np.zeros(left.shape, dtype=np.int64)
    frame, vertex = np.nonzero((left**2).sum(axis=1) > room**2)
    far = left[frame, :, vertex]
    steps = np.rint(far / width)
    gains = far**2 - (far - width * steps) ** 2
    # The coordinates that gain most first, until the vertex is near enough.
    order = np.argsort(-gains, axis=1, kind="stable")
    gained = np.cumsum(np.take_along_axis(gains, order, axis=1), axis=1)
    squares = (far**2).sum(axis=1, keepdims=True)
    is_needed = np.ones(far.shape, dtype=np.bool_)
    is_needed[:, 1:] = squares - gained[:, :-1] > room**2
    place = np.arange(len(far))[:, None], order
    steps[place] *= is_needed
    corrections[frame, :, vertex] = steps
    return corrections


def count_bits(values: Ints) -> int:
    """Count the bits that the magnitudes of a matrix are coded as, at most."""
    magnitudes = np.abs(values).astype(np.float64)
    beyond = magnitudes[magnitudes >= N_STEPS] - N_STEPS
    bits = np.floor(np.log2(beyond + 1.0)) + 1.0
    return int(np.minimum(magnitudes + 1.0, N_STEPS).sum() + bits.sum())


def _least_uncertainty(frames: _Frames, choice: Choice) -> float:
    """Uncertainty of the motion itself; a block at a fine error has nearly the same."""
    modes = choice.modes.shaken
    other = None
    if modes is not None:
        n = frames.motion.amplitudes.shape[2]
        other = modes.synthesise(frames.motion.amplitudes.reshape(-1, n))
    return 0.9 * _uncertainty(frames.offsets.reshape(-1, frames.offsets.shape[2]), other)


def _uncertainty(scaled: Floats, other: Floats | None) -> float:
    """Quanta by which another machine's sums may differ from these.

    Parameters
    ----------
    scaled : float64, quanta
    other : float64, quanta, optional
        The same from modes that were solved for with errors ten times those between machines.
    """
    rounding = 1e-6 + 1e-13 * float(np.abs(scaled).max())
    return rounding if other is None else rounding + 2.0 * float(np.abs(other - scaled).max())
