"""Temporal components, whose combinations are the coefficients of all frames."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from modalmotion.codec.fourier import cosines, from_cosines, turn, turn_back
from modalmotion.codec.quantiser import Quantiser

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Temporal(IntEnum):
    """Which temporal basis a block uses."""

    DCT = 0
    FOURIER = 1
    TRAJECTORY = 2
    PARTS = 3


CLOSED_FORM: Final = (Temporal.DCT, Temporal.FOURIER)


@dataclass(frozen=True, eq=False)
class TimeBasis:
    """Positions over time as combinations of components.

    Parameters
    ----------
    kind : Temporal
    n_frames : int
    learned : (frames, 3, components) float64
        Components that were sent, besides the constant; none for a basis in closed form.
    """

    kind: Temporal
    n_frames: int
    learned: Floats

    def superpose(self, rows: Floats) -> Floats:
        """Combine components, (rows, n) to (frames, 3, n)."""
        if self.kind in CLOSED_FORM:
            amplitudes = np.zeros((self.n_frames, 3, rows.shape[1]))
            amplitudes[: len(rows) // 3] = rows.reshape(-1, 3, rows.shape[1])
            if self.kind == Temporal.FOURIER:
                return turn_back(amplitudes, 0)
            return from_cosines(amplitudes, 0)
        constant = rows[:3] / np.sqrt(self.n_frames)
        n_components = self.learned.shape[-1]
        if not n_components:
            return np.repeat(constant[None], self.n_frames, axis=0)
        basis = self.learned.reshape(-1, n_components)
        moving: Floats = basis @ rows[3:].reshape(n_components, -1)
        total: Floats = moving.reshape(self.n_frames, 3, -1) + constant
        return total

    def project(self, motion: Floats, alike: float | None = None) -> Floats:
        """Coefficients that leave the least error, (frames, 3, n) to (rows, n).

        Parameters
        ----------
        motion : (frames, 3, n) float64
        alike : float, optional
            Reciprocal condition beyond which learned components are taken as dependent; that of
            rounding by default.
        """
        n = motion.shape[2]
        if self.kind == Temporal.DCT:
            return cosines(motion, 0).reshape(-1, n)
        if self.kind == Temporal.FOURIER:
            return turn(motion, 0).reshape(-1, n)
        mean = motion.mean(axis=0)
        constant: Floats = mean * np.sqrt(self.n_frames)
        if not self.learned.shape[-1]:
            return constant
        # Learned components are orthonormal up to their rounding: fitted, not projected.
        basis = self.learned.reshape(-1, self.learned.shape[-1])
        moving = (motion - mean).reshape(len(basis), -1)
        fitted, *_ = scipy.linalg.lstsq(basis, moving, cond=alike, lapack_driver="gelsy")
        return np.concatenate([constant, fitted.reshape(-1, n)])


def closed_form_basis(kind: Temporal, n_frames: int) -> TimeBasis:
    """Make a basis that needs no sending."""
    return TimeBasis(kind, n_frames, np.zeros((n_frames, 0)))


def learned_components(motion: Floats) -> Floats:
    """Principal components of the motion about its mean, strongest first.

    Parameters
    ----------
    motion : (frames, 3, n) float64

    Returns
    -------
    (components, frames, 3) float64
        Each times its strength, so that one step suits basis and coefficients alike.
    """
    n_frames = len(motion)
    centred = motion - motion.mean(axis=0)
    flat = centred.reshape(3 * n_frames, -1)
    if flat.shape[0] <= flat.shape[1]:
        squares, U = scipy.linalg.eigh(flat @ flat.T)
        scaled = U * np.sqrt(np.maximum(squares, 0.0))
    else:
        U, strengths, _ = scipy.linalg.svd(flat, full_matrices=False)
        scaled = (U * strengths)[:, ::-1]
    return np.ascontiguousarray(scaled[:, ::-1].T).reshape(-1, n_frames, 3)


def basis_numbers(components: Floats) -> Floats:
    """Components as a matrix to be quantised: (components, frames x 3), slow first."""
    return cosines(components, 1).reshape(len(components), -1)


def restore_basis(kind: Temporal, numbers: Ints, n_frames: int, quantiser: Quantiser) -> TimeBasis:
    """Make the basis that was sent.

    Parameters
    ----------
    kind : Temporal
    numbers : (components, frames x 3) int64
    n_frames : int
    quantiser : Quantiser
    """
    components = quantiser.restore(numbers).reshape(len(numbers), n_frames, 3)
    norms = np.sqrt((components**2).sum(axis=(1, 2), keepdims=True))
    components = components / np.where(norms > 0, norms, 1.0)
    components = from_cosines(components, 1)
    return TimeBasis(kind, n_frames, np.ascontiguousarray(np.moveaxis(components, 0, -1)))
