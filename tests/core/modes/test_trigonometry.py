from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from modalmotion.modes.lattice import cos_pi, exact_products, sin_pi

EPS = float(np.finfo(np.float64).eps)

denominators = st.one_of(st.integers(1, 1000), st.integers(1, 2**60 - 1))
numerators = st.integers(-(2**62), 2**62)


@given(numerator=numerators, denominator=denominators)
def test_to_full_relative_precision_however_large(numerator: int, denominator: int) -> None:
    k = np.array([numerator])
    with mp.workdps(60):
        angle = mp.pi * numerator / denominator
        for found, exact in (
            (cos_pi(k, denominator)[0], mp.cos(angle)),
            (sin_pi(k, denominator)[0], mp.sin(angle)),
        ):
            if abs(exact) < mp.mpf(10) ** -40:
                assert found == 0.0
            else:
                assert abs(found / exact - 1) <= 3 * EPS


@given(numerator=st.integers(-10_000, 10_000), denominator=st.integers(1, 1000))
def test_symmetries_are_exact(numerator: int, denominator: int) -> None:
    k, d = np.array([numerator]), denominator
    assert cos_pi(-k, d) == cos_pi(k, d)
    assert sin_pi(-k, d) == -sin_pi(k, d)
    assert cos_pi(k + 2 * d, d) == cos_pi(k, d)
    assert cos_pi(d - k, d) == -cos_pi(k, d)
    assert sin_pi(d - k, d) == sin_pi(k, d)
    # A sine is a cosine a quarter turn on, to the last bit; so are equal fractions.
    assert sin_pi(2 * k, 2 * d) == cos_pi(2 * k - d, 2 * d)
    assert cos_pi(12 * k, 12 * d) == cos_pi(k, d)


@pytest.mark.parametrize("quarter", [1, 2, 3, 5, 1000, 2**57])
def test_sine_and_cosine_of_an_eighth_of_a_turn_are_one_number(quarter: int) -> None:
    k = np.array([quarter])
    assert sin_pi(k, 4 * quarter) == cos_pi(k, 4 * quarter)
    assert sin_pi(3 * k, 4 * quarter) == -cos_pi(3 * k, 4 * quarter)


def test_landmarks() -> None:
    k = np.arange(9)
    assert cos_pi(k, 4)[[0, 2, 4, 6, 8]].tolist() == [1.0, 0.0, -1.0, 0.0, 1.0]
    assert sin_pi(k, 4)[[0, 2, 4, 6, 8]].tolist() == [0.0, 1.0, 0.0, -1.0, 0.0]


@given(
    some=st.lists(st.integers(-(2**62), 2**62), max_size=4),
    others=st.lists(st.integers(-(2**62), 2**62), max_size=4),
    modulus=st.integers(1, 2**62),
)
def test_products_are_those_of_exact_integers(
    some: list[int], others: list[int], modulus: int
) -> None:
    found = exact_products(
        np.array(some, dtype=np.int64), np.array(others, dtype=np.int64), modulus
    )
    assert found.dtype == np.int64
    assert found.tolist() == [[a * b % modulus for b in others] for a in some]
