"""How unevenly the segments of a ventricle contract in time.

The systolic dyssynchrony index is the standard deviation of the times at which the volumes of the
16 segments are smallest, percent of the cycle (Kapetanakis et al., Circulation, 2005).
"""

from __future__ import annotations

from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from modalmotion.clinical.volume_curve import TWO_DEVIATIONS
from modalmotion.clinical.wall_motion import WallMotion

# Largest share of a cycle between two frames, over its end too.
_LARGEST_GAP: Final = 1 / 8 + 1e-9

# Instants of a cycle among which the smallest volume is searched.
_INSTANTS: Final = np.arange(1000) / 1000

# Of the noise of volumes, always the same.
_DRAWS: Final = 100
_SEED: Final = 16


def segment_volumes(motion: WallMotion, segment: NDArray[np.int64], n: int) -> NDArray[np.float64]:
    """Measure the volume between each segment of the wall and the middle line of the cavity.

    Parameters
    ----------
    motion : WallMotion
    segment : (places,) int64
    n : int
        Segments.

    Returns
    -------
    (frames, n) float64, length unit cubed
    """
    rows, columns = motion.places.shape
    grid = rows, columns, motion.n_frames, 3
    x = np.tensordot(motion.places.values, motion.coefficients, axes=1).reshape(grid)
    away = x - x.mean(axis=1, keepdims=True)
    along = motion.slopes.along.reshape(grid).mean(axis=1, keepdims=True)
    sectors = np.cross(away, motion.slopes.around.reshape(grid)) / 2.0
    parts = (sectors * along).sum(axis=3) * motion.weights[:, :, None]
    flat = parts.reshape(rows * columns, motion.n_frames)
    volumes = np.stack([flat[segment == k].sum(axis=0) for k in range(n)], axis=1)
    return np.asarray(volumes * np.sign(volumes.sum()), dtype=np.float64)


def volume_variances(
    motion: WallMotion, segment: NDArray[np.int64], n: int, frame: int
) -> NDArray[np.float64]:
    """Variance of each segment's volume from the errors of positions, (n,) float64.

    By the gradient of `segment_volumes`, a sum of (a x g) . l / 2, with a from the middle line to
    the wall, g around it and l along the middle line.
    """
    rows, columns = motion.places.shape
    grid = rows, columns, 3
    x = (motion.places.values @ motion.coefficients[:, frame]).reshape(grid)
    a = x - x.mean(axis=1, keepdims=True)
    g = motion.slopes.around[:, frame].reshape(grid)
    l = motion.slopes.along[:, frame].reshape(grid).mean(axis=1, keepdims=True)  # noqa: E741
    half = motion.weights[:, :, None] / 2.0
    by_a, by_g, by_l = half * np.cross(g, l), half * np.cross(l, a), half * np.cross(a, g)
    own = (segment[:, None] == np.arange(n)).reshape(rows, columns, n, 1)
    of_x, of_g, of_l = (own * each[:, :, None] for each in (by_a, by_g, by_l))
    of_x -= of_x.mean(axis=1, keepdims=True)
    of_l = np.broadcast_to(of_l.mean(axis=1, keepdims=True), (*own.shape[:3], 3))
    places, gradients = motion.places, np.zeros((motion.places.values.shape[1], n, 3))
    for shapes, each in ((places.values, of_x), (places.around, of_g), (places.along, of_l)):
        gradients += np.tensordot(shapes.T, each.reshape(rows * columns, n, 3), axes=1)
    return np.array([motion.variance(gradients[:, k], frame) for k in range(n)])


