"""Unevaluated sums of two floats: products and roots with their rounding error.

A phase w t of 1e6 rad rounded to one float is wrong by 1e-10 rad before its cosine is taken.
Kept as a sum of two floats it loses nothing, and a sine of it is good to its last digit.

Source: Dekker, "A floating-point technique for extending the available precision",
Numerische Mathematik 18, 1971. Relative error about 1e-31 while no product underflows;
where one does, or overflows, the value falls back to one float.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

_SPLITTER: Final = 2.0**27 + 1.0
_LARGEST: Final = 1e300


class Twofold(NamedTuple):
    """The sum high + low, low below half a unit in the last place of high."""

    high: NDArray[np.float64]
    low: NDArray[np.float64]


def add(a: NDArray[np.float64], b: NDArray[np.float64]) -> Twofold:
    """Sum a + b without error."""
    high = a + b
    b_seen = high - a
    return Twofold(high, (a - (high - b_seen)) + (b - b_seen))


def multiply(x: Twofold, y: Twofold) -> Twofold:
    """Product of two twofold numbers."""
    high, low = _product(x.high, y.high)
    return _renormalise(high, low + (x.high * y.low + x.low * y.high))


def scale(x: Twofold, factor: NDArray[np.float64]) -> Twofold:
    """Product of a twofold number and a float."""
    high, low = _product(x.high, factor)
    return _renormalise(high, low + x.low * factor)


def divide(a: NDArray[np.float64], y: Twofold) -> Twofold:
    """Quotient a / y, and 0 where y is 0."""
    is_zero = y.high == 0
    divisor = np.where(is_zero, 1.0, y.high)
    quotient = np.where(is_zero, 0.0, a / divisor)
    high, low = _product(quotient, divisor)
    rest = ((a - high) - low) - quotient * y.low
    return _renormalise(quotient, np.where(is_zero, 0.0, rest / divisor))


def sqrt(x: Twofold) -> Twofold:
    """Square root of a twofold number that is not negative."""
    root = np.sqrt(x.high)
    high, low = _product(root, root)
    rest = ((x.high - high) - low) + x.low
    return _renormalise(root, rest / np.where(root == 0, 1.0, 2.0 * root))


def bounded(x: Twofold) -> Twofold:
    """Hold a number within +-1e300, so that no function of it meets an infinity."""
    beyond = ~(np.abs(x.high) <= _LARGEST)
    return Twofold(np.where(beyond, np.copysign(_LARGEST, x.high), x.high), x.low * ~beyond)


def _product(a: NDArray[np.float64], b: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    product = a * b
    a_high, a_low = _split(a)
    b_high, b_low = _split(b)
    error = a_low * b_low - (((product - a_high * b_high) - a_low * b_high) - a_high * b_low)
    return product, error


def _split(a: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    t = _SPLITTER * a
    high = t - (t - a)
    return high, a - high


def _renormalise(high: NDArray[np.float64], low: NDArray[np.float64]) -> Twofold:
    low = np.where(np.isfinite(low), low, 0.0)
    total = high + low
    return Twofold(total, np.where(np.isfinite(total), low - (total - high), 0.0))
