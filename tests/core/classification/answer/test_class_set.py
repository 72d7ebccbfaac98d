"""Class sets: the label is in one that holds anything, and an empty one says why."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from classify_samples import cohort, small_model
from hypothesis import given
from hypothesis import strategies as st

from modalmotion.classification import Model, classify
from modalmotion.classification.answer.class_set import class_set, few_cases
from modalmotion.classification.model.conformal import Calibration


def calibrated(n: int = 400) -> Model:
    """A model whose held-out cases of both classes had probabilities of 0.8 to 1."""
    scores = np.linspace(0.0, 0.2, n)
    return replace(small_model(), calibration=Calibration((scores, scores)))


@pytest.fixture(scope="module")
def calibrated_model() -> Model:
    return calibrated()


@given(st.floats(0.5, 1.0), st.floats(0.5, 0.99))
def test_a_set_holds_the_label_or_says_why_it_is_empty(
    calibrated_model: Model, top: float, coverage: float
) -> None:
    held = class_set(
        calibrated_model, np.array([1.0 - top, top]), calibrated_model.classes[1], coverage
    )
    assert bool(held.classes) != bool(held.words)
    assert not held.classes or calibrated_model.classes[1] in held.classes


def test_an_empty_set_keeps_the_label_at_a_level_that_has_one_and_takes_it_otherwise() -> None:
    model = calibrated()
    rare = class_set(model, np.array([0.193, 0.807]), "normal", 0.9)
    assert rare.classes == ()
    assert not rare.is_strange
    assert "At 98 % the set is not empty" in rare.words
    strange = class_set(model, np.array([0.4, 0.6]), "normal", 0.9)
    assert strange.classes == ()
    assert strange.is_strange
    # Of few cases nobody can say so.
    assert not class_set(calibrated(20), np.array([0.4, 0.6]), "normal", 0.9).is_strange


def test_an_answer_of_an_empty_set_says_so_and_a_strange_one_has_no_label() -> None:
    signature = cohort(6)[0].signature
    model = small_model()
    n = 400
    surest = float(classify(signature, model).probability)
    below = np.sort(np.r_[np.full(n - 8, 0.0), np.linspace(1.0 - surest, 1.0, 8)])
    empty = classify(signature, replace(model, calibration=Calibration((below, below))))
    assert empty.class_set == ()
    assert empty.label is not None
    assert empty.flags == ()
    assert any(note.startswith("Unlike every class at 90 %") for note in empty.notes)
    nothing = np.zeros(n) - 1.0
    strange = classify(signature, replace(model, calibration=Calibration((nothing, nothing))))
    assert strange.label is None
    assert strange.flags == ("out of domain",)
    assert "unlike every class" in strange.notes[0]


def test_classes_of_few_cases_are_named() -> None:
    assert "Too few cases to rule out" in few_cases(small_model(), 0.9)
    assert few_cases(calibrated(), 0.9) == ""
