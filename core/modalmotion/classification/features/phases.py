"""Harmonics of a cycle that are counted from another phase, and read part by part."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def from_phase(rows: Array, clock: float) -> Array:
    """Harmonics that count from a phase: c_h becomes c_h exp(-i h clock).

    Parameters
    ----------
    rows : (2 harmonics, signals) float64
        Cosines of all harmonics, then sines; see `harmonic_rows`.
    clock : float, rad

    Returns
    -------
    (2 harmonics, signals) float64
        Cosine and sine of the first harmonic, then those of the second and so on.
    """
    count = len(rows) // 2
    # One product for all of them: (a + i b) (c - i s) = (a c + b s) + i (b c - a s).
    n = 2 * count
    turn = [0.0] * n**2
    for h in range(count):
        c, s = math.cos((h + 1) * clock), math.sin((h + 1) * clock)
        cosine, sine = 2 * h * n + h, (2 * h + 1) * n + h
        turn[cosine], turn[cosine + count] = c, s
        turn[sine], turn[sine + count] = -s, c
    return np.asarray(np.array(turn).reshape(n, n) @ rows)


def by_part(columns: NDArray[np.int64], n_harmonics: int, n_signals: int) -> NDArray[np.int64]:
    """Places of all phases of some signals, part by part, in the values of `from_phase`.

    Parameters
    ----------
    columns : (parts,) int64
        Of the signals.
    n_harmonics : int
        That are read; the first.
    n_signals : int
        In all.

    Returns
    -------
    (parts, 2 harmonics) int64
        In the flattened array.
    """
    return columns[:, None] + n_signals * np.arange(2 * n_harmonics)


def read_parts(rows: Array, order: NDArray[np.int64], n_signed: int, n_sized: int) -> Array:
    """Read parts with a sign, and the lengths of parts without.

    Parameters
    ----------
    rows : (2 harmonics, signals) float64
        See `from_phase`.
    order : (n_signed + 2 n_sized,) int64
        Places of the values with a sign, and of both components of those without.
    n_signed, n_sized : int
        Numbers of values of either kind. With walls none is without a sign.

    Returns
    -------
    (n_signed + n_sized,) float64
        Square roots of lengths where there is no sign.
    """
    found: Array = rows.ravel().take(order)
    if n_sized == 0:
        return found
    x, y = found[n_signed : n_signed + n_sized], found[n_signed + n_sized :]
    lengths = np.hypot(x, y, out=x)
    np.sqrt(lengths, out=lengths)
    return found[: n_signed + n_sized]
