"""Motions turned and started like another one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from modalmotion.classification.features.alignment import _overlaps, align


@given(seed=st.integers(0, 2**32 - 1), rank=st.integers(0, 3), size=st.sampled_from([1e-9, 1, 1e9]))
def test_the_overlap_is_that_of_the_best_rotation(seed: int, rank: int, size: float) -> None:
    rng = np.random.default_rng(seed)
    C = size * (rng.normal(size=(5, 3, rank)) @ rng.normal(size=(5, rank, 3)))
    U, s, Vt = np.linalg.svd(C)
    s[:, 2] *= np.sign(np.linalg.det(U @ Vt))
    assert _overlaps(C) == pytest.approx(s.sum(axis=1), rel=1e-3)


@pytest.mark.parametrize("is_cycle", [True, False])
def test_a_motion_turned_and_started_otherwise_is_turned_back(
    is_cycle: bool, rng: np.random.Generator
) -> None:
    onto = rng.normal(size=(2, 5, 3)) + 1j * rng.normal(size=(2, 5, 3)) * is_cycle
    R = Rotation.random(random_state=rng).as_matrix()
    later = np.exp(1j * rng.uniform(0, 6) * np.arange(1, 3))[:, None, None] if is_cycle else 1.0
    found = align(2.0 * onto * later @ R, onto, is_cycle=is_cycle)
    # Starts are refined to a thousandth of a turn.
    assert np.abs(found - 2.0 * onto).max() < (0.05 if is_cycle else 1e-9)
