"""Decisions: costs and sensitivities, kept with the model, said in answer and card."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from classify_samples import curves, curves_model

from modalmotion.classification import (
    Model,
    classify,
    decided,
    model_from_hdf5,
    model_to_hdf5,
)
from modalmotion.classification.model.cross_validation import CrossValidation
from modalmotion.classification.model.decision import Decision
from modalmotion.errors import ParameterError


def unsure() -> Model:
    """A model of two classes whose held-out answers overlap."""
    rng = np.random.default_rng(1)
    y = np.arange(200) % 2
    # Of normal scores one unit and a half from 0 on either side, calibrated.
    share = 1 / (1 + np.exp(-3.0 * (rng.normal(size=(2, 200)) + 1.5 * (2 * y - 1))))
    known = CrossValidation(
        classes=("back", "tip"),
        sequence_ids=tuple(f"{n:064x}" for n in range(200)),
        names=("",) * 200,
        subjects=tuple(f"s{n}" for n in range(200)),
        y=y,
        probabilities=np.stack([1 - share, share], axis=2),
        folds=np.tile(np.arange(200) % 5, (2, 1)),
    )
    return replace(curves_model(), cross_validation=known)


def test_thresholds_reach_the_sensitivity_and_no_higher_ones_do() -> None:
    model = unsure()
    result = decided(model, sensitivity={"tip": 0.97})
    assert result.decision is not None
    ((label, threshold),) = result.decision.thresholds
    assert label == "tip"
    assert model.cross_validation is not None
    mine = model.cross_validation.probabilities[..., 1][:, model.cross_validation.y == 1]
    assert (mine >= threshold).mean() >= 0.97
    assert (mine >= threshold + 0.08).mean() < 0.97
    others = model.cross_validation.probabilities[..., 1][:, model.cross_validation.y == 0]
    negatives = float((others < threshold).mean())
    stated = result.card.decision
    assert stated is not None
    assert stated["sensitivity_reached"]["tip"][0] == pytest.approx(0.97, abs=0.03)
    assert stated["specificity_reached"]["tip"][0] == pytest.approx(negatives, abs=0.05)
    assert "tip from" in stated["text"]


def test_costs_choose_the_answer_with_the_least_expected_cost() -> None:
    result = decided(unsure(), costs={"tip": {"back": 9.0}})
    assert result.decision is not None
    # Of two classes a threshold at 1 / (1 + 9).
    shares = np.array([[0.89, 0.11], [0.91, 0.09]])
    assert result.decision.labels(shares).tolist() == [1, 0]
    stated = result.card.decision
    assert stated is not None
    assert stated["mean_cost"] < stated["mean_cost_of_most_probable"]


def test_the_first_class_that_reaches_its_threshold_is_the_label() -> None:
    decision = Decision(("a", "b", "c"), thresholds=(("c", 0.2), ("a", 0.3)))
    shares = np.array([[0.5, 0.25, 0.25], [0.5, 0.4, 0.1], [0.25, 0.65, 0.1], [0.1, 0.8, 0.1]])
    assert decision.labels(shares).tolist() == [2, 0, 1, 1]


def test_a_rule_makes_another_model_that_says_so_and_none_leaves_the_id() -> None:
    model = curves_model()
    result = decided(model, costs={"tip": {"back": 1e6}})
    assert result.id != model.id
    assert replace(result, decision=None).id == model.id
    again = model_from_hdf5(model_to_hdf5(result))
    assert again.id == result.id
    assert again.decision == result.decision
    assert again.card.decision == result.card.decision
    for case in curves(2, seed=8):
        before, after = (classify(case.motion, each) for each in (model, again))
        np.testing.assert_array_equal(before.probabilities, after.probabilities)
        # The costs make "tip" the label of every case, and a set holds its label.
        assert set(after.class_set) == {*before.class_set, "tip"}
        assert after.label == "tip"
        assert after.probability == after.probabilities[after.classes.index("tip")]
        assert any("expected cost" in note for note in after.notes)


@pytest.mark.parametrize(
    ("stated", "words"),
    [
        ({}, "costs or sensitivities"),
        ({"costs": {}, "sensitivity": {}}, "not both"),
        ({"sensitivity": {}}, "No sensitivity"),
        ({"sensitivity": {"dance": 0.9}}, "does not know"),
        ({"sensitivity": {"tip": 1.5}}, "sensitivity for 'tip'"),
        ({"sensitivity": {"tip": 1.0, "back": 1.0}}, "cannot be reached"),
        ({"costs": {"tip": {"tip": 1.0}}}, "cost of answering"),
        ({"costs": {"tip": {"back": 0}, "back": {"tip": 0}}}, "No error costs"),
    ],
)
def test_what_is_not_a_decision_is_refused(stated: dict[str, object], words: str) -> None:
    with pytest.raises(ParameterError, match=words):
        decided(unsure(), **stated)  # type: ignore[arg-type]
    with pytest.raises(ParameterError, match="held-out"):
        decided(replace(unsure(), cross_validation=None), sensitivity={"tip": 0.9})
