"""Training: reproducible, balanced in what it claims, and refused where it makes no sense."""

from __future__ import annotations

import numpy as np
import pytest

from modalmotion.classify import classify, model_to_bytes
from modalmotion.classify.train_shipped import NOTES, held_out, training_signatures
from modalmotion.classify.training import LinearOptions, train_model
from modalmotion.errors import ParameterError
from modalmotion.features import motion_features
from modalmotion.signature import ModalSignature, SignatureParameters, modal_signature
from modalmotion.simulate import MotionClass, simulate_ventricle

Labelled = list[tuple[ModalSignature, str]]


@pytest.fixture(scope="module")
def cases() -> Labelled:
    return list(training_signatures(4, seed=11))


def test_training_again_gives_the_same_model_to_the_byte(cases: Labelled) -> None:
    first, second = (train_model("small", cases, notes=NOTES) for _ in range(2))
    assert model_to_bytes(first) == model_to_bytes(second)
    assert first.id != train_model("small", cases[1:], notes=NOTES).id


def test_a_model_knows_what_it_was_trained_on(cases: Labelled) -> None:
    model = train_model("small", cases)
    assert model.classes == tuple(sorted(MotionClass))
    assert model.feature_names == motion_features(cases[0][0]).names
    assert set(model.topologies) == {"cup", "cylinder"}
    assert model.modes == 7
    result = held_out(model, cases)
    assert result.confusion.sum() == len(cases)
    assert result.accuracy > 0.9
    assert result.accuracy == np.trace(result.confusion) / len(cases)


def test_two_classes_are_enough_and_one_is_not(cases: Labelled) -> None:
    names = {str(MotionClass.NORMAL), str(MotionClass.HYPOKINESIA)}
    two = [(signature, label) for signature, label in cases if label in names]
    model = train_model("two", two)
    right = [classify(signature, model).label in (label, None) for signature, label in two]
    assert np.mean(right) > 0.9
    with pytest.raises(ParameterError, match="1 class"):
        train_model("one", [(s, label) for s, label in two if label == "normal"])
    with pytest.raises(ParameterError, match="0 class"):
        train_model("none", [])


def test_cases_of_different_modes_are_refused(cases: Labelled) -> None:
    other = modal_signature(simulate_ventricle(grid=(12, 24)), SignatureParameters(modes=18))
    with pytest.raises(ParameterError, match="differ in their modes"):
        train_model("mixed", [*cases, (other, "normal")])


def test_the_limit_leaves_out_the_share_it_is_asked_to(cases: Labelled) -> None:
    known = train_model("half", cases, options=LinearOptions(known_share=0.5))
    answers = [classify(signature, known) for signature, _ in cases]
    assert np.mean([answer.label is None for answer in answers]) == pytest.approx(0.5, abs=0.1)


def test_the_chosen_reading_is_the_true_one(cases: Labelled) -> None:
    # Every training case is right-handed, so none should be read as mirrored.
    model = train_model("small", cases)
    notes = [note for signature, _ in cases for note in classify(signature, model).notes]
    assert not [note for note in notes if "left-handed" in note]
