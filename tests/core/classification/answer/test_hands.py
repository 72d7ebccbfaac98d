"""Handedness: stated, it is heeded; not stated, an answer is no surer than both readings allow."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from altered_beats import mirror_image
from classify_samples import QUICK_CARD, cohort, small_model

from modalmotion.classification import TrainingCase, classify, load_model, train
from modalmotion.classification.answer.hands import read_hands
from modalmotion.classification.training.train_shipped import MATERIAL, held_out_cases
from modalmotion.facts import Facts
from modalmotion.facts.facts import Handedness
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.signature.making import modal_signature
from modalmotion.simulate import MotionClass, simulate_cohort


def beats(n_per_class: int, seed: int) -> Iterator[MeshSequence]:
    rng = np.random.default_rng(seed)
    for case in simulate_cohort(n_per_class, rng=rng, any_start=True):
        yield case.sequence


def handed(beat: MeshSequence, hand: Handedness) -> MeshSequence:
    return replace(beat, facts=Facts(tracking="material", handedness=hand))


def test_a_left_handed_recording_gets_the_answer_of_its_mirror_image() -> None:
    for beat in beats(1, 4):
        image = mirror_image(beat, np.random.default_rng(0))
        one, other = classify(handed(beat, "right")), classify(handed(image, "left"))
        assert (one.label, one.flags, one.class_set) == (other.label, other.flags, other.class_set)
        assert one.probabilities == pytest.approx(other.probabilities, abs=1e-9)


def test_of_unknown_handedness_a_recording_and_its_mirror_image_get_one_answer() -> None:
    for beat in beats(1, 5):
        image = mirror_image(beat, np.random.default_rng(1))
        one, other = classify(handed(beat, "unknown")), classify(handed(image, "unknown"))
        assert one.probabilities == pytest.approx(other.probabilities, abs=1e-9)
        assert (one.label, one.flags) == (other.label, other.flags)
        assert any("handedness is not stated" in note for note in one.notes)


def test_an_answer_is_no_surer_than_both_readings() -> None:
    model = load_model()
    for beat in beats(1, 6):
        signature = modal_signature(handed(beat, "unknown"), model.signature_parameters)
        read = read_hands(signature, model)
        assert read.other is not None
        assert read.weights.sum() == pytest.approx(1.0)
        low, high = read.shares.min(axis=0), read.shares.max(axis=0)
        assert (read.probabilities >= low - 1e-12).all()
        assert (read.probabilities <= high + 1e-12).all()


def test_mirrored_normals_are_not_called_reduced_torsion() -> None:
    rng = np.random.default_rng(7)
    for case in simulate_cohort(6, rng=rng, classes=(MotionClass.NORMAL,)):
        image = mirror_image(case.sequence, rng)
        assert classify(handed(image, "right")).flags == ("mirrored",)
        assert classify(handed(image, "unknown")).label != "reduced torsion"


@pytest.mark.thorough
def test_nearly_all_recordings_lose_nothing_by_an_unknown_handedness() -> None:
    kept = []
    for case in held_out_cases(MATERIAL, 2, seed=41):
        known = classify(case.motion)
        motion = replace(case.signature, facts=Facts(tracking="material"))
        kept.append(classify(motion).label == known.label)
    assert np.mean(kept) >= 0.95


@pytest.mark.thorough
def test_a_model_of_recordings_that_state_none_takes_others_as_it_took_them() -> None:
    cases = [
        TrainingCase(replace(case.signature, facts=Facts()), case.label, case.subject)
        for case in cohort(4, seed=42)
    ]
    model = train(cases, "unknown", QUICK_CARD)
    assert not model.domain.hand_is_stated
    assert read_hands(cases[0].signature, model).other is None
    assert small_model().domain.hand_is_stated
