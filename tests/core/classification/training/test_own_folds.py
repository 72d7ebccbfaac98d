"""Folds of the user's own, and cases that are kept together."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from classify_samples import cohort
from sklearn.model_selection import LeaveOneGroupOut, PredefinedSplit, ShuffleSplit, StratifiedKFold

from modalmotion.classification import TrainingCase, TrainingOptions, train
from modalmotion.classification.training import splits
from modalmotion.classification.training.collection import collect
from modalmotion.classification.training.own_folds import folds_by, folds_of
from modalmotion.classification.training.splits import split_cases
from modalmotion.classification.training.table import CaseTable
from modalmotion.errors import ParameterError

N_PER_CLASS = 6
SITES = ("A", "B", "C")


def cases(*, subject: str | None = None) -> list[TrainingCase]:
    """Classes by turns; each pair of cases is from the next of three sites."""
    return [
        TrainingCase(
            case.motion,
            case.label,
            subject or case.subject,
            covariates={"site": SITES[k // 2 % 3], "fold": k // 4, "age": 50 + k},
        )
        for k, case in enumerate(cohort(N_PER_CLASS))
    ]


def options(**more: Any) -> TrainingOptions:
    return TrainingOptions(**{"estimator": "linear", "repetitions": 1, "card": "quick", **more})


def table(**more: Any) -> CaseTable:
    return collect(cases(), options(**more))


def held_out(table: CaseTable, chosen: TrainingOptions) -> list[list[int]]:
    return sorted(sorted(outer.tolist()) for _, outer in split_cases(table, chosen).folds)


def test_a_splitter_of_scikit_learn_and_its_pairs_are_the_same_folds() -> None:
    splitter = StratifiedKFold(3, shuffle=True, random_state=1)
    labels = [case.label for case in cases()]
    pairs = list(splitter.split(np.zeros((len(labels), 1)), labels))
    one, other = (train(cases(), "own", options(), cv=cv) for cv in (splitter, pairs))
    assert one.card == other.card
    assert one.card.accuracy is not None
    assert "The folds are the user's own." in one.card.notes
    assert one.card != train(cases(), "own", options()).card


def test_a_splitter_sees_labels_and_groups() -> None:
    found = table(groups="site")
    labels = [found.classes[k] for k in found.y]
    folds = folds_of(LeaveOneGroupOut(), found.numbers, len(found), labels, found.groups)
    assert len(folds) == len(SITES)
    for inner, outer in folds:
        assert len({found.groups[i] for i in outer}) == 1
        assert not set(found.groups[inner]) & set(found.groups[outer])


def test_the_folds_of_a_column_are_its_values() -> None:
    chosen = options(fold="FOLD")
    assert held_out(collect(cases(), chosen), chosen) == [
        list(range(4 * k, 4 * k + 4)) for k in range(3)
    ]


@pytest.mark.parametrize("groups", ["site", "Site"])
def test_cases_of_one_site_are_on_one_side_of_each_split(groups: str) -> None:
    chosen = options(groups=groups)
    found = collect(cases(), chosen)
    assert len(np.unique(found.groups)) == len(SITES)
    sites = np.array([case.covariates["site"] for case in cases()])
    found_splits = split_cases(found, chosen)
    assert found_splits.is_grouped
    assert found_splits.folds
    for inner, outer in found_splits.folds:
        assert not set(sites[inner]) & set(sites[outer])


def test_a_case_of_no_known_site_is_a_group_of_its_own() -> None:
    some = cases()
    some[0] = TrainingCase(cohort(N_PER_CLASS)[0].motion, some[0].label, "P")
    found = collect(some, options(groups="site"))
    assert len(np.unique(found.groups)) == len(SITES) + 1


def test_a_subject_at_two_sites_joins_them() -> None:
    some = cases()
    for k in (0, 2):
        motion, label, stated = some[k].motion, some[k].label, some[k].covariates
        some[k] = TrainingCase(motion, label, "the same", covariates=stated)
    assert len(np.unique(collect(some, options(groups="site")).groups)) == len(SITES) - 1


def at_sites(sites: str) -> list[TrainingCase]:
    """Cases of which the first half are of one class, at sites letter by letter."""
    ordered = sorted(cases(), key=lambda case: case.label)
    return [
        TrainingCase(case.motion, case.label, case.subject, covariates={"site": site})
        for case, site in zip(ordered, sites, strict=True)
    ]


def test_sites_that_go_with_the_classes_are_held_out_one_by_one() -> None:
    chosen = options(groups="site")
    # Where C and one of the others are held out together, one class is left.
    some = at_sites("AAAAAC" + "CBBBBB")
    folds = split_cases(collect(some, chosen), chosen).folds
    assert sorted(len(outer) for _, outer in folds) == [2, 5, 5]
    assert train(some, "by site", chosen).card.accuracy is not None


def test_folds_of_many_groups_that_leave_one_class_are_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(splits, "_MOST_GROUPS", 2)
    chosen = options(groups="site")
    found = collect(at_sites("AAAAAC" + "CBBBBB"), chosen)
    with pytest.raises(ParameterError, match="classes go with the values of 'site'") as caught:
        split_cases(found, chosen)
    assert "fold, cv" in caught.value.remedy


def test_a_class_of_one_site_is_said_to_be_of_one_site() -> None:
    chosen = options(groups="site")
    (note,) = split_cases(collect(at_sites("AAAAAA" + "BBBBBB"), chosen), chosen).notes
    assert "has one value of site only" in note
    assert "subject" not in note


def test_what_splits_the_cases_is_no_feature() -> None:
    assert [dict(one) for one in table().covariates] == [
        {"age": 50 + k} for k in range(2 * N_PER_CLASS)
    ]
    assert all(not one for one in table(groups="age").covariates)


def test_folds_that_tear_subjects_say_so() -> None:
    model = train(cases(subject="one"), "torn", options(fold="fold"))
    assert not model.card.is_grouped
    assert any("both sides of a split" in note for note in model.card.notes)


def test_a_case_that_came_twice_is_in_the_folds_once() -> None:
    some = [*cases(), cases()[3]]
    halves = (np.arange(0, 12, 2), np.arange(1, 13, 2))
    first = (np.append(halves[0], 12), halves[1])
    found = collect(some, options())
    assert found.numbers.tolist() == list(range(12))
    folds = folds_of([first, first[::-1]], found.numbers, 13, ["a"] * 12, found.groups)
    assert [len(inner) + len(outer) for inner, outer in folds] == [12, 12]


@pytest.mark.parametrize(
    ("cv", "said"),
    [
        (5, "'cv' of train"),
        ([1, 2], "'cv' of train"),
        ([([0.5], [1])], "not indices of cases"),
        ([([0], [12])], "names the case 12, but cases are numbered 0 to 11"),
        ([([0, 1], [1])], "fits to and predicts the case 1"),
        ([([0], range(1, 12))], "predict the case 0 0 times"),
        (ShuffleSplit(3, random_state=1), "times"),
        (PredefinedSplit([-1, *[0] * 11]), "predict the case 0 0 times"),
        ([(range(6), range(6, 12)), (range(6, 12), range(6)), ([0], [7])], "the case 7 2 times"),
        ([([0, 2], [*range(3, 12), 1]), (range(3, 12), [0, 2])], r"leaves 1 class\(es\) to fit to"),
    ],
)
def test_folds_that_cannot_be_used_are_refused(cv: Any, said: str) -> None:
    with pytest.raises(ParameterError, match=said) as caught:
        train(cases(), "bad", options(), cv=cv)
    assert caught.value.remedy


def test_a_fold_that_has_not_seen_a_class_is_named() -> None:
    three = cohort(2, classes=("normal", "global hypokinesia", "dyssynchrony"))
    labels = np.array([case.label for case in three])
    odd = np.flatnonzero(labels == "dyssynchrony")
    rest = np.setdiff1d(np.arange(len(three)), odd)
    pairs = [(rest, odd), *(StratifiedKFold(2).split(rest, labels[rest]))]
    pairs[1:] = [(np.append(rest[inner], odd), rest[outer]) for inner, outer in pairs[1:]]
    card = train(three, "unseen", options(), cv=pairs).card
    assert "Fold 1 had no case of dyssynchrony to fit to." in card.notes


@pytest.mark.parametrize("option", ["fold", "groups"])
def test_a_column_that_no_case_has_is_refused_with_those_that_there_are(option: str) -> None:
    with pytest.raises(ParameterError, match="'scanner', which no case has") as caught:
        train(cases(), "bad", options(**{option: "scanner"}))
    assert caught.value.remedy.endswith("age, fold, site.")


@pytest.mark.parametrize(
    ("covariates", "said"),
    [([{"f": 1}, {}], "unknown of the case 8"), ([{"f": 1}, {"f": 1}], "is 1 in every case")],
)
def test_a_column_that_makes_no_folds_is_refused(covariates: Any, said: str) -> None:
    with pytest.raises(ParameterError, match=said):
        folds_by("f", covariates, [7, 8])


@pytest.mark.parametrize("value", ["", " ", 3])
def test_a_column_without_a_name_is_refused(value: Any) -> None:
    with pytest.raises(ParameterError, match="'groups'"):
        TrainingOptions(groups=value)
