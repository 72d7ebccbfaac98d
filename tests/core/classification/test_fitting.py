"""Tables weighed: at most five, the one that tells the classes apart before others."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from classify_samples import cohort, curves

from modalmotion.classification import TrainingCase, TrainingOptions
from modalmotion.classification.cohort import Cohort, collect_cohorts
from modalmotion.classification.fitting import Fit, Tables, better, fit_rows
from modalmotion.classification.linear import log_losses, softmax
from modalmotion.mesh.sequence import MEAN
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.simulate import MotionClass, simulate_cohort

KIND = TrainingOptions(kind="material")


def collected(cases: list[TrainingCase]) -> Cohort:
    return collect_cohorts(cases, None, KIND)[0]


def hearts(cavity: Any = "lv") -> list[TrainingCase]:
    asked = SignatureParameters(modes=12, reference=MEAN, volumes=True)
    classes = (MotionClass.NORMAL, MotionClass.HYPOKINESIA)
    drawn = simulate_cohort(8, rng=np.random.default_rng(5), classes=classes)
    made = []
    for case in drawn:
        facts = replace(case.sequence.facts, cavity=cavity)
        signature = modal_signature(replace(case.sequence, facts=facts), asked)
        made.append(TrainingCase(signature, str(case.label)))
    return made


def test_a_volume_is_read_of_a_cavity_alone() -> None:
    assert any("volume" in one.beside for one in Tables(collected(hearts()), KIND).beside)
    tables = Tables(collected(hearts("none")), KIND)
    assert not any("volume" in one.beside for one in tables.beside)


def test_the_score_is_the_sum_of_at_most_five_tables_whose_weights_add_up() -> None:
    tables = Tables(collected(cohort(6)), KIND)
    every = np.arange(len(tables.cohort))
    fit = fit_rows(tables, every)
    assert 1 <= len(fit.tables) <= 5
    assert sum(table.weight for table in fit.tables) == pytest.approx(1.0)
    assert softmax(fit.scores(every)).shape == (12, 2)
    weights = [table.weight for table in fit.tables]
    assert weights == sorted(weights, reverse=True)


def test_what_tells_the_classes_apart_weighs_most() -> None:
    tables = Tables(collected(curves(12)), KIND)
    fit = fit_rows(tables, np.arange(24))
    losses = {}
    for one in (*tables.of_motion, *tables.beside):
        alone = Tables(tables.cohort, KIND)
        alone.of_motion, alone.beside = (one,), ()
        losses[one.description] = fit_rows(alone, np.arange(24)).losses.mean()
    assert losses[fit.choices[0][0]] < 1.5 * min(losses.values()) + 0.05
    assert all("size" not in name.split("; ") for name, weight in fit.choices if weight > 0.4)


def test_no_case_takes_part_in_its_own_left_out_loss() -> None:
    # Labels by chance: seen from within they would be learned.
    rng = np.random.default_rng(6)
    cases = [replace(case, label=str(rng.integers(2))) for case in curves(12)]
    tables = Tables(collected(cases), KIND)
    fit = fit_rows(tables, np.arange(24))
    assert fit.losses.mean() > 0.55


def test_another_basis_must_be_surely_better() -> None:
    groups = np.arange(20)
    plain = Fit((), np.full(20, 1.0), groups)
    noisy = Fit((), 1.0 + np.where(groups % 2, 1.0, -1.01), groups)
    surely = Fit((), np.full(20, 0.5), groups)
    assert better([plain, noisy]) == 0
    assert better([plain, surely]) == 1


def test_losses_of_cases_fitted_to_are_lower_than_of_those_left_out() -> None:
    tables = Tables(collected(cohort(6)), KIND)
    every = np.arange(len(tables.cohort))
    fit = fit_rows(tables, every)
    assert log_losses(fit.scores(every), tables.cohort.y).mean() < fit.losses.mean()
