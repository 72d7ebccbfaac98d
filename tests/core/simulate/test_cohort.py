"""Cohorts: labelled, varied, reproducible, and each class what its name says."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from modalmotion.errors import ParameterError
from modalmotion.simulate import MotionClass, draw_parameters, simulate_cohort


def test_a_cohort_is_balanced_varied_and_reproducible() -> None:
    def cohort(seed: int) -> list[tuple[str, MotionClass]]:
        rng = np.random.default_rng(seed)
        return [(c.sequence.id, c.label) for c in simulate_cohort(2, rng=rng, n_frames=(3, 6))]

    first = cohort(1)
    assert Counter(label for _, label in first) == dict.fromkeys(MotionClass, 2)
    assert len({identity for identity, _ in first}) == len(first)
    assert cohort(1) == first != cohort(2)


def test_recordings_of_a_cohort_differ(rng: np.random.Generator) -> None:
    cases = list(
        simulate_cohort(
            6, rng=rng, classes=[MotionClass.NORMAL], n_frames=(4, 9), any_start=True, noise=0.0
        )
    )
    assert len({case.sequence.n_frames for case in cases}) > 2
    assert {case.sequence.grid is None for case in cases} == {False, True}
    assert all(4 <= case.sequence.n_frames <= 9 for case in cases)
    lattices = simulate_cohort(
        2, rng=rng, classes=[MotionClass.NORMAL], triangle_share=0.0, n_frames=(2, 2)
    )
    assert all(case.sequence.grid is not None for case in lattices)


def test_every_class_has_what_it_is_named_for(rng: np.random.Generator) -> None:
    drawn = {label: [draw_parameters(label, rng) for _ in range(200)] for label in MotionClass}
    normal = drawn[MotionClass.NORMAL]
    assert all(0.54 <= p.ejection_fraction <= 0.72 for p in normal)
    assert all(9 <= p.twist <= 20 and p.akinesia == 0 and p.delay <= 0.03 for p in normal)
    assert all(p.ejection_fraction <= 0.50 for p in drawn[MotionClass.HYPOKINESIA])
    assert all(p.akinesia >= 0.5 for p in drawn[MotionClass.AKINESIA])
    assert all(0.055 <= p.delay <= 0.15 for p in drawn[MotionClass.DYSSYNCHRONY])
    for p in drawn[MotionClass.REDUCED_TORSION]:
        assert abs(p.twist) <= 5.0
        assert p.ejection_fraction >= 0.54
    # A region that does not contract is missing in the whole ejection.
    lost = [p.ejection_fraction for p in drawn[MotionClass.AKINESIA]]
    assert np.mean(lost) < np.mean([p.ejection_fraction for p in normal]) - 0.05


@pytest.mark.parametrize(
    "options", [{"n_per_class": -1}, {"triangle_share": 1.5}, {"n_frames": (0, 3)}]
)
def test_a_cohort_out_of_range_is_refused(
    options: dict[str, object], rng: np.random.Generator
) -> None:
    asked = {"n_per_class": 1, **options}
    with pytest.raises(ParameterError):
        next(simulate_cohort(rng=rng, **asked))  # type: ignore[arg-type]
