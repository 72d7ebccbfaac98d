"""Search for blocks and steps that meet an error or a size."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import numpy as np

from modalmotion.arguments.checking import Saved
from modalmotion.codec import spatial_modes, temporal
from modalmotion.codec.parts import PRICE, Articulated, Trial, find_parts, leading, rough_bits
from modalmotion.representation import FloatArray, Floats, shown


@dataclass(eq=False)
class ModalBlock:
    """Modal coefficients of some frames, and values derived from them.

    Parameters
    ----------
    amplitudes : (frames, 3, modes) float64, quanta
        About the origin; the modes are orthonormal.
    offsets : (frames, 3, vertices) float64, quanta, optional
        What they are the coefficients of.
    modes : OrthonormalModes, optional
        Together with the offsets: to look for parts that move as one.
    """

    amplitudes: Floats
    offsets: Floats | None = None
    modes: spatial_modes.OrthonormalModes | None = None
    _articulated: list[Articulated | None] = field(default_factory=list)

    @cached_property
    def cosines(self) -> Floats:
        """Coefficients of cosines over time, (3 x components, modes), slow ones first."""
        return temporal.cosine_basis(len(self.amplitudes)).project(self.amplitudes)

    @cached_property
    def components(self) -> Floats:
        """Numbers of the learned components, unrounded, (components, frames x 3)."""
        return temporal.basis_numbers(temporal.learned_components(self.amplitudes))

    def articulated(self, step: float) -> Articulated | None:
        """Parts that move as one, found at the first step asked for; None if there are none."""
        if not self._articulated:
            found = None
            if self.offsets is not None and self.modes is not None:
                found = find_parts(self.amplitudes, self.offsets, self.modes, step)
            self._articulated.append(found)
        return self._articulated[0]


def attempt(motion: ModalBlock, kind: temporal.Temporal, step: float) -> Trial | None:
    """Quantise some frames at one step.

    Parameters
    ----------
    motion : ModalBlock
    kind : Temporal
    step : float, quanta

    Returns
    -------
    Trial or None
        None if the step is finer than the numbers themselves.
    """
    # As the stream holds it.
    step = float(np.float32(step))
    if kind == temporal.Temporal.PARTS:
        parts = motion.articulated(step)
        return None if parts is None else parts.attempt(step)
    if kind == temporal.Temporal.DCT:
        exact = motion.cosines
        if not temporal.is_countable(exact, step):
            return None
        numbers = temporal.quantise(exact, step, PRICE)
        n_rows = 3 * max(1, -(-temporal.last_used(numbers.any(axis=1)) // 3))
        quantiser = temporal.fit_quantiser(exact[:n_rows], numbers[:n_rows], step)
        error = ((exact[:n_rows] - quantiser.restore(numbers[:n_rows])) ** 2).sum()
        error += (exact[n_rows:] ** 2).sum()
        empty = np.zeros((0, 0), dtype=np.int64)
        return Trial(kind, quantiser, empty, numbers[:n_rows], float(error))
    return _attempt_trajectories(motion, step)


def _attempt_trajectories(motion: ModalBlock, step: float) -> Trial | None:
    kind, n_frames, exact_basis = (
        temporal.Temporal.TRAJECTORY,
        len(motion.amplitudes),
        motion.components,
    )
    if not temporal.is_countable(exact_basis, step):
        return None
    exact_basis = exact_basis[: int(np.count_nonzero(np.abs(exact_basis).max(axis=1) > step / 2))]
    basis = temporal.quantise(exact_basis, step, PRICE)
    basis = basis[: leading(basis.any(axis=1))]
    for last in (False, True):
        exact_basis = exact_basis[: len(basis)]
        quantiser = temporal.fit_quantiser(exact_basis, basis, step)
        time_basis = temporal.restore_basis(kind, basis, n_frames, quantiser)
        exact = time_basis.project(motion.amplitudes)
        if not temporal.is_countable(exact, step):
            return None
        numbers = temporal.quantise(exact, step, PRICE)
        if last or not len(basis):
            break
        restored = temporal.Quantiser(step, (0, 0, 0)).restore(numbers[3:])
        gain = (exact[3:] ** 2 - (exact[3:] - restored) ** 2).sum(axis=1)
        bits = rough_bits(numbers[3:]) + rough_bits(basis)
        worth = np.cumsum(gain / step**2 - PRICE * bits)
        n_worth = int(np.argmax(worth)) + 1 if worth.max() > 0 else 0
        if n_worth == len(basis):
            break
        basis = basis[:n_worth]
    together = temporal.fit_quantiser(
        np.concatenate([exact_basis.ravel(), exact.ravel()]),
        np.concatenate([basis.ravel(), numbers.ravel()]),
        step,
    )
    if together.shifts != quantiser.shifts:
        time_basis = temporal.restore_basis(kind, basis, n_frames, together)
    rows = together.restore(numbers)
    error = ((motion.amplitudes - time_basis.superpose(rows)) ** 2).sum()
    return Trial(kind, together, basis, numbers, float(error))


CLOSE_ENOUGH: Final = 0.996
MOST_ATTEMPTS: Final = 12


def coarsest(
    motion: ModalBlock, kind: temporal.Temporal, squared_error: float, start: float
) -> Trial | None:
    """Find the coarsest step whose squared error stays within a bound.

    Parameters
    ----------
    motion : ModalBlock
    kind : Temporal
    squared_error : float, quanta squared
        Summed over frames and vertices.
    start : float, quanta
        Step to try first.

    Returns
    -------
    Trial or None
        None if the finest step tried is still too coarse.
    """
    best: Trial | None = None
    low, high = -np.inf, np.inf
    log_step, slope = np.log(start), 1.6
    goal, boldness = np.log(squared_error), 0.01
    for _ in range(MOST_ATTEMPTS):
        trial = attempt(motion, kind, float(np.exp(log_step)))
        if trial is None:
            break
        error = np.log(max(trial.squared_error, 1e-300))
        if error <= goal:
            if best is None or trial.quantiser.step > best.quantiser.step:
                best = trial
            low = max(low, log_step)
            if error >= goal + 2 * np.log(CLOSE_ENOUGH) or trial.quantiser.step > 1e30:
                break
        else:
            high = min(high, log_step)
        if high - low < 1e-3:
            break
        # Aim a little below the goal, boldly where the error stays level, within the bracket.
        change = np.clip((goal - 0.004 - error) / slope, -4.0, 4.0)
        if not np.isfinite(low):
            boldness *= 2.0
            change = min(change, -boldness)
        target = log_step + change
        if not low < target < high:
            target = (low + high) / 2
        if np.isfinite(low) and np.isfinite(high):
            width = high - low
            target = min(max(target, low + 0.02 * width), high - 0.02 * width)
        log_step = target
    return best


def least(cost: Callable[[float], int], start: float, ratio: float, most: int) -> float:
    """Walk from a start in steps of a ratio to where the cost is least, then look between steps.

    Parameters
    ----------
    cost : callable
        Keeps what it was asked: the last one, between two steps, may be the least of all.
    start : float
    ratio : float
    most : int
        Costs that are asked for.

    Returns
    -------
    float
        The best argument of those a whole number of steps from the start.
    """
    tried = {0: cost(start)}
    best = 0
    for direction in (1, -1):
        while len(tried) < most and best + direction not in tried:
            tried[best + direction] = cost(start * ratio ** (best + direction))
            if tried[best + direction] >= tried[best]:
                break
            best += direction
    if len(tried) < most and {best - 1, best + 1} <= tried.keys():
        low, middle, high = (tried[best + side] for side in (-1, 0, 1))
        if low + high > 2 * middle:
            # Where a parabola through the three is least, which is between them.
            cost(start * ratio ** (best + 0.5 * (low - high) / (low + high - 2 * middle)))
    return float(start * ratio**best)


MOST_TRIALS: Final = 14
# Of the size that is allowed: where to aim, and what is close enough.
AIM: Final = 0.995
FULL_ENOUGH: Final = 0.99
# Ratios of errors, as logarithms, that are worth no more trials: between two streams, and between a
# stream and what is too fine for one.
CLOSE: Final = 0.01
COARSE: Final = 0.1


def try_sizes(
    size: Callable[[float], int | None],
    most: int,
    bracket: tuple[float, float],
    start: float,
    slope: float,
) -> None:
    """Try errors until one has nearly the largest size that is allowed.

    At fine errors the size falls straight with the logarithm of the error: a bit for each
    coefficient where the error is halved. Lines through the last two trials find it.

    Parameters
    ----------
    size : callable
        Bytes at the logarithm of an error; None if it is too fine for a stream. Whoever asks
        keeps the best.
    most : int
        Bytes.
    bracket : (float, float)
        Logarithms of the least and of the largest error.
    start : float
        Logarithm of the first.
    slope : float
        Bytes that an error e times smaller costs at most.
    """
    low, high = bracket
    log_error, before, close = start, None, COARSE
    for _ in range(MOST_TRIALS):
        n_bytes = size(log_error)
        if n_bytes is None or n_bytes > most:
            low, close = log_error, COARSE if n_bytes is None else CLOSE
        else:
            high = log_error
            if n_bytes > FULL_ENOUGH * most:
                return
        if high - low < close:
            return
        guess = np.nan
        if n_bytes is not None:
            if before is not None and before[1] != n_bytes:
                slope = (before[1] - n_bytes) / (log_error - before[0])
            guess = log_error + (n_bytes - AIM * most) / slope
            before = log_error, n_bytes
        log_error = guess if low < guess < high else (low + high) / 2


@dataclass(frozen=True)
class Errors:
    """Errors of a sequence against its original.

    Parameters
    ----------
    rms : float, length unit
        sqrt(mean over frames and vertices of |v - v'|^2).
    max_error : float, length unit
        max |v - v'|.
    kg_error : float, percent
        100 |A - A'| / |A - E|, E the centroid of each frame (Karni and Gotsman, Compression of
        soft-body animation sequences, Computers & Graphics, 2004).
    """

    rms: float
    max_error: float
    kg_error: float


def measure(original: FloatArray, decoded: FloatArray) -> Errors:
    """Compare two arrays of positions, (frames, vertices, 3)."""
    scale = 2.0 ** float(np.clip(_exponent(original), -1000, 1000))
    squares = spread = largest = 0.0
    for a, b in zip(original, decoded, strict=True):
        exact = a.astype(np.float64) / scale
        with np.errstate(over="ignore", invalid="ignore"):
            far = ((b.astype(np.float64) / scale - exact) ** 2).sum(axis=1)
            squares += float(far.sum())
            largest = max(largest, float(far.max()))
        spread += float(((exact - exact.mean(axis=0)) ** 2).sum())
    n = original.shape[0] * original.shape[1]
    kg_error = 100.0 * math.sqrt(squares / spread) if spread > 0 else 0.0
    return Errors(math.sqrt(squares / n) * scale, math.sqrt(largest) * scale, kg_error)


def _exponent(original: FloatArray) -> int:
    return int(np.frexp(max(float(np.abs(frame).max()) for frame in original))[1])


@shown("n_frames", "n_vertices", "n_bytes", "rms", "max_error", "kg_error", "transform")
@dataclass(frozen=True)
class Encoded(Saved):
    """A stream and what was measured after decoding it.

    Parameters
    ----------
    data : bytes
    rms : float, length unit
        Root mean square of the distances of vertices from their originals, over all of them and
        all frames.
    max_error : float, length unit
        Largest distance of a vertex from its original in any frame.
    kg_error : float, percent
        100 |A - A'| / |A - E|, E the centroid of each frame; 0 where no frame extends.
    n_frames, n_vertices : int
    transform : str
        Modes and temporal components that were chosen.
    """

    data: bytes
    rms: float
    max_error: float
    kg_error: float
    n_frames: int
    n_vertices: int
    transform: str

    @property
    def n_bytes(self) -> int:
        """Bytes of the whole stream."""
        return len(self.data)

    @property
    def bits_per_vertex_and_frame(self) -> float:
        """Bits of the whole stream over vertices and frames."""
        return 8.0 * len(self.data) / (self.n_frames * self.n_vertices)
