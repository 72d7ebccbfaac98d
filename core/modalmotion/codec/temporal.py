"""Temporal components, whose combinations are the coefficients of all frames."""

from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Final

import numpy as np
import scipy
from numpy.fft import fft, irfft, rfft

from modalmotion.representation import Floats, Ints


def cosines(array: Floats, axis: int) -> Floats:
    """Transform to cosines (DCT-II): c_k cos(pi k (2 i + 1) / 2 n)."""
    x = np.moveaxis(array, axis, -1)
    n = x.shape[-1]
    V = rfft(np.concatenate([x[..., ::2], x[..., 1::2][..., ::-1]], axis=-1))
    k = np.arange(n // 2 + 1)
    V = V * np.exp(-0.5j * np.pi * k / n)
    out = np.empty(x.shape)
    out[..., : n // 2 + 1] = V.real
    out[..., n // 2 + 1 :] = -V.imag[..., 1 : n - n // 2][..., ::-1]
    out *= np.sqrt(2.0 / n)
    out[..., 0] *= np.sqrt(0.5)
    return np.moveaxis(out, -1, axis)


def from_cosines(array: Floats, axis: int) -> Floats:
    """Undo `cosines`."""
    X = np.moveaxis(array, axis, -1) * np.sqrt(0.5 * array.shape[axis])
    n = X.shape[-1]
    X[..., 0] *= np.sqrt(2.0)
    k = np.arange(n // 2 + 1)
    V = X[..., k].astype(np.complex128)
    V[..., 1:] -= 1j * X[..., n - k[1:]]
    v = irfft(V * np.exp(0.5j * np.pi * k / n), n)
    out = np.empty(X.shape)
    out[..., ::2] = v[..., : n - n // 2]
    out[..., 1::2] = v[..., n - n // 2 :][..., ::-1]
    return np.moveaxis(out, -1, axis)


def sines(array: Floats, axis: int) -> Floats:
    """Transform to sines (DST-II): c_k sin(pi (k + 1) (2 i + 1) / 2 n)."""
    return np.flip(cosines(array * _alternating(array, axis), axis), axis)


def from_sines(array: Floats, axis: int) -> Floats:
    """Undo `sines`."""
    return from_cosines(np.flip(array, axis), axis) * _alternating(array, axis)


def odd_sines(array: Floats, axis: int) -> Floats:
    """Transform to sines of odd quarter periods (DST-IV), and back: it is its own inverse."""
    x = np.moveaxis(array, axis, -1)
    n = x.shape[-1]
    i = np.arange(n)
    z = fft(x * np.exp(-0.5j * np.pi * i / n), 2 * n)[..., :n]
    out: Floats = -np.sqrt(2.0 / n) * (z * np.exp(-0.25j * np.pi * (2 * i + 1) / n)).imag
    return np.moveaxis(out, -1, axis)


def turn(array: Floats, axis: int) -> Floats:
    """Orthonormal real Fourier transform: constant, cos, sin, cos, sin, ..."""
    n = array.shape[axis]
    z = np.moveaxis(rfft(array, axis=axis, norm="ortho"), axis, -1)
    out = np.empty((*z.shape[:-1], n))
    n_sines = (n - 1) // 2
    out[..., 0] = z[..., 0].real
    out[..., 1 : 2 * n_sines : 2] = np.sqrt(2.0) * z[..., 1 : n_sines + 1].real
    out[..., 2 : 2 * n_sines + 1 : 2] = -np.sqrt(2.0) * z[..., 1 : n_sines + 1].imag
    if n % 2 == 0:
        out[..., -1] = z[..., -1].real
    return np.moveaxis(out, -1, axis)


def turn_back(array: Floats, axis: int) -> Floats:
    """Undo `turn`."""
    n = array.shape[axis]
    x = np.moveaxis(array, axis, -1)
    z = np.zeros((*x.shape[:-1], n // 2 + 1), dtype=np.complex128)
    n_sines = (n - 1) // 2
    z[..., 0] = x[..., 0]
    z[..., 1 : n_sines + 1] = (
        x[..., 1 : 2 * n_sines : 2] - 1j * x[..., 2 : 2 * n_sines + 1 : 2]
    ) / np.sqrt(2.0)
    if n % 2 == 0:
        z[..., -1] = x[..., -1]
    return np.moveaxis(irfft(z, n, axis=-1, norm="ortho"), -1, axis)


def _alternating(array: Floats, axis: int) -> Floats:
    """1, -1, 1, ... along an axis."""
    signs = 1.0 - 2.0 * (np.arange(array.shape[axis]) % 2)
    return np.expand_dims(signs, [a for a in range(array.ndim) if a != axis % array.ndim])


SHIFT_UNIT: Final = 1.0 / 256.0
# Beyond them a float64 is further from the next than a step.
MOST_STEPS: Final = 2.0**53
# A coarse step rounds some components to the same one, and a difference between them would take
# huge numbers of opposite signs: beyond this reciprocal condition they share what they describe.
ALIKE: Final = 1e-8


@dataclass(frozen=True)
class Quantiser:
    """How a whole number becomes a coefficient.

    Parameters
    ----------
    step : float
        Quanta.
    shifts : (int, int, int)
        How far inside its cell the value of magnitude 1, 2, and of any larger one is, in
        1/256 of a step.
    """

    step: float
    shifts: tuple[int, int, int]

    def restore(self, numbers: Ints) -> Floats:
        """sign(q) (|q| - shift) step."""
        magnitude = np.abs(numbers)
        table = np.array([0, *self.shifts], dtype=np.float64) * SHIFT_UNIT
        # In place: the memory of each array that is new counts in the first decode of a process.
        values: Floats = table[np.minimum(magnitude, 3)]
        np.subtract(magnitude, values, out=values)
        values *= self.step
        values *= np.sign(numbers, out=magnitude)
        return values


def quantise(coefficients: Floats, step: float, price: float) -> Ints:
    """Round where it pays: distortion plus price times bits is least.

    Parameters
    ----------
    coefficients : (rows, columns) float64
    step : float
    price : float
        Squared steps that one bit is worth.
    """
    numbers = np.zeros(coefficients.shape, dtype=np.int64)
    # Most of a smooth motion is less than half a step: leave it out from the start.
    loud = np.abs(coefficients) > 0.5 * step
    n_rows, n_columns = last_used(loud.any(axis=1)), last_used(loud.any(axis=0))
    if not n_rows:
        return numbers
    part = coefficients[:n_rows, :n_columns]
    scaled = np.abs(part) / step
    magnitude = np.floor(scaled + 0.35)
    for _ in range(2 if price > 0 else 0):
        expected = _surroundings(np.minimum(magnitude, 1023.0)) + 0.004
        # Geometric: one more costs log2((1 + m) / m) bits; the first one its sign besides.
        more = np.log2(1.0 + 1.0 / expected)
        magnitude = np.floor(scaled + 0.5 - np.minimum(0.5 * price * more, 0.45))
        magnitude = np.maximum(magnitude, 1.0)
        magnitude *= scaled > 0.5 + 0.5 * price * (more + 1.0)
    numbers[:n_rows, :n_columns] = np.copysign(magnitude, part)
    return numbers


def is_countable(coefficients: Floats, step: float) -> bool:
    """Return whether each is a number of steps that a whole number can contain."""
    return bool(np.abs(coefficients).max(initial=0.0) < MOST_STEPS * step)


def fit_quantiser(coefficients: Floats, numbers: Ints, step: float) -> Quantiser:
    """Place the value of each cell at the mean of its coefficients."""
    occupied = np.flatnonzero(numbers)
    magnitude = np.abs(numbers.ravel()[occupied])
    inside = magnitude - np.abs(coefficients.ravel()[occupied]) / step
    shifts = []
    for cell in (magnitude == 1, magnitude == 2, magnitude >= 3):
        mean = float(inside[cell].mean()) if cell.any() else 0.0
        shifts.append(int(np.clip(np.rint(mean / SHIFT_UNIT), -127, 127)))
    return Quantiser(step, (shifts[0], shifts[1], shifts[2]))


def last_used(used: Any) -> int:
    """Count the entries up to the last that is used."""
    return int(np.flatnonzero(used).max(initial=-1)) + 1


def _surroundings(magnitude: Floats) -> Floats:
    """Mean magnitude around each entry, itself left out: near in its row and the rows beside."""
    total = np.zeros_like(magnitude)
    for half, weight in ((2, 0.4), (12, 0.2)):
        total += weight * _around(magnitude, half, itself=False)
    padded = np.pad(magnitude, ((1, 1), (0, 0)))
    near = _around(padded, 1, itself=True) + _around(padded, 6, itself=True)
    total += 0.1 * (near[:-2] + near[2:])
    return total


def _around(magnitude: Floats, half: int, *, itself: bool) -> Floats:
    sums = np.cumsum(np.pad(magnitude, ((0, 0), (half + 1, half))), axis=1)
    window = sums[:, 2 * half + 1 :] - sums[:, : -2 * half - 1]
    return window / (2 * half + 1) if itself else (window - magnitude) / (2 * half)


class Temporal(IntEnum):
    """Which temporal basis a block uses."""

    DCT = 0
    TRAJECTORY = 1
    PARTS = 2


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
        if self.kind == Temporal.DCT:
            amplitudes = np.zeros((self.n_frames, 3, rows.shape[1]))
            amplitudes[: len(rows) // 3] = rows.reshape(-1, 3, rows.shape[1])
            return from_cosines(amplitudes, 0)
        constant = rows[:3] / np.sqrt(self.n_frames)
        n_components = self.learned.shape[-1]
        if not n_components:
            return np.repeat(constant[None], self.n_frames, axis=0)
        basis = self.learned.reshape(-1, n_components)
        moving: Floats = basis @ rows[3:].reshape(n_components, -1)
        total: Floats = moving.reshape(self.n_frames, 3, -1) + constant
        return total

    def project(self, motion: Floats) -> Floats:
        """Coefficients that leave the least error, (frames, 3, n) to (rows, n)."""
        n = motion.shape[2]
        if self.kind == Temporal.DCT:
            return cosines(motion, 0).reshape(-1, n)
        mean = motion.mean(axis=0)
        constant: Floats = mean * np.sqrt(self.n_frames)
        if not self.learned.shape[-1]:
            return constant
        # Learned components are orthonormal up to their rounding: fitted, not projected.
        basis = self.learned.reshape(-1, self.learned.shape[-1])
        moving = (motion - mean).reshape(len(basis), -1)
        fitted, *_ = scipy.linalg.lstsq(basis, moving, cond=ALIKE, lapack_driver="gelsy")
        return np.concatenate([constant, fitted.reshape(-1, n)])


def cosine_basis(n_frames: int) -> TimeBasis:
    """Make the basis that needs no sending."""
    return TimeBasis(Temporal.DCT, n_frames, np.zeros((n_frames, 0)))


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
