"""Training: reproducible, honest about what it met, and refused where it makes no sense."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from classify_samples import QUICK_CARD, cohort, curve, curves, curves_model, small_model

from modalmotion.classification import (
    TrainingCase,
    TrainingOptions,
    classify,
    evaluate,
    model_to_hdf5,
    train,
)
from modalmotion.errors import ParameterError
from modalmotion.progress import Progress
from modalmotion.signature.making import SignatureParameters, modal_signature


def test_training_again_gives_the_same_model_to_the_byte() -> None:
    assert model_to_hdf5(train(cohort(6), "small", QUICK_CARD)) == model_to_hdf5(small_model())
    assert train(cohort(6)[1:], "small", QUICK_CARD).id != small_model().id


def test_a_model_tells_new_curves_apart_whatever_their_pose() -> None:
    model = curves_model()
    assert model.readable.topology == "open curve"
    found = evaluate(model, curves(10, seed=4))
    assert found.accuracy >= 0.9
    assert model.card.accuracy is not None
    assert model.card.accuracy >= 0.9
    a, b = curve("tip", np.random.default_rng(1)), curve("tip", np.random.default_rng(1))
    turn = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    b = replace(b, vertices=b.vertices @ turn.T + [5.0, -8.0, 100.0])
    one, other = (classify(modal_signature(sequence), model) for sequence in (a, b))
    assert one.label == other.label == "tip"
    assert one.probabilities == pytest.approx(other.probabilities, abs=1e-6)


def test_a_model_no_better_than_chance_says_so_in_card_and_every_answer() -> None:
    rng = np.random.default_rng(3)
    cases = [replace(case, label=str(rng.integers(2)), subject=None) for case in curves(8)]
    model = train(cases, "mixed", QUICK_CARD)
    assert model.card.auc is not None
    assert model.card.auc < 0.7
    assert "no better than chance" in model.card.notes[-1]
    assert any("no better than chance" in n for n in classify(cases[0].motion, model).notes)
    assert not any("chance" in note for note in curves_model().card.notes)


def test_one_class_missing_labels_and_no_cases_are_refused() -> None:
    cases = cohort(6)
    with pytest.raises(ParameterError, match="1 class"):
        train([c for c in cases if c.label == "normal"], "one")
    with pytest.raises(ParameterError, match="0 class"):
        train([], "none")
    for label in ("", "  "):
        with pytest.raises(ParameterError, match="case 1 has no label"):
            train([cases[0], replace(cases[1], label=label), *cases[2:]], "unlabelled")
    with pytest.raises(ParameterError, match="two classes"):
        train([*cases, replace(cases[0], label="other")], "torn")


def test_a_recording_that_came_twice_counts_once() -> None:
    cases = cohort(6)
    model = train([*cases, cases[0], cases[3]], "small", QUICK_CARD)
    assert model.card.n_cases == dict.fromkeys(model.classes, 6)
    assert any("came twice" in note for note in model.card.notes)
    assert model.id == small_model().id


def test_the_card_says_what_was_trained_on_and_what_is_read() -> None:
    card = small_model().card
    assert card.n_subjects == dict.fromkeys(card.classes, 6)
    assert card.options["repetitions"] == 1
    assert "modes over a cycle" in card.reads
    assert 0.0 <= card.class_coverage["normal"] <= 1.0
    assert type(card).from_json(card.as_json()) == card


def test_sequences_of_which_nothing_is_stated_are_read_by_the_better_kind() -> None:
    rng = np.random.default_rng(2)

    def case(label: str, number: int) -> TrainingCase:
        one = curve(label, rng, 12)
        return TrainingCase(one, label, f"speaker {number}")

    model = train([case(label, k) for k in range(5) for label in ("tip", "back")], "x", QUICK_CARD)
    # A curve has no normals.
    assert model.signature_parameters.kind == "material"
    assert model.readable.n_modes <= 18


def test_a_stated_number_of_modes_is_that_of_the_signatures() -> None:
    options = TrainingOptions(modes=7, repetitions=1)
    sequences = [
        TrainingCase(curve(label, np.random.default_rng(k)), label)
        for k, label in enumerate(("tip", "back") * 5)
    ]
    assert train(sequences, "seven", options).readable.n_modes == 7


def test_progress_goes_from_nothing_to_all() -> None:
    seen: list[Progress] = []
    train(curves(5), "told", QUICK_CARD, progress=seen.append)
    shares = [progress.share for progress in seen]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_an_unknown_or_wrong_option_is_named() -> None:
    assert len(TrainingOptions().as_json()) == 9
    assert TrainingOptions.from_json(TrainingOptions().as_json()) == TrainingOptions()
    for wrong in ({"harmonics": 2}, {"timing": "course"}, {"modes": 0}, {"folds": 1}, {"seed": -1}):
        with pytest.raises(ParameterError, match=next(iter(wrong))):
            TrainingOptions.from_json(wrong)


def test_spring_modes_of_one_mesh_are_read_and_another_mesh_is_refused() -> None:
    from modalmotion.simulate import simulate_ventricle

    asked = SignatureParameters(modes=7, topology="mesh")

    def case(number: int, label: str, grid: tuple[int, int] = (6, 12)) -> TrainingCase:
        rng = np.random.default_rng(number)
        beat = simulate_ventricle(grid=grid)
        moved = beat.vertices + 0.1 * rng.standard_normal(beat.vertices.shape)
        if label == "late":
            moved[:, ::2, 2] += 3.0 * np.sin(np.linspace(0.0, 6.28, len(moved)))[:, None]
        return TrainingCase(modal_signature(replace(beat, vertices=moved), asked), label)

    cases = [case(n, label) for n in range(6) for label in ("plain", "late")]
    model = train(cases, "springs", QUICK_CARD)
    assert model.readable.topology == "mesh"
    assert evaluate(model, [case(50, "plain"), case(51, "late")]).accuracy == 1.0
    other = case(1, "plain", (6, 14))
    assert classify(other.signature, model).flags == ("out of domain",)
