"""Sums of two floats against exact fractions."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from modalmotion.modes import responses as twofold
from modalmotion.modes.responses import Twofold

number = st.floats(1e-60, 1e60)
TINY = Fraction(1, 2**100)


def one(x: float) -> np.ndarray:
    return np.array([x])


def value(x: Twofold) -> Fraction:
    return Fraction(float(x.high[0])) + Fraction(float(x.low[0]))


@given(a=st.floats(-1e60, 1e60), b=st.floats(-1e60, 1e60))
def test_sums_are_exact(a: float, b: float) -> None:
    assert value(twofold.add(one(a), one(b))) == Fraction(a) + Fraction(b)


@given(a=number, b=number, c=number)
def test_products_quotients_and_roots_keep_their_rounding(a: float, b: float, c: float) -> None:
    x = twofold.add(one(a), one(b))
    right = Fraction(a) + Fraction(b)
    assert abs(value(twofold.scale(x, one(c))) / (right * Fraction(c)) - 1) <= TINY
    assert abs(value(twofold.multiply(x, x)) / right**2 - 1) <= TINY
    assert abs(value(twofold.divide(one(c), x)) * right / Fraction(c) - 1) <= TINY
    assert abs(value(twofold.sqrt(x)) ** 2 / right - 1) <= TINY


def test_zero_and_overflow_leave_no_nan() -> None:
    zero, huge = twofold.add(one(0.0), one(0.0)), twofold.add(one(1e308), one(0.0))
    assert value(twofold.sqrt(zero)) == 0
    assert value(twofold.divide(one(3.0), zero)) == 0
    with np.errstate(over="ignore", invalid="ignore"):
        product = twofold.bounded(twofold.multiply(huge, huge))
    assert value(product) == Fraction(1e300)
