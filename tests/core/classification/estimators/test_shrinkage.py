"""Shrunk covariances, beside scikit-learn's."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from sklearn.covariance import ledoit_wolf

from modalmotion.classification.estimators.shrinkage import shrunk_solution


@pytest.mark.parametrize(("n", "d"), [(50, 20), (30, 30), (20, 200)])
def test_it_solves_with_the_covariance_of_ledoit_and_wolf(
    n: int, d: int, rng: np.random.Generator
) -> None:
    X = rng.normal(size=(n, d)) @ rng.normal(size=(d, d))
    right = rng.normal(size=(d, 3))
    S, share = ledoit_wolf(X, assume_centered=True)
    assert 0.0 < share < 1.0
    expected = np.linalg.solve(S + 1e-9 * np.trace(S) / d * np.eye(d), right)
    assert shrunk_solution(X, right) == pytest.approx(expected, rel=1e-9, abs=1e-12)


def test_constant_columns_and_no_variance_at_all_are_solved_with(
    rng: np.random.Generator,
) -> None:
    X, right = rng.normal(size=(12, 5)), rng.normal(size=(5, 2))
    X[:, 2] = 0.0
    assert np.isfinite(shrunk_solution(X, right)).all()
    # The nearest mean is the best that can be said.
    assert np.array_equal(shrunk_solution(np.zeros((4, 5)), right), right)


def test_many_cases_take_memory_by_their_number(rng: np.random.Generator) -> None:
    X, right = rng.normal(size=(4000, 5)), rng.normal(size=(5, 2))
    tracemalloc.start()
    shrunk_solution(X, right)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # All pairs would take 800 times the cases.
    assert peak < 4 * X.nbytes
