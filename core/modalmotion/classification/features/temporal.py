"""A trajectory over its time: first harmonics of a cycle, first cosines of a course."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.signature.making import ModalSignature

N_SMOOTH: Final = 3
"""Harmonics that a smooth motion may hold, for telling it from noise."""

# Singular values of the design below this share are not determined by the frames.
_RANK_TOLERANCE: Final = 1e-8

# Factored designs in the cache: recordings of one device share their times.
_N_DESIGNS: Final = 32
# Share of the motion below which the last frame repeats the first: what float32 leaves of it.
_REPEATED: Final = 1e-4
# The step from the last frame to the first, and those beside it: from which frame to which.
_ENDS: Final = np.array([[-1, 1, -1], [0, 0, -2]])
# Share of its period that a recording must cover for its phases to be told by the period.
_MOST_OF_PERIOD: Final = 0.75
# Share by which times may exceed a period: both may have been rounded.
_ROUNDED: Final = 1e-6

Complex = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class _Design:
    """Functions of time that a trajectory is fitted by.

    Parameters
    ----------
    solve : (terms, frames) float64
        Pseudoinverse: coefficients by least squares, the least ones where frames are too few.
    span : (rank, frames) float64
        Orthonormal trajectories, all that the functions can follow.
    """

    solve: NDArray[np.float64]
    span: NDArray[np.float64]


class Turn(NamedTuple):
    """One turn of a recording.

    Parameters
    ----------
    signature : ModalSignature
        Without a last frame that repeats the first.
    share : (frames,) float64
        See `cycle_share`.
    """

    signature: ModalSignature
    share: NDArray[np.float64]


class Turns:
    """One turn of a signature, as long as its first modes say that it is: see `one_turn`.

    Parameters
    ----------
    signature : ModalSignature
    """

    def __init__(self, signature: ModalSignature) -> None:
        self._signature = signature
        self._made: dict[bool, Turn] = {}

    def of_first(self, n_modes: int = 0) -> Turn:
        """Turn that the first modes tell; all for 0."""
        # The modes of a reading say by themselves whether the last frame repeats the first.
        is_longer = bool(self._repeats[n_modes - 1])
        found = self._made.get(is_longer)
        if found is None:
            turn = without_last(self._signature) if is_longer else self._signature
            found = self._made[is_longer] = Turn(turn, cycle_share(turn))
        return found

    @cached_property
    def _repeats(self) -> NDArray[np.bool_]:
        return repeats_first(self._signature.amplitudes)


def one_turn(signature: ModalSignature) -> ModalSignature:
    """Leave a last frame out that repeats the first, for it belongs to the next turn.

    Only where it does so up to rounding, and not because it rests: in noise nobody can tell a
    frame that comes back from one that has almost done so, nor at rest one that is still there.
    The usual recording ends one step before.
    """
    return without_last(signature) if repeats_first(signature.amplitudes)[-1] else signature


def without_last(signature: ModalSignature) -> ModalSignature:
    """Signature without its last frame, as far as motions are read from it."""
    times = None if signature.times is None else signature.times[:-1]
    return replace(signature, amplitudes=signature.amplitudes[:-1], times=times)


def repeats_first(amplitudes: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether the last frame repeats the first; see `one_turn`.

    Parameters
    ----------
    amplitudes : (frames, modes, n) float64

    Returns
    -------
    (modes,) bool
        As the first mode, the first two and so on say. The first of all moves the whole, and
        says nothing.
    """
    n, n_modes, _ = amplitudes.shape
    repeats = np.zeros(n_modes, dtype=np.bool_)
    if n < 4 or n_modes < 2:
        return repeats
    a = amplitudes[:, 1:]
    # Most recordings end a step before. There the first of these modes says so for all counts:
    # what others add makes the gap no less, and nothing spreads by more than twice the norm.
    gap_of_first = max(map(abs, (a[-1, 0] - a[0, 0]).tolist()))
    if gap_of_first >= _REPEATED * 2.0 * math.sqrt(np.vdot(amplitudes, amplitudes)):
        return repeats
    steps = np.maximum.reduce(np.abs(a[_ENDS[0]] - a[_ENDS[1]]), axis=2)
    gap, first, last = np.maximum.accumulate(steps, axis=1)
    least = np.minimum(first, last)
    if not (gap < least).any():
        return repeats
    spread = np.maximum.reduce(np.maximum.reduce(a) - np.minimum.reduce(a), axis=1)
    limit = _REPEATED * np.maximum.accumulate(spread)
    repeats[1:] = (gap < limit) & (limit < least)
    return repeats


def elapsed_share(signature: ModalSignature) -> NDArray[np.float64]:
    """Time of each frame, (frames,) float64, 0 for the first and 1 for the last.

    Frames are evenly spaced where there are no times.
    """
    n = signature.n_frames
    if signature.times is None:
        return np.arange(n) / (n - 1)
    elapsed: NDArray[np.float64] = signature.times - signature.times[0]
    elapsed /= elapsed[-1]
    return elapsed


def cycle_share(signature: ModalSignature) -> NDArray[np.float64]:
    """Time of each frame as `elapsed_share` has it, or by the period where that is stated.

    In units in which `cycle_angle` gives the phase: a last frame that is a whole period after the
    first has the same. A recording of less than most of its period does not say what the rest is
    like, and is taken as a cycle of its own.
    """
    share, n = elapsed_share(signature), signature.n_frames
    period, times = signature.facts.period, signature.times
    if period is None or times is None:
        return share
    covered = float(times[-1] - times[0]) / period
    # Longer than its period is only what was made of other recordings.
    if not _MOST_OF_PERIOD <= covered <= 1.0 + _ROUNDED:
        return share
    return share * (covered * n / (n - 1))


