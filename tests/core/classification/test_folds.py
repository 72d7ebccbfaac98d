"""Folds of the cross-validation: by subject, or the user's own."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from classify_samples import QUICK_CARD, cohort
from sklearn.model_selection import LeaveOneGroupOut, ShuffleSplit, StratifiedKFold

from modalmotion.classification import TrainingOptions, train
from modalmotion.classification.cohort import Cohort, collect_cohorts
from modalmotion.classification.folds import split_cases
from modalmotion.errors import ParameterError


def collected(cases: list[Any] | None = None) -> Cohort:
    options = TrainingOptions(kind="material")
    return collect_cohorts(cohort(6) if cases is None else cases, None, options)[0]


def test_no_subject_is_on_both_sides_and_each_repetition_is_another_split() -> None:
    cases = [replace(c, subject=f"s{n // 6}-{c.label}") for n, c in enumerate(cohort(12))]
    own = collected(cases)
    found = split_cases(own, TrainingOptions(repetitions=4))
    assert found.is_grouped
    for repetition in found.repetitions:
        assert sorted(np.concatenate([outer for _, outer in repetition])) == list(range(24))
        for inner, outer in repetition:
            assert not set(own.groups[inner]) & set(own.groups[outer])
    assert len(found.repetitions) > 1


def test_a_class_of_one_subject_is_split_by_case_and_said_so() -> None:
    cases = [replace(c, subject="one" if c.label == "normal" else None) for c in cohort(6)]
    found = split_cases(collected(cases), TrainingOptions())
    assert not found.is_grouped
    assert "has one subject only" in found.notes[0]
    single = [c for c in cases if c.label != "normal"] + [cases[0]]
    none = split_cases(collected(single), TrainingOptions())
    assert none.repetitions == []
    model = train(single, "alone", QUICK_CARD)
    assert model.card.accuracy is None
    assert "no cross-validation" in " ".join(model.card.notes)


def test_a_splitter_of_scikit_learn_and_its_pairs_are_the_same_folds() -> None:
    own, splitter = collected(), StratifiedKFold(3, shuffle=True, random_state=1)
    pairs = list(splitter.split(np.zeros(12), own.y))
    for given in (splitter, pairs):
        (folds,), _, notes = split_cases(own, TrainingOptions(), given)
        assert notes[0] == "The folds are the user's own."
        for (inner, outer), (a, b) in zip(folds, pairs, strict=True):
            assert inner.tolist() == a.tolist()
            assert outer.tolist() == b.tolist()


def test_own_folds_that_tear_subjects_apart_are_used_and_said_so() -> None:
    cases = [replace(c, subject=f"s{n // 2}") for n, c in enumerate(cohort(6))]
    halves = [(range(0, 12, 2), range(1, 12, 2)), (range(1, 12, 2), range(0, 12, 2))]
    cases = [replace(c, label="ab"[n // 2 % 2]) for n, c in enumerate(cases)]
    found = split_cases(collected(cases), TrainingOptions(), halves)
    assert not found.is_grouped
    assert any("on both sides of a split: 6" in note for note in found.notes)


def test_folds_that_are_none_are_refused() -> None:
    own = collected()
    every, half = range(12), range(6)
    for wrong, words in (
        ([(every, half)], "both fits to and predicts"),
        ([(half, range(6, 11))], "0 times"),
        ([(half, range(6, 13))], "names the case 12"),
        ([(0.5, 1.5)], "gives no folds"),
        (ShuffleSplit(3, random_state=0), "times"),
        (LeaveOneGroupOut(), None),
    ):
        if words is None:
            assert len(split_cases(own, TrainingOptions(), wrong).repetitions[0]) == 12
            continue
        with pytest.raises(ParameterError, match=words):
            split_cases(own, TrainingOptions(), wrong)


def test_groups_that_go_with_the_classes_are_refused() -> None:
    cases = [replace(c, covariates={"site": c.label}) for c in cohort(6)]
    options = TrainingOptions(kind="material", groups="site")
    own = collect_cohorts(cases, None, options)[0]
    found = split_cases(own, options)
    assert not found.is_grouped
    assert "one value of site only" in found.notes[0]
