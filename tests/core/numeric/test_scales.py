"""Norms, quantiles and factors against the plain ones, at any size."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from modalmotion.numeric.scales import (
    exceeded_by_a_twentieth,
    gram,
    inverse_of_cholesky,
    orthonormal,
    power_of_two,
    root_mean_square,
)


@pytest.mark.parametrize("size", [1e-300, 2.0**-1000, 0.3, 1.0, 7.0, 2.0**200, 1e300])
def test_dividing_by_a_power_of_two_costs_no_digit(size: float) -> None:
    scale = power_of_two(size)
    assert np.frexp(scale)[0] == 0.5
    assert size / scale * scale == size
    assert 0.5 <= size / scale < 1.0


def test_nothing_is_not_scaled_and_extremes_stay_in_range() -> None:
    assert power_of_two(0.0) == 1.0
    assert power_of_two(5e-324) == 2.0**-1000
    assert power_of_two(1.7e308) == 2.0**1000


@pytest.mark.parametrize("unit", [1e-300, 1.0, 1e300])
def test_squares_neither_overflow_nor_vanish(unit: float) -> None:
    assert root_mean_square(unit * np.array([3.0, -4.0])) == pytest.approx(unit * np.sqrt(12.5))
    assert root_mean_square(np.zeros(3)) == 0.0


@pytest.mark.parametrize(("n", "m"), [(5, 5), (1000, 7), (1500, 300)])
def test_a_factor_has_a_positive_diagonal(n: int, m: int) -> None:
    A = np.random.default_rng(0).normal(size=(n, m)) * np.logspace(0, -6, m)
    Q, R = orthonormal(A)
    assert np.abs(Q.T @ Q - np.eye(m)).max() <= 1e-13
    assert np.abs(Q @ R - A).max() <= 1e-12
    assert (np.triu(R) == R).all()
    assert (np.diag(R) > 0).all()


@given(st.integers(0, 2**32 - 1), st.integers(1, 80), st.booleans())
def test_quantiles_against_counting(seed: int, n: int, has_ties: bool) -> None:
    values = np.random.default_rng(seed).random((3, n))
    if has_ties:
        values = np.round(values * 4)
    found = exceeded_by_a_twentieth(values)
    for row, value in zip(values, found, strict=True):
        # At most one in twenty is above it, and more are above anything smaller.
        assert 20 * (row > value).sum() <= n
        assert all(20 * (row > smaller).sum() > n for smaller in row[row < value])


@pytest.mark.parametrize("n", [512, 519, 3300])
def test_quantiles_of_long_rows_are_those_of_sorted_ones(n: int) -> None:
    rng = np.random.default_rng(n)
    values = rng.chisquare(3, size=(4, n))
    # The sample sees only the largest, or none of them.
    misleading = np.where(np.arange(n) % 8 == 0, 2.0 + rng.random((4, n)), rng.random((4, n)))
    for rows in (
        values,
        np.round(values),
        np.zeros((2, n)),
        np.sort(values),
        misleading,
        -misleading,
    ):
        expected = np.sort(rows, axis=1)[:, n - 1 - n // 20]
        assert exceeded_by_a_twentieth(rows).tolist() == expected.tolist()


def definite(n: int, rng: np.random.Generator) -> np.ndarray:
    A = rng.normal(size=(n, n + 5))
    return A @ A.T + np.diag(10.0 ** rng.uniform(0, 4, n))


@pytest.mark.every(2)
@pytest.mark.parametrize("n", [1, 47, 48, 49, 111, 200])
def test_inverse_is_that_of_the_triangle(n: int, rng: np.random.Generator) -> None:
    A = definite(n, rng)
    inverse = inverse_of_cholesky(A)
    assert np.array_equal(inverse, np.tril(inverse))
    assert inverse @ A @ inverse.T == pytest.approx(np.eye(n), abs=1e-9)
    full = gram(inverse)
    assert np.array_equal(full, full.T)
    assert full == pytest.approx(np.linalg.inv(A), rel=1e-7, abs=1e-9 * np.abs(full).max())


def test_what_is_not_positive_definite_is_refused() -> None:
    with pytest.raises(np.linalg.LinAlgError):
        inverse_of_cholesky(np.diag([1.0, -1.0]))
