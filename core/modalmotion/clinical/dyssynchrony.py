"""How unevenly the segments of a ventricle contract in time.

The systolic dyssynchrony index is the standard deviation of the times at which the volumes of the
16 segments are least, percent of the cycle (Kapetanakis et al., Circulation, 2005).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.clinical.wall_motion import WallMotion

# Frames beyond the numbers of a curve, from which noise is estimated; and least harmonics.
_FREE: Final = 2
_LEAST: Final = 3

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
) -> tuple[float, float] | None:
    """Measure how far apart the times of least volume are.

    Parameters
    ----------
    volumes : (frames, segments) float64
    phases : (frames,) float64
        Of one cycle, 0 to 1.
    variances : (segments,) float64
        Of the volumes, as far as they are known.

    Returns
    -------
    (float, float) or None
        Standard deviation of the times, and that of this number, percent of the cycle. None of too
        few frames.

    Notes
    -----
    Volumes are continuous curves of as many harmonics as their noise allows, by C_p (Mallows,
    1973). Draws of that noise move the times further apart: by as much as their square grows, the
    stated one is less.
    """
    n_frames = len(volumes)
    most = (n_frames - 1 - _FREE) // 2
    if most < _LEAST or np.ptp(phases) < 0.5:
        return None
    if np.linalg.cond(_series(phases, most, 0)) > _CONDITION:
        return None
    fits = {}
    for harmonics in range(_LEAST, most + 1):
        T = _series(phases, harmonics, 0)
        coefficients, *_ = np.linalg.lstsq(T, volumes, rcond=None)
        fits[harmonics] = T, coefficients, ((volumes - T @ coefficients) ** 2).sum(axis=0)
    free = n_frames - 2 * most - 1
    noise = np.maximum(fits[most][2].mean() / free, variances)
    harmonics = min(
        fits,
        key=lambda h: (
            float((fits[h][2] / np.maximum(noise, 1e-300)).sum())
            + 2 * (2 * h + 1) * volumes.shape[1]
        ),
    )
    T, coefficients, _ = fits[harmonics]
    # Columns of L have the covariance of the coefficients for noise of variance 1.
    L = np.linalg.inv(np.linalg.qr(T, mode="r"))
    curves = _series(np.arange(_INSTANTS) / _INSTANTS, harmonics, 0)
    rng = np.random.default_rng(_SEED)
    draws = [
        _apart(curves @ (coefficients + L @ rng.normal(size=coefficients.shape) * np.sqrt(noise)))
        for _ in range(_DRAWS)
    ]
    own = _apart(curves @ coefficients)
    index = np.sqrt(max(2.0 * own**2 - float(np.mean(np.square(draws))), 0.0))
    # And by what a harmonic more or less changes.
    instants = np.arange(_INSTANTS) / _INSTANTS
    others = [
        _apart(_series(instants, h, 0) @ fits[h][1])
        for h in (harmonics - 1, harmonics + 1)
        if h in fits
    ]
    changes = np.array(draws) - own, np.array(others) - own
    deviation = np.sqrt(sum(float(np.mean(change**2)) for change in changes if len(change)))
    return 100.0 * float(index), 100.0 * float(deviation)


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
