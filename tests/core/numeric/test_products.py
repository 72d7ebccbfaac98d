"""Products, QR and quantiles against the plain ones."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from modalmotion.numeric.products import (
    LARGEST_SINGLE_THREADED,
    LARGEST_WITH_VECTOR,
    along,
    exceeded_by_a_twentieth,
    inverse_of_triangle,
    product,
    second_moments,
    tall_qr,
    tile,
    weighted_sum,
)

SIZES = st.integers(1, 3000)


@given(SIZES, SIZES, SIZES)
def test_tiles_stay_on_one_thread(m: int, n: int, k: int) -> None:
    rows, columns, depth = tile(m, n, k)
    assert rows * columns * depth <= LARGEST_SINGLE_THREADED
    if 1 in (m, n):
        assert rows * columns * depth <= LARGEST_WITH_VECTOR
    # What is left over at the ends may be a vector, and must then be small, too.
    for length, whole in ((rows, m), (columns, n)):
        if whole % length == 1 and whole > 1:
            other = columns if length == rows else rows
            assert other * depth <= LARGEST_WITH_VECTOR


@pytest.mark.parametrize(
    ("m", "n", "k"),
    [(75, 8, 4000), (3, 3, 100_000), (1, 1, 20_000), (75, 4000, 11), (300, 112, 500), (5, 6, 7)],
)
def test_products_against_matmul(m: int, n: int, k: int) -> None:
    rng = np.random.default_rng(0)
    A, B = rng.normal(size=(m, k)), rng.normal(size=(k, n))
    out = np.full((m, n), np.nan)
    assert product(A, B, out=out) is out
    assert np.abs(out - A @ B).max() <= 1e-11
    assert np.abs(product(np.asfortranarray(A), B[:, ::-1]) - A @ B[:, ::-1]).max() <= 1e-11


@pytest.mark.parametrize(
    ("m", "n", "k"),
    [(75, 8, 4000), (75, 16, 4001), (75, 4000, 12), (300, 112, 1572), (1, 9, 50_000)],
)
def test_products_have_the_same_bits_on_two_threads(m: int, n: int, k: int) -> None:
    threadpoolctl = pytest.importorskip("threadpoolctl")
    rng = np.random.default_rng(0)
    A, B = rng.normal(size=(m, k)), rng.normal(size=(k, n))
    results = []
    for threads in (1, 2):
        with threadpoolctl.threadpool_limits(threads):
            results.append(product(A, B))
    assert (results[0] == results[1]).all()


def test_an_empty_sum_is_zero() -> None:
    assert (product(np.zeros((2, 0)), np.zeros((0, 3))) == 0).all()


def test_sums() -> None:
    rng = np.random.default_rng(0)
    w, x, y = rng.random(500), rng.normal(size=(500, 3)), rng.normal(size=(500, 2))
    assert weighted_sum(w, x) == pytest.approx(w @ x)
    assert second_moments(w, x, y) == pytest.approx((w[:, None] * x).T @ y)
    direction = np.array([1.0, -2.0, 0.5])
    assert along(x, direction) == pytest.approx(x @ direction)


@pytest.mark.parametrize(("n", "m"), [(5, 5), (1000, 7), (2100, 7), (9000, 37), (1500, 300)])
def test_tall_qr(n: int, m: int) -> None:
    A = np.random.default_rng(0).normal(size=(n, m)) * np.logspace(0, -6, m)
    Q, R = tall_qr(A)
    assert np.abs(Q.T @ Q - np.eye(m)).max() <= 1e-13
    assert np.abs(Q @ R - A).max() <= 1e-12
    assert (np.triu(R) == R).all()
    assert (np.diag(R) > 0).all()
    reference = np.linalg.qr(A)[1]
    assert np.allclose(np.abs(R), np.abs(reference), rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("n", [1, 7, 64, 65, 130, 300])
def test_inverse_of_a_triangle(n: int) -> None:
    R = np.triu(np.random.default_rng(0).normal(size=(n, n)), 1) / np.sqrt(n) + np.eye(n)
    inverse = inverse_of_triangle(R)
    assert (np.triu(inverse) == inverse).all()
    assert np.abs(inverse @ R - np.eye(n)).max() <= 1e-10


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