def cycle_angle(share: NDArray[np.float64]) -> NDArray[np.float64]:
    """Phase in a cycle, (frames,) float64, rad, which ends one mean step after the last frame."""
    n = len(share)
    angle: NDArray[np.float64] = share * (2 * np.pi * ((n - 1) / n))
    return angle


def harmonics(share: NDArray[np.float64], signals: NDArray[np.float64], count: int) -> Complex:
    """First harmonics c_h of signals = mean + sum Re(c_h exp(-i h angle)), by least squares.

    Parameters
    ----------
    share : (frames,) float64
        See `elapsed_share`; of any spacing. One cycle is as in `cycle_angle`.
    signals : (frames, signals) float64
    count : int

    Returns
    -------
    (count, signals) complex128
        Zero where there are too few frames.
    """
    rows = harmonic_rows(share, signals, count)
    result = np.empty((count, signals.shape[1]), dtype=np.complex128)
    result.real = rows[:count]
    result.imag = rows[count:]
    return result


def harmonic_rows(
    share: NDArray[np.float64], signals: NDArray[np.float64], count: int
) -> NDArray[np.float64]:
    """Cosine and then sine parts of `harmonics`, (2 count, signals) float64.

    Of one signal (frames,) they are (2 count,).
    """
    rows: NDArray[np.float64] = _cycle_fit(share.tobytes(), count)[: 2 * count] @ signals
    return rows


def cycle_fit(
    share: NDArray[np.float64], signals: NDArray[np.float64], count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """`harmonic_rows` of signals, and the `followed_squares` of a cycle, in one product."""
    found = _cycle_fit(share.tobytes(), count) @ signals
    followed = found[2 * count :]
    squares: NDArray[np.float64] = np.vecdot(followed.T, followed.T)
    return found[: 2 * count], squares


def cosines(
    share: NDArray[np.float64], signals: NDArray[np.float64], count: int
) -> NDArray[np.float64]:
    """First terms c_k of signals = mean + sum c_k cos(k pi share), by least squares.

    Parameters
    ----------
    share : (frames,) float64
        Of any spacing, from 0 to 1.
    signals : (frames, signals) float64
    count : int

    Returns
    -------
    (count, signals) float64
        Zero where there are too few frames.
    """
    n_fitted = min(count, len(share) - 1)
    result = np.zeros((count, signals.shape[1]))
    result[:n_fitted] = (_design(share.tobytes(), n_fitted, is_cycle=False).solve @ signals)[1:]
    return result


def smooth_share(
    share: NDArray[np.float64], signals: NDArray[np.float64], *, is_cycle: bool
) -> float:
    """Share of a motion that its first terms hold beyond what they would hold of white noise.

    Parameters
    ----------
    share : (frames,) float64
    signals : (frames, signals) float64
        Without their means.
    is_cycle : bool

    Returns
    -------
    float
        1 for a smooth motion, 0 for noise; 1 where there are too few frames to tell.
    """
    count = N_SMOOTH if is_cycle else 2 * N_SMOOTH
    followed = followed_squares(share, signals, count, is_cycle=is_cycle)
    return smooth_share_of(len(share), float(np.vdot(signals, signals)), float(followed.sum()))


def followed_squares(
    share: NDArray[np.float64], signals: NDArray[np.float64], count: int, *, is_cycle: bool
) -> NDArray[np.float64]:
    """Sum over time of the squares of what the first terms follow of signals, (signals,)."""
    followed = _design(share.tobytes(), count, is_cycle=is_cycle).span @ signals
    squares: NDArray[np.float64] = np.einsum("ij,ij->j", followed, followed)
    return squares


def smooth_share_of(n_frames: int, total: float, followed: float) -> float:
    """Smooth share of a motion, of the sums of its squares and of what its first terms follow."""
    free = n_frames - 1 - 2 * N_SMOOTH
    if free < 2 or total == 0.0:
        return 1.0
    # The part that is not followed; rounding may make it negative.
    rest = max(0.0, total - followed)
    # Of white noise n - 1 - terms of n - 1 parts remain.
    return max(0.0, 1.0 - rest / free * (n_frames - 1) / total)


@lru_cache(maxsize=_N_DESIGNS)
def _cycle_fit(times: bytes, count: int) -> NDArray[np.float64]:
    """Rows that make harmonics of signals, zero where frames are too few, and their span."""
    n_frames = len(times) // 8
    n_fitted = min(count, max(1, (n_frames - 1) // 2))
    solve = _design(times, n_fitted, is_cycle=True).solve
    span = _design(times, N_SMOOTH, is_cycle=True).span
    rows = np.zeros((2 * count, n_frames))
    rows[:n_fitted] = solve[1 : 1 + n_fitted]
    rows[count : count + n_fitted] = solve[1 + n_fitted :]
    return np.concatenate([rows, span])


@lru_cache(maxsize=_N_DESIGNS)
def _design(times: bytes, count: int, *, is_cycle: bool) -> _Design:
    """Factor the design of a cycle's harmonics or a course's cosines; times as in `share`."""
    share = np.frombuffer(times)
    if is_cycle:
        h = np.arange(1, count + 1) * cycle_angle(share)[:, None]
        design = np.concatenate([np.ones((len(share), 1)), np.cos(h), np.sin(h)], axis=1)
    else:
        design = np.cos(np.pi * np.arange(count + 1) * share[:, None])
    U, s, Vt = np.linalg.svd(design, full_matrices=False)
    rank = np.count_nonzero(s > _RANK_TOLERANCE * s[0])
    span = U[:, :rank].T
    return _Design(solve=(Vt[:rank].T / s[:rank]) @ span, span=span.copy())
