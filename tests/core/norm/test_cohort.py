"""Cohorts of another machine or protocol are warned of."""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np
import pytest
from norm_controls import drawn, norm_of

from modalmotion.norm import cohort_deviation


def warned(shift: float, n_cohorts: int, seed: int) -> float:
    """Share of cohorts of ten that are warned of, shifted by a number of deviations."""
    rng = np.random.default_rng(seed)
    count = 0
    for _ in range(n_cohorts):
        controls = [drawn(rng, k) for k in range(40)]
        norm = norm_of(controls)
        spread = np.std([one.values for one in controls], axis=0)
        new = [drawn(rng, 100 + k) for k in range(10)]
        moved = [replace(one, values=one.values + shift * spread) for one in new]
        found = cohort_deviation(norm, moved)
        assert found.p is not None
        assert (found.warning is not None) == found.is_another == (found.p <= 0.05)
        count += found.is_another
    return count / n_cohorts


def test_a_shifted_cohort_is_warned_of_and_another_like_the_controls_is_not() -> None:
    assert warned(2.0, 4, seed=1) == 1.0
    assert warned(0.0, 8, seed=2) <= 0.25


@pytest.mark.soak
def test_shifted_cohorts_are_warned_of_and_others_as_often_as_stated() -> None:
    n = 200 * int(os.environ.get("SOAK", "1"))
    assert warned(2.0, n, seed=3) >= 0.95
    assert 0.015 <= warned(0.0, n, seed=4) <= 0.10


def test_a_few_recordings_are_no_cohort_and_are_answered_each(rng: np.random.Generator) -> None:
    norm = norm_of([drawn(rng, k) for k in range(20)])
    found = cohort_deviation(norm, [*norm.controls[:3], *(drawn(rng, 50 + k) for k in range(4))])
    assert (found.p, found.is_another, found.warning) == (None, None, None)
    assert len(found.deviations) == 7


def test_each_of_a_cohort_is_answered_too(rng: np.random.Generator) -> None:
    norm = norm_of([drawn(rng, k) for k in range(20)])
    new = [drawn(rng, 50 + k) for k in range(6)]
    found = cohort_deviation(norm, new)
    assert found.deviations == tuple(norm.deviation(one) for one in new)
    assert found.as_json()["n_recordings"] == 6


def test_other_conditions_make_another_cohort(rng: np.random.Generator) -> None:
    norm = norm_of([drawn(rng, k) for k in range(20)])
    varied = [
        replace(one, conditions={"frames": 10 + k % 3, "vertices": 72})
        for k, one in enumerate(norm.controls)
    ]
    new = [replace(drawn(rng, 50 + k), conditions={"frames": 30, "vertices": 72}) for k in range(8)]
    assert cohort_deviation(norm_of(varied), new).is_another
