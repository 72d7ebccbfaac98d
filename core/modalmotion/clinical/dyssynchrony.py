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
_INSTANTS: Final = 1000

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
    variances = np.empty(n)
    for k in range(n):
        of_x, of_g, of_l = (
            np.where((segment == k).reshape(rows, columns, 1), each, 0.0)
            for each in (by_a, by_g, by_l)
        )
        of_x -= of_x.mean(axis=1, keepdims=True)
        of_l = np.broadcast_to(of_l.mean(axis=1, keepdims=True), grid)
        gradient = motion.places.values.T @ of_x.reshape(-1, 3)
        gradient += motion.places.around.T @ of_g.reshape(-1, 3)
        gradient += motion.places.along.T @ of_l.reshape(-1, 3)
        variances[k] = motion.variance(gradient, frame)
    return variances


def dyssynchrony(
    volumes: NDArray[np.float64],
    phases: NDArray[np.float64],
    variances: NDArray[np.float64],
) -> tuple[float, float, float] | None:
    """Measure the spread of the times of smallest volume.

    Parameters
    ----------
    volumes : (frames, segments) float64
    phases : (frames,) float64
        Of one cycle, 0 to 1.
    variances : (segments,) float64
        Of the noise of the volumes.

    Returns
    -------
    (float, float, float) or None
        Standard deviation of the times, and its 95 % interval, percent of the cycle. None if more
        than an eighth of the cycle is between two frames.

    Notes
    -----
    Volumes are periodic cubic splines through the frames. Noise increases the spread, most where
    curves are flat: the spread that it gives segments that all follow the whole volume is
    subtracted from the square. The interval includes the noise, the difference from straight lines
    between the frames, and the spacing of the frames.
    """
    phases = phases - phases[0]
    is_first = phases < 1.0 - 1e-9  # of the cycle, without a repeated first frame
    phases, volumes = phases[is_first], volumes[is_first]
    gaps = np.diff(phases, append=1.0)
    if gaps.max() > _LARGEST_GAP or gaps.min() <= 0.0:
        return None
    instants = np.arange(_INSTANTS) / _INSTANTS
    closed = np.append(phases, 1.0)
    by_frame = np.eye(len(phases))[np.arange(len(closed)) % len(phases)]
    curves = scipy.interpolate.CubicSpline(closed, by_frame, bc_type="periodic")(instants)
    # As all would be if each followed the whole volume.
    moving = volumes - volumes.mean(axis=0)
    whole = moving.sum(axis=1)
    alike = np.outer(whole, whole @ moving / (whole @ whole or 1.0))
    rng = np.random.default_rng(_SEED)
    noises = rng.normal(size=(_DRAWS, *volumes.shape)) * np.sqrt(variances)
    by_noise = np.mean([_apart(curves @ (alike + noise)) ** 2 for noise in noises])
    own = _apart(curves @ volumes)
    by_errors = np.std([_apart(curves @ (volumes + noise)) for noise in noises])
    by_lines = (
        _apart(scipy.interpolate.interp1d(closed, by_frame, axis=0)(instants) @ volumes) - own
    )
    # Of the deviation of n times that are each uniform between two frames.
    by_frames = gaps.mean() / np.sqrt(12.0 * 2.0 * (volumes.shape[1] - 1))
    reach = TWO_DEVIATIONS * np.sqrt(by_errors**2 + by_lines**2 + by_frames**2)
    ends = np.maximum([own, own - reach, own + reach], 0.0)
    value, low, high = 100.0 * np.sqrt(np.maximum(ends**2 - by_noise, 0.0))
    return float(value), float(low), float(max(high, 100.0 * reach))


def _apart(curves: NDArray[np.float64]) -> float:
    """Spread of the instants at which curves are smallest, as a share of the cycle."""
    times = curves.argmin(axis=0) / len(curves)
    # About the mean direction: a cycle has no first instant.
    mean = np.angle(np.exp(2j * np.pi * times).mean()) / (2 * np.pi)
    return float((np.mod(times - mean + 0.5, 1.0) - 0.5).std(ddof=1))
