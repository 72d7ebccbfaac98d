"""Errors of all nested sets of modes and harmonics, from the coefficients of the largest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modalmotion.choice.harmonics import Harmonics, n_functions
from modalmotion.fit.basis import Basis
from modalmotion.fit.fit import Fit
from modalmotion.numeric.products import product
from modalmotion.numeric.scale import power_of_two


@dataclass(frozen=True, eq=False)
class Energies:
    """Mean squares of a motion by mode and by function of time.

    With W^(1/2) Phi = Q R and c = Q'W^(1/2) u = R a, the residual of the first k modes is
    |r_k|^2 = |r|^2 + sum_{j >= k} c_j^2, r that of the largest set: sums of squares that are
    dropped, so small errors do not come from differences of large ones.

    The fit is orthogonal by weight alone. Where all vertices count alike, with G = Psi'Psi / N
    and b = Psi'r / N, Psi = Phi R^-1, what is dropped takes c'(G c + 2 b) with it instead.

    Parameters
    ----------
    coefficients : (frames, modes, n) float64, in units of the scale
        c of the largest set.
    outside : (frames,) float64, in units of the scale squared
        Mean square residual of the largest set.
    scale : float, length unit
        A power of two: squares neither overflow nor vanish.
    overlaps : (modes, modes) float64 or None
        G; None by weight, where it is the unit matrix.
    cross : (frames, modes, n) float64, in units of the scale, or None
        b; None by weight, where it is zero.
    """

    coefficients: NDArray[np.float64]
    outside: NDArray[np.float64]
    scale: float
    overlaps: NDArray[np.float64] | None = None
    cross: NDArray[np.float64] | None = None

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return len(self.coefficients)

    def rms(self, counts: NDArray[np.int64]) -> NDArray[np.float64]:
        """RMS error of the first so many modes over all frames.

        Parameters
        ----------
        counts : (sets,) int64
            0 for the motion itself.

        Returns
        -------
        (sets,) float64, length unit
        """
        by_mode = self._added(self.coefficients, self.cross).sum(axis=0) / self.n_frames
        squares = float(self.outside.mean()) + _dropped(by_mode)[counts]
        rms: NDArray[np.float64] = self.scale * np.sqrt(np.maximum(squares, 0.0))
        return rms

    def worst_frame_rms(self, counts: NDArray[np.int64]) -> NDArray[np.float64]:
        """RMS error of the worst frame: no maximum over the vertices is smaller.

        Returns
        -------
        (sets,) float64, length unit
        """
        squares = self.outside + _dropped(self._added(self.coefficients, self.cross).T)[counts]
        worst: NDArray[np.float64] = self.scale * np.sqrt(squares.max(axis=1))
        return worst

    def joint_rms(self, counts: NDArray[np.int64], harmonics: Harmonics) -> NDArray[np.float64]:
        """RMS error of the first so many modes, their paths limited to harmonics.

        Returns
        -------
        (sets, harmonics + 1) float64, length unit
            From 0 harmonics to the largest number available.
        """
        f = self.n_frames
        T = harmonics.functions
        along, beyond = _split(self.coefficients, T)
        cross_along, cross_beyond = (None, None) if self.cross is None else _split(self.cross, T)
        by_function = self._added(along, cross_along) / f
        left = self._added(beyond, cross_beyond).sum(axis=0) / f
        # Modes in the set lose the later functions of time.
        n = [min(n_functions(h), T.shape[1]) for h in range(harmonics.most + 1)]
        lost = left + _dropped(by_function)[n]
        late = np.concatenate([np.zeros((len(n), 1)), np.cumsum(lost, axis=1)], axis=1)
        by_mode = by_function.sum(axis=0) + left
        squares = float(self.outside.mean()) + _dropped(by_mode)[counts][:, None] + late.T[counts]
        joint: NDArray[np.float64] = self.scale * np.sqrt(np.maximum(squares, 0.0))
        return joint

    def _added(
        self, c: NDArray[np.float64], cross: NDArray[np.float64] | None
    ) -> NDArray[np.float64]:
        """Mean square that each mode adds when it is dropped after all later ones, by row.

        Parameters
        ----------
        c, cross : (rows, modes, n) float64

        Returns
        -------
        (rows, modes) float64
        """
        if self.overlaps is None or cross is None:
            squares: NDArray[np.float64] = (c**2).sum(axis=2)
            return squares
        # sum_{i,j >= k} G_ij c_i c_j grows by c_k (G_kk c_k + 2 sum_{j > k} G_kj c_j)
        G = np.diag(np.diag(self.overlaps)) + 2.0 * np.triu(self.overlaps, 1)
        rows, m, n_directions = c.shape
        flat = np.ascontiguousarray(c.transpose(1, 0, 2).reshape(m, -1))
        later = product(G, flat).reshape(m, rows, n_directions).transpose(1, 0, 2)
        added: NDArray[np.float64] = (c * (later + 2.0 * cross)).sum(axis=2)
        return added


def energies_of(basis: Basis, fit: Fit) -> Energies:
    """Take the energies by weight of a motion from the fit of the largest set."""
    f, m, n_directions = fit.amplitudes.shape
    largest = max(
        float(fit.weighted_motion_rms.max()), float(np.abs(fit.amplitudes).max(initial=0.0))
    )
    scale = power_of_two(largest)
    a = (fit.amplitudes / scale).transpose(0, 2, 1).reshape(n_directions * f, m)
    # c = R a
    c = product(np.ascontiguousarray(a), np.ascontiguousarray(basis.triangle.T))
    return Energies(
        coefficients=np.ascontiguousarray(c.reshape(f, n_directions, m).transpose(0, 2, 1)),
        outside=(fit.errors.weighted_rms / scale) ** 2,
        scale=scale,
    )


def _split(
    c: NDArray[np.float64], T: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Parts along functions of time, (functions, modes, 3), and beyond, (frames, modes, 3)."""
    flat = np.ascontiguousarray(c.reshape(len(c), -1))
    along = product(np.ascontiguousarray(T.T), flat)
    return along.reshape(-1, *c.shape[1:]), (flat - product(T, along)).reshape(c.shape)


def _dropped(squares: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sum over the rows from each one on, the last first; one more row of zeros."""
    total = np.zeros((len(squares) + 1, *squares.shape[1:]))
    total[:-1] = np.cumsum(squares[::-1], axis=0)[::-1]
    return total
