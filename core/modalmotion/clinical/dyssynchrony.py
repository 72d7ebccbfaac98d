"""How unevenly the segments of a ventricle contract in time.

The systolic dyssynchrony index is the standard deviation of the times at which the volumes of the
16 segments are least, percent of the cycle (Kapetanakis et al., Circulation, 2005).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.clinical.volume_curve import TWO_DEVIATIONS
from modalmotion.clinical.wall_motion import WallMotion

# Frames beyond the numbers of a curve; least and most harmonics.
_FREE: Final = 2
_LEAST: Final = 3
_MOST: Final = 12

# Uneven instants tell harmonics apart up to this condition.
_CONDITION: Final = 1e3

# Instants of a cycle among which the least volume is looked for.
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
    """Variance of each segment's volume by what is known of errors of positions, (n,) float64.

    A volume changes by what the wall sweeps along its normal.
    """
    swept = np.cross(motion.slopes.along[:, frame], motion.slopes.around[:, frame])
    swept *= motion.weights.reshape(-1, 1)
    gradients = (
        motion.places.values.T @ np.where((segment == k)[:, None], swept, 0.0) for k in range(n)
    )
    return np.array([motion.variance(gradient, frame) for gradient in gradients])


def dyssynchrony(
    volumes: NDArray[np.float64],
    phases: NDArray[np.float64],
    variances: NDArray[np.float64],
) -> tuple[float, float, float] | None:
    """Measure how far apart the times of least volume are.

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
        Standard deviation of the times, and its 95 % interval, percent of the cycle. None of too
        few frames.

    Notes
    -----
    Volumes are continuous curves of as many harmonics as frames tell, up to a dozen: fewer are too
    round for the ends of phases without flow. Noise moves times apart, most where curves are flat:
    what it makes of segments that all follow the whole volume is taken off the square.
    """
    n_frames = len(volumes)
    most = (n_frames - 1 - _FREE) // 2
    if most < _LEAST or np.ptp(phases) < 0.5:
        return None
    if np.linalg.cond(_series(phases, most, 0)) > _CONDITION:
        return None
    harmonics = min(most, _MOST)
    series = {h: _series(phases, h, 0) for h in (harmonics - 1, harmonics)}
    fewer, coefficients = (np.linalg.lstsq(T, volumes, rcond=None)[0] for T in series.values())
    # As all would be if each followed the whole volume.
    whole = coefficients[1:].sum(axis=1)
    alike = coefficients.copy()
    alike[1:] = np.outer(whole, whole @ coefficients[1:] / (whole @ whole))
    # Columns of L have the covariance of the coefficients for noise of variance 1.
    L = np.linalg.inv(np.linalg.qr(series[harmonics], mode="r"))
    instants = np.arange(_INSTANTS) / _INSTANTS
    curves = _series(instants, harmonics, 0)
    rng = np.random.default_rng(_SEED)
    moves = L @ rng.normal(size=(_DRAWS, *coefficients.shape)) * np.sqrt(variances)
    by_noise = np.mean([_apart(curves @ (alike + move)) ** 2 for move in moves])
    own = _apart(curves @ coefficients)
    by_errors = np.std([_apart(curves @ (coefficients + move)) for move in moves])
    # And by what a harmonic less changes.
    by_fewer = _apart(_series(instants, harmonics - 1, 0) @ fewer) - own
    reach = TWO_DEVIATIONS * np.hypot(by_errors, by_fewer)
    ends = np.maximum([own, own - reach, own + reach], 0.0)
    value, low, high = 100.0 * np.sqrt(np.maximum(ends**2 - by_noise, 0.0))
    return float(value), float(low), float(max(high, 100.0 * reach))


def _apart(curves: NDArray[np.float64]) -> float:
    """Measure how far apart the instants are where curves are least, as a share of the cycle."""
    times = curves.argmin(axis=0) / len(curves)
    # About the mean direction: a cycle has no first instant.
    mean = np.angle(np.exp(2j * np.pi * times).mean()) / (2 * np.pi)
    return float((np.mod(times - mean + 0.5, 1.0) - 0.5).std(ddof=1))


def _series(phases: NDArray[np.float64], harmonics: int, order: int) -> NDArray[np.float64]:
    """Harmonics of the cycle or a derivative of them, (instants, 2 harmonics + 1)."""
    k = 2 * np.pi * np.arange(1, harmonics + 1)
    # Each derivative is a quarter of a turn.
    angles = phases[:, None] * k + order * np.pi / 2
    constant = np.full((len(phases), 1), float(order == 0))
    return np.hstack([constant, k**order * np.cos(angles), k**order * np.sin(angles)])