def dyssynchrony(
    volumes: NDArray[np.float64],
    phases: NDArray[np.float64],
    variances: NDArray[np.float64],
    *,
    is_smooth: bool = False,
) -> tuple[float, float, float] | None:
    """Measure the spread of the times of smallest volume.

    Parameters
    ----------
    volumes : (frames, segments) float64
    phases : (frames,) float64
        Of one cycle, 0 to 1.
    variances : (frames, segments) float64
        Of the noise of the volumes.
    is_smooth : bool
        Whether errors of neighbouring frames are alike, as those of a track are. Nothing of the
        volumes is noise then, and the interval alone includes the errors.

    Returns
    -------
    (float, float, float) or None
        Standard deviation of the times, and its 95 % interval, percent of the cycle. None if more
        than an eighth of the cycle is between two frames.

    Notes
    -----
    Volumes are periodic cubic splines through the frames, of which each harmonic counts by the
    share of its power that is not noise (Wiener): that of the parts which follow the whole volume,
    and that of the rest. What noise remains increases the spread, most where curves are flat: the
    spread that it gives segments that all follow the whole volume is subtracted from the square.
    The interval includes the noise, what both take off, the difference from straight lines
    between the frames, and the spacing of the frames.
    """
    phases = phases - phases[0]
    is_first = phases < 1.0 - 1e-9  # of the cycle, without a repeated first frame
    phases, volumes, variances = phases[is_first], volumes[is_first], variances[is_first]
    gaps = np.diff(phases, append=1.0)
    if gaps.max() > _LARGEST_GAP or gaps.min() <= 0.0:
        return None
    closed = np.append(phases, 1.0)
    by_frame = np.eye(len(phases))[np.arange(len(closed)) % len(phases)]
    splines = scipy.interpolate.CubicSpline(closed, by_frame, bc_type="periodic")(_INSTANTS)
    lines = scipy.interpolate.interp1d(closed, by_frame, axis=0)(_INSTANTS)
    harmonics = np.fft.rfft(splines, axis=0)
    noise = np.abs(harmonics) ** 2 @ variances.sum(axis=1) * (not is_smooth)

    def kept(parts: NDArray[np.float64]) -> NDArray[np.float64]:
        power = (np.abs(harmonics @ parts) ** 2).sum(axis=1)
        share = 1.0 - np.divide(noise, power, out=np.ones_like(power), where=power > noise)
        return np.asarray(np.fft.irfft(share[:, None] * harmonics, len(_INSTANTS), axis=0))

    alike, rest = _parts(volumes)
    of_alike, of_rest = kept(alike), kept(rest)

    def spread(values: NDArray[np.float64]) -> float:
        alike, rest = _parts(values)
        return _apart(of_alike @ alike + of_rest @ rest)

    rng = np.random.default_rng(_SEED)
    draws = rng.normal(size=(_DRAWS, *volumes.shape)) * np.sqrt(variances)
    by_noise = np.array([spread(alike + draw) for draw in draws])
    own = spread(volumes)
    without = np.sqrt(max(own**2 - (by_noise**2).mean(), 0.0))
    whole = _apart(splines @ volumes)
    by_lines = _apart(lines @ volumes) - whole
    # Of the deviation of n times that are each uniform between two frames.
    by_frames = gaps.mean() / np.sqrt(12.0 * 2.0 * (volumes.shape[1] - 1))
    squares = by_noise.var() + (whole - without) ** 2 + by_lines**2 + by_frames**2
    reach, value = TWO_DEVIATIONS * np.sqrt(squares), own if is_smooth else without
    value, low, high = 100.0 * np.maximum([value, value - reach, value + reach], 0.0)
    return float(value), float(low), float(high)


def _parts(volumes: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Motion of segments as if each followed the whole volume, and the rest of it."""
    moving = volumes - volumes.mean(axis=0)
    whole = moving.sum(axis=1)
    alike = np.outer(whole, whole @ moving / (whole @ whole or 1.0))
    return alike, moving - alike


def _apart(curves: NDArray[np.float64]) -> float:
    """Spread of the instants at which curves are smallest, as a share of the cycle."""
    times = curves.argmin(axis=0) / len(curves)
    # About the mean direction: a cycle has no first instant.
    mean = np.angle(np.exp(2j * np.pi * times).mean()) / (2 * np.pi)
    return float((np.mod(times - mean + 0.5, 1.0) - 0.5).std(ddof=1))
