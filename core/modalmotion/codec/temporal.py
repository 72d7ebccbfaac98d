"""Temporal components: what the coefficients of all frames are combined from."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import fft, linalg

from modalmotion.codec.lattice_modes import turn, turn_back
from modalmotion.codec.quantiser import Quantiser

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Temporal(IntEnum):
    """Which temporal basis a block uses."""

    DCT = 0
    FOURIER = 1
    KLT = 2
    TRAJECTORY = 3


CLOSED_FORM: Final = (Temporal.DCT, Temporal.FOURIER)


@dataclass(frozen=True, eq=False)
class TimeBasis:
    """Positions over time as combinations of components.

    Parameters
    ----------
    kind : Temporal
    means : (frames, means) float64
        Components fixed in advance, one row for each direction: all of a cosine or Fourier
        basis, the constant of a learned one.
    learned : (frames, components) or (frames, 3, components) float64
        Components that were sent: for each direction alike, or for all three at once.
    """

    kind: Temporal
    means: Floats
    learned: Floats

    @property
    def n_rows(self) -> int:
        """Rows of the matrix of coefficients."""
        each = 1 if self.kind == Temporal.TRAJECTORY else 3
        return int(3 * self.means.shape[1] + each * self.learned.shape[-1])

    def superpose(self, rows: Floats) -> Floats:
        """Combine components, (rows, n) to (frames, 3, n)."""
        if self.kind in CLOSED_FORM:
            return _superpose_fast(self.kind, len(self.means), rows)
        n_fixed = 3 * self.means.shape[1]
        n_frames = len(self.means)
        total = self.means @ rows[:n_fixed].reshape(self.means.shape[1], -1)
        basis = self.learned.reshape(-1, self.learned.shape[-1])
        rest = rows[n_fixed:].reshape(self.learned.shape[-1], -1)
        return total.reshape(n_frames, 3, -1) + (basis @ rest).reshape(n_frames, 3, -1)

    def project(self, motion: Floats) -> Floats:
        """Coefficients that leave the least error, (frames, 3, n) to (rows, n)."""
        n_frames, _, n = motion.shape
        if self.kind == Temporal.DCT:
            return np.asarray(fft.dct(motion, type=2, norm="ortho", axis=0)).reshape(-1, n)
        if self.kind == Temporal.FOURIER:
            return turn(motion, 0).reshape(-1, n)
        flat = motion.reshape(n_frames, -1)
        fixed = (self.means.T @ flat).reshape(-1, n)
        if not self.learned.shape[-1]:
            return fixed
        # The fixed components are orthonormal, and so are the learned ones to them, up to the
        # rounding of the learned ones: what is left is fitted with those.
        rest = (flat - self.means @ (self.means.T @ flat)).reshape(n_frames, 3, n)
        basis = self.learned.reshape(-1, self.learned.shape[-1])
        fitted, *_ = linalg.lstsq(basis, rest.reshape(len(basis), -1), lapack_driver="gelsy")
        return np.concatenate([fixed, fitted.reshape(-1, n)])


def _superpose_fast(kind: Temporal, n_frames: int, rows: Floats) -> Floats:
    amplitudes = np.zeros((n_frames, 3, rows.shape[1]))
    amplitudes[: len(rows) // 3] = rows.reshape(-1, 3, rows.shape[1])
    if kind == Temporal.FOURIER:
        return turn_back(amplitudes, 0)
    return np.asarray(fft.idct(amplitudes, type=2, norm="ortho", axis=0, overwrite_x=True))


def fixed_components(kind: Temporal, n_frames: int, n_components: int) -> Floats:
    """Orthonormal components in closed form, slow ones first, (frames, components) float64."""
    if kind == Temporal.DCT:
        columns = fft.idct(np.eye(n_frames)[:, :n_components], type=2, norm="ortho", axis=0)
    elif kind == Temporal.FOURIER:
        phase = 2 * np.pi * np.outer(np.arange(n_frames), (np.arange(n_components) + 1) // 2)
        phase /= n_frames
        sine = np.arange(n_components) % 2 == 0
        columns = np.where(sine, np.sin(phase), np.cos(phase)) * np.sqrt(2.0 / n_frames)
        columns[:, :1] = 1.0 / np.sqrt(n_frames)
        if n_frames % 2 == 0:
            columns[:, n_frames - 1 :] /= np.sqrt(2.0)
    else:
        columns = np.full((n_frames, 1), 1.0 / np.sqrt(n_frames))
    return np.asarray(columns, dtype=np.float64)


def learned_components(motion: Floats, kind: Temporal) -> Floats:
    """Principal components of the motion about its mean, strongest first.

    Parameters
    ----------
    motion : (frames, 3, n) float64
    kind : Temporal

    Returns
    -------
    (components, frames, directions) float64
        Each times its strength, so that one step suits basis and coefficients alike;
        directions is 1 or 3.
    """
    n_frames = len(motion)
    centred = motion - motion.mean(axis=0)
    wide = kind == Temporal.TRAJECTORY
    flat = centred.reshape(3 * n_frames, -1) if wide else centred.reshape(n_frames, -1)
    if flat.shape[0] <= flat.shape[1]:
        squares, U = linalg.eigh(flat @ flat.T)
        scaled = U * np.sqrt(np.maximum(squares, 0.0))
    else:
        U, strengths, _ = linalg.svd(flat, full_matrices=False)
        scaled = (U * strengths)[:, ::-1]
    return np.ascontiguousarray(scaled[:, ::-1].T).reshape(-1, n_frames, 3 if wide else 1)


def basis_numbers(components: Floats) -> Floats:
    """Components as a matrix to be quantised: (components, frames x directions), slow first."""
    slow = fft.dct(components, type=2, norm="ortho", axis=1)
    return np.asarray(slow, dtype=np.float64).reshape(len(components), -1)


def restore_basis(kind: Temporal, numbers: Ints, n_frames: int, quantiser: Quantiser) -> TimeBasis:
    """Make the basis that was sent.

    Parameters
    ----------
    kind : Temporal
    numbers : (components, frames x directions) int64
    n_frames : int
    quantiser : Quantiser
    """
    means = fixed_components(kind, n_frames, 1)
    directions = numbers.shape[1] // n_frames
    components = quantiser.restore(numbers).reshape(len(numbers), n_frames, directions)
    norms = np.sqrt((components**2).sum(axis=(1, 2), keepdims=True))
    components = components / np.where(norms > 0, norms, 1.0)
    components = np.asarray(fft.idct(components, type=2, norm="ortho", axis=1))
    learned = np.ascontiguousarray(np.moveaxis(components, 0, -1))
    if kind == Temporal.KLT:
        learned = learned[:, 0, :]
    return TimeBasis(kind, means, learned)
