"""Decompositions of one small matrix, beside numpy's."""

from __future__ import annotations

import numpy as np
import pytest

from modalmotion.numeric.small_svd import singular_values, small_svd


@pytest.mark.parametrize("shape", [(7, 3), (3, 3), (2, 3), (30, 1)])
def test_singular_values_are_those_of_numpy(
    shape: tuple[int, int], rng: np.random.Generator
) -> None:
    A = rng.normal(size=shape)
    before = A.copy()
    assert singular_values(A) == pytest.approx(np.linalg.svd(A, compute_uv=False), rel=1e-12)
    assert np.array_equal(A, before)
    assert not singular_values(np.zeros(shape)).any()


def test_factors_give_the_matrix_back(rng: np.random.Generator) -> None:
    A = rng.normal(size=(3, 3))
    U, s, Vt = small_svd(A)
    assert (U * s) @ Vt == pytest.approx(A)
    for turn in (U, Vt):
        np.testing.assert_allclose(turn.T @ turn, np.eye(3), atol=1e-12)


def test_what_is_no_number_is_refused() -> None:
    with pytest.raises(np.linalg.LinAlgError):
        singular_values(np.full((3, 3), np.nan))
