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
from modalmotion.classification.answer.hands import read_hands
from modalmotion.classification.model.conformal import Calibration
from modalmotion.classification.model.domain import OF_CLASS

# Of a case that is as its class is.
NEAR = np.ones(2)


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
        calibrated_model, np.array([1.0 - top, top]), calibrated_model.classes[1], coverage, NEAR
    )
    assert bool(held.classes) != bool(held.words)
    assert not held.classes or calibrated_model.classes[1] in held.classes


def test_an_empty_set_keeps_the_label_at_a_level_that_has_one_and_takes_it_otherwise() -> None:
    model = calibrated()
    rare = class_set(model, np.array([0.193, 0.807]), "normal", 0.9, NEAR)
    assert rare.classes == ()
    assert not rare.is_strange
    assert "At 98 % the set is not empty" in rare.words
    strange = class_set(model, np.array([0.4, 0.6]), "normal", 0.9, NEAR)
    assert strange.classes == ()
    assert strange.is_strange
    # Of few cases nobody can say so.
    assert not class_set(calibrated(20), np.array([0.4, 0.6]), "normal", 0.9, NEAR).is_strange


def test_an_empty_set_names_the_most_probable_class_and_not_that_of_a_decision() -> None:
    model = calibrated()
    other, own = model.classes
    shares = np.array([0.193, 0.807])
    plain = class_set(model, shares, own, 0.9, NEAR).words
    assert (
        f"{own} is the most probable, but less so than in 90 % of the cases that are {own},"
        in plain
    )
    assert "decision" not in plain
    ruled = class_set(model, shares, other, 0.9, NEAR).words
    assert ruled == f"{plain} The answer is {other} by the decision of the model."


def test_an_empty_set_of_a_case_that_is_far_from_its_class_takes_the_label() -> None:
    model = calibrated()
    limits = model.domain.limits.copy()
    limits[OF_CLASS] = 2.0
    model = replace(model, domain=replace(model.domain, limits=limits))
    shares = np.array([0.193, 0.807])
    own, other = np.array([1.0, 2.01]), np.array([2.01, 1.99])
    far = class_set(model, shares, model.classes[1], 0.9, own)
    assert (far.classes, far.is_strange) == ((), True)
    assert "unlike every class at 90 %, and farther from normal" in far.words
    assert "distance 2.01 where theirs are 1 on average, limit 2.00" in far.words
    # Not of another class, nor where a class is in the set; nor does the label of a rule count.
    assert not class_set(model, shares, model.classes[1], 0.9, other).is_strange
    assert not class_set(model, np.array([0.0, 1.0]), model.classes[1], 0.9, own).is_strange
    assert class_set(model, shares, model.classes[0], 0.9, own).is_strange


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
    apart = read_hands(signature, model).better.judgement.of_classes[0].max()
    for limit, label in ((2.0 * apart, empty.label), (0.0, None)):
        limits = model.domain.limits.copy()
        limits[OF_CLASS] = limit
        domain = replace(model.domain, limits=limits)
        far = replace(model, calibration=Calibration((below, below)), domain=domain)
        answer = classify(signature, far)
        assert answer.label == label
        assert (answer.flags == ("out of domain",)) == (label is None)
    nothing = np.zeros(n) - 1.0
    strange = classify(signature, replace(model, calibration=Calibration((nothing, nothing))))
    assert strange.label is None
    assert strange.flags == ("out of domain",)
    assert "unlike every class" in strange.notes[0]


def test_classes_of_few_cases_are_named() -> None:
    assert "Too few cases to rule out" in few_cases(small_model(), 0.9)
    assert few_cases(calibrated(), 0.9) == ""
