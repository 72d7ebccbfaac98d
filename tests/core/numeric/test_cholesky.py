"""Positive definite systems: solved as NumPy does, with the same bits on any number of threads."""

from __future__ import annotations

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from modalmotion.numeric.products import gram, inverse_of_cholesky


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


def test_bits_do_not_depend_on_the_threads(rng: np.random.Generator) -> None:
    A = definite(444, rng)
    results = []
    for threads in (1, 2):
        with threadpool_limits(threads):
            results.append(gram(inverse_of_cholesky(A)))
    assert np.array_equal(results[0], results[1])


def test_what_is_not_positive_definite_is_refused() -> None:
    with pytest.raises(np.linalg.LinAlgError):
        inverse_of_cholesky(np.diag([1.0, -1.0]))
