"""Noise over time: its correlation from frame to frame, and its level in each band.

Of each band the frames' products are read. Noise of one level and correlation would fill all
directions of time alike once it is made white; a motion takes few of them, the same in all bands.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from modalmotion.choice.harmonics import harmonics_of, n_functions

# Correlations of a frame with the next that are compared, the best one interpolated.
_CORRELATIONS: Final = (
    *(-0.3, -0.15, 0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8),
    *(0.85, 0.9, 0.93, 0.96, 0.98),
)

# What a direction of motion costs in log-likelihood; without it all noise is called motion.
COST: Final = 6.0

# Columns of a band that count at most: bands are not wholly alike.
_MOST_COLUMNS: Final = 400.0

# Bands are not wholly even either: the mean logarithm of their directions may lie so far below.
_UNEVEN: Final = 0.3

# Frames from which on the slowest functions of time are left to the motion, and their harmonics.
_FEW_FRAMES: Final = 5
_FRAMES_PER_HARMONIC: Final = 8
_MOST_HARMONICS: Final = 8


@dataclass(frozen=True, eq=False)
class Levels:
    """Level of the noise in each band.

    Parameters
    ----------
    energies : (bands,) float64, in units of the products
        Sum of the columns' variances.
    columns : (bands,) float64
        Those left of the independent columns by directions of motion.
    directions : (bands,) int64
        Directions of time in which there is nothing but noise; 0 where what is left does not
        fill them as noise would.
    n_directions : int
        All that were looked at.
    """

    energies: NDArray[np.float64]
    columns: NDArray[np.float64]
    directions: NDArray[np.int64]
    n_directions: int


@dataclass(frozen=True, eq=False)
class Paths:
    """The bands' paths over time.

    Parameters
    ----------
    grams : (bands, frames, frames) float64
        Of the coarse bands, then of the fine ones.
    n_coarse : int
    """

    grams: NDArray[np.float64]
    n_coarse: int

    @cached_property
    def _moving(self) -> NDArray[np.float64]:
        """Directions of time, (frames, frames - 1) float64, those of most motion last.

        Each vertex's mean is left out: it takes the reference's own noise with it.
        """
        still = _complement(np.ones((self.grams.shape[1], 1)))
        total = self.grams[: self.n_coarse].sum(axis=0)
        directions: NDArray[np.float64] = still @ np.linalg.eigh(still.T @ total @ still)[1]
        return directions

    @cached_property
    def _candidates(self) -> list[tuple[NDArray[np.float64], float]]:
        """Energies of the directions, (bands, directions), and log det for each correlation."""
        result = []
        for correlation in _CORRELATIONS:
            whitening, log_det = _whitening(self._moving, correlation)
            energies = np.einsum("pf,bfg,pg->bp", whitening, self.grams, whitening)
            result.append((energies, log_det))
        return result

    def correlation(
        self, columns: NDArray[np.float64], cost: float = COST, bands: slice = slice(None)
    ) -> float:
        """Find the correlation of a frame's noise with the next frame's.

        The likelihood of normal noise, an autoregression of order 1; in each band the first
        directions of motion have an energy of their own, as many as pay their cost.

        Parameters
        ----------
        columns : (bands,) float64
            Independent ones of each band.
        cost : float
            Of each direction.
        bands : slice
            Those to read.
        """
        n = np.maximum(columns[bands], 1.0)
        n_directions = self.grams.shape[1] - 1
        taken = np.arange(n_directions // 2 + 1)
        totals = []
        for energies, log_det in self._candidates:
            d = np.maximum(energies[bands] / n[:, None], 1e-300)
            rest = np.cumsum(d, axis=1)[:, n_directions - 1 - taken] / (n_directions - taken)
            own = np.cumsum(np.log(d[:, ::-1]), axis=1)
            own = np.concatenate([np.zeros((len(n), 1)), own], axis=1)[:, taken]
            ll = (n_directions - taken) * np.log(rest) + own + log_det
            ll = -0.5 * n[:, None] * ll - cost * taken
            totals.append(float((ll.max(axis=1) * np.minimum(1.0, _MOST_COLUMNS / n)).sum()))
        return _peak(np.array(totals))

    def levels(
        self, correlation: float, columns: NDArray[np.float64], *, all_times: bool = False
    ) -> Levels:
        """Find the level in each band.

        Parameters
        ----------
        correlation : float
        columns : (bands,) float64
            Independent ones of each band.
        all_times : bool
            Whether to read slow functions of time too, most of whose energy is motion.
        """
        f = self.grams.shape[1]
        n_slow = 1
        if f >= _FEW_FRAMES and not all_times:
            n_slow = n_functions(min(f // _FRAMES_PER_HARMONIC, _MOST_HARMONICS))
        quick = _complement(harmonics_of(f, None).functions[:, :n_slow])
        whitening, _ = _whitening(quick, correlation)
        values = np.linalg.eigvalsh(whitening @ self.grams @ whitening.T)[:, ::-1]
        found = [_bulk(v, n) for v, n in zip(np.maximum(values, 0.0), columns, strict=True)]
        n_taken = np.array([n for n, _, _ in found])
        is_noise = np.array([is_noise for _, _, is_noise in found])
        return Levels(
            np.array([energy for _, energy, _ in found]),
            np.maximum(columns - n_taken, 0.0),
            np.where(is_noise, quick.shape[1] - n_taken, 0),
            quick.shape[1],
        )


def over_time(correlation: float, n_frames: int) -> NDArray[np.float64]:
    """Correlations of the noise of any two frames, (frames, frames) float64."""
    lags = np.abs(np.subtract.outer(np.arange(n_frames), np.arange(n_frames)))
    result: NDArray[np.float64] = np.float64(correlation) ** lags
    return result


def _complement(functions: NDArray[np.float64]) -> NDArray[np.float64]:
    f, n = functions.shape
    rest: NDArray[np.float64] = np.linalg.qr(functions, mode="complete")[0][:, n:f]
    return rest


def _whitening(
    directions: NDArray[np.float64], correlation: float
) -> tuple[NDArray[np.float64], float]:
    """Matrix that makes noise white along directions, each after those before it, and log det."""
    L = np.linalg.cholesky(directions.T @ over_time(correlation, len(directions)) @ directions)
    return np.linalg.solve(L, directions.T), 2.0 * float(np.log(np.diag(L)).sum())


def _peak(totals: NDArray[np.float64]) -> float:
    """Correlation of the largest value, by a parabola through its neighbours."""
    k = int(np.argmax(totals))
    if not 0 < k < len(totals) - 1:
        return _CORRELATIONS[k]
    x = np.array(_CORRELATIONS[k - 1 : k + 2])
    a, b, _ = np.polyfit(x - x[1], totals[k - 1 : k + 2] - totals[k], 2)
    peak = x[1] - b / (2.0 * a) if a < 0.0 else x[1]
    return float(np.clip(peak, x[0], x[2]))


def _bulk(values: NDArray[np.float64], n: float) -> tuple[int, float, bool]:
    """Directions above pure noise, energy of all columns in the others, and if that is noise.

    Parameters
    ----------
    values : (directions,) float64
        Energies along the principal directions of time, the largest first.
    n : float
        Independent columns.

    Notes
    -----
    The largest of p values of noise of variance s in n columns is near
    s (sqrt(n) + sqrt(p))^2, and rarely beyond by more than the scale of its law: Johnstone, On
    the distribution of the largest eigenvalue in principal components analysis, Annals of
    Statistics, 2001. Each direction of motion takes a column of noise with it.
    """
    p = len(values)
    for r in range(p):
        columns = max(n - r, 1.0)
        variance = float(values[r:].sum()) / ((p - r) * columns)
        a, b = np.sqrt(columns), np.sqrt(p - r)
        edge = (a + b) ** 2 + (a + b) * (1.0 / a + 1.0 / b) ** (1.0 / 3.0)
        # Fewer columns than directions leave some of these empty.
        is_last = r == p - 1 or (n < p and r >= n / 2)
        if is_last or values[r] <= variance * edge:
            return r, variance * n, _fills(values[r:], variance, columns)
    return 0, 0.0, False


def _fills(values: NDArray[np.float64], variance: float, n: float) -> bool:
    """Whether energies along principal directions are as even as those of noise.

    The logarithm of a Wishart determinant has the mean sum_i (log 2 + psi((n - i) / 2)) and the
    variance sum_i psi'((n - i) / 2): Muirhead, Aspects of Multivariate Statistical Theory, 1982.
    What a smooth motion leaves falls by a factor from each direction to the next.
    """
    p = len(values)
    if variance <= 0.0:
        return False
    if n < p + 2.0:
        return True
    halves = 0.5 * (n - np.arange(p))
    expected = float((np.log(2.0) + scipy.special.digamma(halves)).sum())
    found = float(np.log(np.maximum(values / variance, 1e-300)).sum())
    return (
        found
        >= expected - 4.0 * float(np.sqrt(scipy.special.polygamma(1, halves).sum())) - _UNEVEN * p
    )
