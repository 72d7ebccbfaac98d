"""Deviation of a recording from controls: exact for any distribution, refused below n."""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np
import pytest
from norm_controls import beat, drawn, norm_of
from scipy.stats import binom

import modalmotion as mm
from modalmotion.errors import ModalMotionError, ParameterError
from modalmotion.norm import Norm, train_norm
from modalmotion.norm.deviations import attainable, fewest_controls
from modalmotion.simulate import MotionClass


@pytest.fixture(scope="module")
def norm() -> Norm:
    return train_norm([beat(seed) for seed in range(30)], "volunteers")


def false_alarms(n: int, n_repeats: int, *, has_covariates: bool, seed: int) -> dict[str, int]:
    """Times that a recording like the controls is called a deviation, at levels 5, 10, 20 %."""
    rng = np.random.default_rng(seed)
    counts = dict.fromkeys(("0.05", "0.1", "0.2", "any 0.05", "any 0.1", "any 0.2"), 0)
    for _ in range(n_repeats):
        *controls, own = (drawn(rng, k, has_covariates=has_covariates) for k in range(n + 1))
        found = norm_of(controls).deviation(own, level=0.2)
        for level in (0.05, 0.1, 0.2):
            counts[f"{level}"] += found.p <= level + 1e-9
            counts[f"any {level}"] += min(group.p for group in found.groups) <= level + 1e-9
    return counts


def require_exact(n: int, n_repeats: int, *, has_covariates: bool, seed: int) -> None:
    counts = false_alarms(n, n_repeats, has_covariates=has_covariates, seed=seed)
    for name, count in counts.items():
        share = attainable(float(name.split()[-1]), n)
        low, high = binom.ppf([0.005, 0.995], n_repeats, share)
        assert low <= count <= high, (name, count, low, high)


@pytest.mark.every(2)
@pytest.mark.parametrize("has_covariates", [False, True])
def test_false_alarms_are_as_frequent_as_stated(has_covariates: bool) -> None:
    require_exact(39, 150, has_covariates=has_covariates, seed=3)


@pytest.mark.soak
@pytest.mark.parametrize("has_covariates", [False, True])
@pytest.mark.parametrize("n", [20, 50, 100, 500])
def test_false_alarms_in_a_thousand_new_cohorts(n: int, has_covariates: bool) -> None:
    repeats = 1000 * int(os.environ.get("SOAK", "1"))
    require_exact(n, repeats, has_covariates=has_covariates, seed=n)


def test_a_weak_heart_deviates_by_its_contraction(norm: Norm) -> None:
    found = norm.deviation(beat(1000, MotionClass.HYPOKINESIA), level=0.05)
    assert found.deviates
    assert found.p == pytest.approx(1 / 31)
    assert "contraction: less than in controls" in found.lines
    by_name = {one.name: one for one in found.quantities}
    assert by_name["ejection_fraction"].share_less == 0.0
    assert by_name["ejection_fraction"].p == pytest.approx(1 / 31)
    assert by_name["end_systolic_volume"].share_less == 1.0
    assert by_name["end_systolic_volume"].unit == "ml"
    assert found.warnings == ()


def test_most_controls_of_another_draw_do_not(norm: Norm) -> None:
    found = [norm.deviation(beat(2000 + k)) for k in range(12)]
    assert sum(one.deviates for one in found) <= 2
    assert all(one.attainable <= 0.05 for one in found)


def test_a_control_is_compared_with_the_others(norm: Norm) -> None:
    found = norm.deviation(beat(3))
    assert found.n_controls == 29
    assert any("one of the controls" in note for note in found.notes)


def test_a_turned_and_moved_recording_gets_the_same_answer(norm: Norm) -> None:
    one = beat(1001, MotionClass.DYSSYNCHRONY)
    turn, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    moved = replace(one, vertices=one.vertices @ turn + 100.0)
    a, b = norm.deviation(one), norm.deviation(moved)
    assert (a.p, [g.p for g in a.groups]) == (b.p, [g.p for g in b.groups])


def test_a_level_needs_its_controls(norm: Norm) -> None:
    assert [fewest_controls(level) for level in (0.01, 0.05, 0.1)] == [99, 19, 9]
    with pytest.raises(ParameterError, match="needs 99") as refused:
        norm.deviation(beat(1000), level=0.01)
    assert "69 controls" in refused.value.remedy
    # The remedy's level is enough.
    level = float(refused.value.remedy.rstrip(".").rsplit(" ", 1)[1])
    assert norm.deviation(beat(1000), level=level).level == level
    for wrong in (0.0, 0.7, float("nan")):
        with pytest.raises(ParameterError):
            norm.deviation(beat(1000), level=wrong)


def test_other_conditions_are_warned_of(norm: Norm) -> None:
    rng = np.random.default_rng(5)
    other = mm.simulate_ventricle(grid=(12, 24), acquisition=mm.Acquisition(n_frames=25), rng=rng)
    warnings = " ".join(norm.deviation(other).warnings)
    assert "number of frames: 25" in warnings
    assert "number of vertices: 288" in warnings


def test_points_that_slide_are_not_compared_with_points_that_do_not(norm: Norm) -> None:
    sliding = beat(1000)
    sliding = replace(sliding, facts=replace(sliding.facts, tracking="normal_displacement"))
    with pytest.raises(ParameterError, match="tracking of this recording is normal_displacement"):
        norm.deviation(sliding)


def test_other_modes_are_refused(norm: Norm) -> None:
    signature = mm.modal_signature(beat(1), mm.SignatureParameters(modes=4))
    with pytest.raises(ModalMotionError, match="does not compare"):
        norm.deviation(signature)


def test_covariates_are_accounted_for_where_controls_are_enough() -> None:
    rng = np.random.default_rng(8)
    *controls, own = (drawn(rng, k, has_covariates=True) for k in range(61))
    found = norm_of(controls).deviation(own)
    assert found.covariates == ("age", "sex")
    few = norm_of(controls[:25]).deviation(own)
    assert few.covariates == ("age",)
    assert any("sex is not accounted for" in note for note in few.notes)
    silent = norm_of(controls).deviation(replace(own, covariates={"age": 50.0}))
    assert silent.covariates == ("age",)
    other = norm_of(controls).deviation(replace(own, covariates={"age": 95.0, "sex": "x"}))
    assert any("no control has sex = x" in note for note in other.notes)
    assert any("age: 95" in words for words in other.warnings)


def test_an_old_person_is_compared_as_an_old_person() -> None:
    rng = np.random.default_rng(9)
    *controls, own = (drawn(rng, k, has_covariates=True) for k in range(81))
    values = own.values.copy()
    values[:5] += 0.1 * (79.0 - float(own.covariates["age"]))
    old = replace(own, values=values, covariates={**own.covariates, "age": 79.0})
    young = replace(old, covariates={**own.covariates, "age": 20.0})
    norm = norm_of(controls)
    assert norm.deviation(old).p > norm.deviation(young).p


def test_signatures_have_no_volumes() -> None:
    signatures = [mm.modal_signature(beat(k), mm.SignatureParameters(modes=7)) for k in range(20)]
    norm = train_norm(signatures[:19], "plain")
    assert norm.deviation(signatures[19]).quantities == ()
