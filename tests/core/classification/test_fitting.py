"""The fit: tables weighed by cases left out, and the folds of cross-validation."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from classify_samples import QUICK_CARD, cohort, curves
from scipy.special import softmax

from modalmotion.classification import TrainingCase, TrainingOptions, train
from modalmotion.classification.cohort import Cohort, collect_cohorts
from modalmotion.classification.fitting import Fit, better, fit_rows, split_cases, tables_of
from modalmotion.classification.linear import log_losses
from modalmotion.errors import ParameterError
from modalmotion.mesh.sequence import MEAN
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.simulate import MotionClass, simulate_cohort

KIND = TrainingOptions(kind="material")


def collected(cases: list[TrainingCase]) -> Cohort:
    return collect_cohorts(cases, None, KIND)[0]


def hearts(cavity: Any = "lv") -> list[TrainingCase]:
    asked = SignatureParameters(modes=12, reference=MEAN, volumes=True)
    classes = (MotionClass.NORMAL, MotionClass.HYPOKINESIA)
    drawn = simulate_cohort(4, rng=np.random.default_rng(5), classes=classes)
    made = []
    for case in drawn:
        facts = replace(case.sequence.facts, cavity=cavity)
        signature = modal_signature(replace(case.sequence, facts=facts), asked)
        made.append(TrainingCase(signature, str(case.label)))
    return made


def test_a_volume_is_read_of_a_cavity_alone() -> None:
    assert tables_of(collected(hearts()), KIND)[-1].extractor.what == "volume"
    tables = tables_of(collected(hearts("none")), KIND)
    assert all(one.extractor.reads_motion for one in tables)


def test_the_score_is_the_sum_of_at_most_five_tables_whose_weights_add_up() -> None:
    own, every = collected(cohort(6)), np.arange(12)
    fit = fit_rows(own, tables_of(own, KIND), every)
    assert 1 <= len(fit.tables) <= 5
    assert sum(table.weight for table in fit.tables) == pytest.approx(1.0)
    assert softmax(fit.scores(every), axis=1).shape == (12, 2)
    weights = [table.weight for table in fit.tables]
    assert weights == sorted(weights, reverse=True)


def test_what_tells_the_classes_apart_weighs_most() -> None:
    own, every = collected(curves(12)), np.arange(24)
    tables = tables_of(own, KIND)
    losses = {id(one): fit_rows(own, [one], every).losses.mean() for one in tables}
    heaviest = fit_rows(own, tables, every).tables[0].table
    assert losses[id(heaviest)] < 1.5 * min(losses.values()) + 0.05


def test_no_case_takes_part_in_its_own_left_out_loss() -> None:
    # Labels by chance: seen from within they would be learned.
    rng = np.random.default_rng(6)
    cases = [replace(case, label=str(rng.integers(2))) for case in curves(12)]
    own = collected(cases)
    fit = fit_rows(own, tables_of(own, KIND), np.arange(24))
    assert fit.losses.mean() > 0.55


def test_another_basis_must_be_surely_better() -> None:
    groups = np.arange(20)
    plain = Fit((), np.full(20, 1.0), groups)
    noisy = Fit((), 1.0 + np.where(groups % 2, 1.0, -1.01), groups)
    surely = Fit((), np.full(20, 0.5), groups)
    assert better([plain, noisy]) == 0
    assert better([plain, surely]) == 1


def test_losses_of_cases_fitted_to_are_lower_than_of_those_left_out() -> None:
    own, every = collected(cohort(6)), np.arange(12)
    fit = fit_rows(own, tables_of(own, KIND), every)
    assert log_losses(fit.scores(every), own.y).mean() < fit.losses.mean()


def folded_cohort(cases: list[Any] | None = None) -> Cohort:
    options = TrainingOptions(kind="material")
    return collect_cohorts(cohort(6) if cases is None else cases, None, options)[0]


def test_no_subject_is_on_both_sides_and_each_repetition_is_another_split() -> None:
    cases = [replace(c, subject=f"s{n // 6}-{c.label}") for n, c in enumerate(cohort(12))]
    own = folded_cohort(cases)
    found = split_cases(own, TrainingOptions(repetitions=4))
    assert found.is_grouped
    for repetition in found.repetitions:
        assert sorted(np.concatenate([outer for _, outer in repetition])) == list(range(24))
        for inner, outer in repetition:
            assert not set(own.groups[inner]) & set(own.groups[outer])
    assert len(found.repetitions) > 1


def test_a_class_of_one_subject_is_split_by_case_and_said_so() -> None:
    cases = [replace(c, subject="one" if c.label == "normal" else None) for c in cohort(6)]
    found = split_cases(folded_cohort(cases), TrainingOptions())
    assert not found.is_grouped
    assert "has one subject only" in found.notes[0]
    single = [c for c in cases if c.label != "normal"] + [cases[0]]
    none = split_cases(folded_cohort(single), TrainingOptions())
    assert none.repetitions == []
    model = train(single, "alone", QUICK_CARD)
    assert model.card.accuracy is None
    assert "no cross-validation" in " ".join(map(str, model.card.notes))


def test_folds_of_the_users_own_predict_each_case_in_its_fold() -> None:
    own, folds = folded_cohort(), np.arange(12) % 3
    (found,), _, notes = split_cases(own, TrainingOptions(), folds)
    assert notes[0].text == "The folds are the user's own."
    for k, (inner, outer) in enumerate(found):
        assert outer.tolist() == np.flatnonzero(folds == k).tolist()
        assert inner.tolist() == np.flatnonzero(folds != k).tolist()


def test_own_folds_that_tear_subjects_apart_are_used_and_said_so() -> None:
    cases = [replace(c, subject=f"s{n // 2}") for n, c in enumerate(cohort(6))]
    cases = [replace(c, label="ab"[n // 2 % 2]) for n, c in enumerate(cases)]
    found = split_cases(folded_cohort(cases), TrainingOptions(), [0, 1] * 6)
    assert not found.is_grouped
    assert any("on both sides of a split: 6" in note for note in found.notes)


def test_folds_that_are_none_are_refused() -> None:
    own = folded_cohort()
    by_class = own.y[np.argsort(own.numbers)]
    for wrong, words in (
        ([0, 1], "has the shape"),
        ([0] * 12, "fewer than two classes"),
        (by_class, "fewer than two classes"),
    ):
        with pytest.raises(ParameterError, match=words):
            split_cases(own, TrainingOptions(), wrong)


def test_groups_that_go_with_the_classes_are_refused() -> None:
    cases = [replace(c, covariates={"site": c.label}) for c in cohort(6)]
    options = TrainingOptions(kind="material", groups="site")
    own = collect_cohorts(cases, None, options)[0]
    found = split_cases(own, options)
    assert not found.is_grouped
    assert "one value of site only" in found.notes[0]
