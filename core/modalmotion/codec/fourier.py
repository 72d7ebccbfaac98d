"""Orthonormal cosine, sine and Fourier transforms along one axis, of real numbers.

From the transform of numpy, so that a decoder need not load another (J. Makhoul, A fast cosine
transform in one and two dimensions, IEEE Transactions on Acoustics, Speech, and Signal Processing,
1980).
"""

from __future__ import annotations

import numpy as np
from numpy.fft import fft, irfft, rfft
from numpy.typing import NDArray

Floats = NDArray[np.float64]


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
