"""Repeated folds and the learning curve: more on the card, the same model."""

from __future__ import annotations

import csv
import io
from dataclasses import replace

import numpy as np
import pytest
from classify_samples import curves

from modalmotion.classification import TrainingOptions, model_from_hdf5, model_to_hdf5, train
from modalmotion.classification.training.collection import collect
from modalmotion.classification.training.repetitions import plan_folds

FULL = TrainingOptions(estimator="linear", folds=3, repetitions=3)


@pytest.fixture(scope="module")
def model() -> object:
    cases = [replace(case, name=f"/secret/{n}.npz") for n, case in enumerate(curves(8))]
    return train(cases, "full", FULL)


@pytest.mark.thorough
def test_repetitions_and_curve_leave_the_model_as_it_is(model: object) -> None:
    quick = train(curves(8), "full", replace(FULL, repetitions=1, card="quick"))
    assert quick.id == model.id  # type: ignore[attr-defined]
    assert quick.card.learning_curve == ()
    assert len(quick.card.repetitions) == 1
    assert len(model.card.repetitions) == 3  # type: ignore[attr-defined]
    assert quick.card.repetitions[0] == model.card.repetitions[0]  # type: ignore[attr-defined]


def test_each_repetition_holds_out_every_case_once_in_folds_of_its_own() -> None:
    table = collect(curves(8), FULL)
    plan = plan_folds(table, FULL)
    assert plan.n_repetitions == 3
    held_out = []
    for r in range(3):
        outer = [fold.outer for fold in plan.folds if fold.repetition == r]
        assert sorted(np.concatenate(outer)) == list(range(len(table)))
        held_out.append({tuple(rows) for rows in outer})
    assert held_out[0] != held_out[1] != held_out[2] != held_out[0]
    for fold in plan.curve:
        assert fold.size is not None
        assert np.bincount(table.y[fold.inner]).max() == fold.size
        assert not set(table.groups[fold.inner]) & set(table.groups[fold.outer])
    few, more = ([f for f in plan.curve if f.size == size] for size in (4, 8))
    assert not more
    assert len(few) == 6


def test_the_curve_goes_from_few_cases_to_all_where_classes_differ_in_size() -> None:
    # 3 beside 15: fitted to 10 and 2, which is 6 in the mean, after a point of 8 at most.
    every = curves(15)
    rare = [case for case in every if case.label == every[0].label]
    cases = [case for case in every if case not in rare[3:]]
    points = train(cases, "uneven", replace(FULL, repetitions=1)).card.learning_curve
    assert [point["per_class"] for point in points] == [4, 8, 10]
    counts = [point["n_cases"] for point in points]
    assert counts == sorted(counts)


def test_the_card_states_what_was_measured_and_chosen(model: object) -> None:
    card, validation = model.card, model.cross_validation  # type: ignore[attr-defined]
    *fewer, whole = card.learning_curve
    assert [point["per_class"] for point in fewer] == [4]
    assert whole["accuracy"] == pytest.approx(card.accuracy)
    assert whole["auc"] == pytest.approx(card.auc)
    choices = [(each["repetition"], each["fold"]) for each in card.fold_choices]
    assert choices == [(r, f) for r in (1, 2, 3) for f in (1, 2, 3)]
    hits = validation.probabilities.argmax(axis=2) == validation.y
    assert card.accuracy == pytest.approx(hits.mean())
    assert sum(map(sum, card.confusion)) == 3 * 16


def test_the_table_of_cases_has_names_and_a_file_has_none(model: object) -> None:
    validation = model.cross_validation  # type: ignore[attr-defined]
    rows = list(csv.DictReader(io.StringIO(validation.as_csv())))
    assert len(rows) == 3 * 16
    assert {row["case"] for row in rows} == {f"/secret/{n}.npz" for n in range(16)}
    assert {row["subject"] for row in rows} == {f"speaker {n}" for n in range(8)}
    for row in rows[:5]:
        assert float(row["p tip"]) + float(row["p back"]) == pytest.approx(1.0, abs=1e-5)
    image = model_to_hdf5(model)  # type: ignore[arg-type]
    assert b"secret" not in image
    assert b"speaker" not in image
    again = model_from_hdf5(image)
    assert again.cross_validation is not None
    assert set(again.cross_validation.subjects) == {f"subject {n}" for n in range(1, 9)}
    np.testing.assert_array_equal(again.cross_validation.probabilities, validation.probabilities)
    np.testing.assert_array_equal(again.cross_validation.folds, validation.folds)
    assert again.cross_validation.sequence_ids == validation.sequence_ids
    assert again.card == model.card  # type: ignore[attr-defined]
    named = again.cross_validation.as_csv({validation.sequence_ids[0]: ("here", "me")})
    assert "\nhere," in named
