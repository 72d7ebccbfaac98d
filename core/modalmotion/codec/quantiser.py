"""One step for all coefficients, with a dead zone that widens where zero is likely."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SHIFT_UNIT: Final = 1.0 / 256.0
# Beyond them a float64 is further from the next than a step.
MOST_STEPS: Final = 2.0**53


@dataclass(frozen=True)
class Quantiser:
    """How a whole number becomes a coefficient.

    Parameters
    ----------
    step : float
        Quanta.
    shifts : (int, int, int)
        How far inside its cell the value of magnitude 1, 2, and of any larger one lies, in
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
    """Tell whether each is a number of steps that a whole number can hold."""
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
