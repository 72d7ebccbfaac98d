"""Answers: sets, what read-outs rule out, what cannot be read, and the modes that moved them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from classify_samples import cohort, curves, curves_model, small_model

import modalmotion as mm
from modalmotion.classification import DEFAULT_MODEL, classify, load_model
from modalmotion.classification.answer import (
    classification_from_hdf5,
    classification_key,
    classification_to_hdf5,
)
from modalmotion.classification.model import holds, share_ranges, strangeness_of
from modalmotion.classification.motion import Motion
from modalmotion.errors import CorruptFileError, ParameterError


def test_sets_hold_the_true_class_as_often_as_stated_class_by_class() -> None:
    rng = np.random.default_rng(1)

    def drawn(n: int) -> tuple[np.ndarray, np.ndarray]:
        y = np.arange(n) % 3
        scores = rng.normal(size=(n, 3)) + np.array([2.0, 1.0, 0.3])[y, None] * np.eye(3)[y]
        shares = np.exp(scores)
        return shares / shares.sum(axis=1, keepdims=True), y

    for coverage in (0.8, 0.9):
        held = []
        for _ in range(60):
            known, y = drawn(150)
            new, truth = drawn(300)
            in_set = holds(strangeness_of(known, y), new, coverage)
            held.append([in_set[truth == k, k].mean() for k in range(3)])
        assert np.mean(held, axis=0) == pytest.approx([coverage] * 3, abs=0.02)


def test_a_class_of_few_cases_is_in_every_set() -> None:
    strangeness = (np.zeros(0), np.full(8, 0.1), np.full(99, 0.1))
    shares = np.array([[0.01, 0.01, 0.98]])
    assert holds(strangeness, shares, 0.9).tolist() == [[True, True, True]]
    assert holds(strangeness, shares, 0.8).tolist() == [[True, False, True]]


def test_a_class_never_contradicts_the_share_of_the_volume() -> None:
    model, signature = small_model(), cohort(6)[0].signature
    asked = replace(model.signature_parameters, volumes=True)
    beat = mm.simulate_ventricle(grid=(12, 24))
    signature = mm.modal_signature(beat, asked)
    free = classify(signature, replace(model, shares=np.tile([-np.inf, np.inf], (2, 1))))
    assert free.label is not None
    k = model.classes.index(free.label)
    shares = np.tile([-np.inf, np.inf], (2, 1))
    shares[k] = 0.1, 0.3
    ruled = classify(signature, replace(model, shares=shares))
    assert ruled.label != free.label
    assert ruled.probabilities[k] == 0.0
    assert free.label not in ruled.class_set
    assert ruled.label is None or any("is ruled out" in note for note in ruled.notes)
    none = classify(signature, replace(model, shares=np.tile([0.0, 0.1], (2, 1))))
    assert none.flags == ("out of domain",)


def test_ranges_of_shares_are_wider_for_few_and_unknown_for_fewer() -> None:
    rng = np.random.default_rng(2)
    shares = rng.uniform(0.2, 0.5, 40)
    ranges = share_ranges(shares, np.repeat([0, 1], [30, 10]), 2)
    assert ranges[0, 0] < 0.2 < 0.5 < ranges[0, 1]
    assert np.isinf(ranges[1]).all()
    assert np.isinf(share_ranges(np.full(40, np.nan), np.zeros(40, dtype=int), 1)).all()


def test_what_cannot_be_read_is_refused_by_name() -> None:
    model, signature = small_model(), cohort(6)[0].signature
    curve_ = curves(1)[0].signature
    turned = replace(signature.parameters, remove_rotation=False)
    for other, words in (
        (curve_, "topology"),
        (replace(signature, amplitudes=signature.amplitudes[:1]), "one frame"),
        (replace(signature, parameters=turned), "rotation"),
    ):
        found = classify(other, model)
        assert found.label is None
        assert words in found.notes[0]
        assert found.class_set == model.classes
    for coverage in (0.0, 1.0, float("nan")):
        with pytest.raises(ParameterError, match="coverage"):
            classify(signature, model, coverage)


def test_a_surface_without_the_topology_of_the_model_gets_no_class_and_the_reason() -> None:
    model = small_model()
    stated = replace(model.readable.parameters, topology=model.readable.topology)
    model = replace(model, readable=replace(model.readable, parameters=stated))
    # Five tetrahedra.
    one = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]])
    faces = np.concatenate([one + 4 * k for k in range(5)])
    vertices = np.random.default_rng(5).normal(size=(4, 20, 3))
    found = classify(mm.mesh_sequence(vertices, faces), model)
    assert (found.label, found.flags) == (None, ("out of domain",))
    assert "topology" in found.notes[0]


def test_contributions_of_modes_add_up_to_those_of_their_features() -> None:
    model, signature = curves_model(), curves(12)[0].signature
    found = classify(signature, model)
    assert found.explanation
    scores = [abs(part.score) for part in found.explanation]
    assert scores == sorted(scores, reverse=True)
    strongest = found.explanation[0]
    place = [str(label) for label in signature.modes.labels].index(strongest.modes[0])
    moving = signature.amplitudes[:, place] - signature.amplitudes[:, place].mean(axis=0)
    assert strongest.amplitude == pytest.approx(np.sqrt((moving**2).sum() / len(moving)))


def test_rounding_of_a_mode_is_no_motion_of_it() -> None:
    model, signature = curves_model(), curves(12)[0].signature
    open_limits = replace(model.outliers, limits=np.full_like(model.outliers.limits, np.inf))
    amplitudes = signature.amplitudes.copy()
    amplitudes[:, 1], amplitudes[::2, 1] = 3.0, 3.0 + 1e-15
    still = replace(signature, amplitudes=amplitudes)
    found = classify(still, replace(model, outliers=open_limits))
    label = str(signature.modes.labels[1])
    assert [part.amplitude for part in found.explanation if part.modes == (label,)] == [0.0]


@pytest.mark.parametrize("reads", ["modes", "parts about the axis"])
def test_a_mode_states_what_a_unit_more_of_it_would_change(reads: str) -> None:
    model, signature = curves_model(), curves(12)[0].signature
    if reads != "modes":
        model = load_model(DEFAULT_MODEL)
        signature = mm.modal_signature(
            mm.simulate_ventricle(rng=np.random.default_rng(5)), model.signature_parameters
        )
    found = classify(signature, model)
    assert reads in model.tables[0].description
    assert any(part.per_unit for part in found.explanation)
    labels = [str(label) for label in signature.modes.labels]
    largest = max(part.amplitude for part in found.explanation)
    for part in found.explanation:
        if part.amplitude < 0.01 * largest:
            continue
        own, odds = [labels.index(name) for name in part.modes], []
        for more in (1e-4, -1e-4):
            a = signature.amplitudes.copy()
            a[:, own] += more * (a[:, own] - a[:, own].mean(axis=0))
            grown = model.features(Motion(replace(signature, amplitudes=a)))
            likeliest, next_to_it = sorted(model.probabilities(grown[None])[0])[:-3:-1]
            odds.append(np.log(likeliest / next_to_it))
        difference = (odds[0] - odds[1]) / (2e-4 * part.amplitude)
        most = abs(found.explanation[0].score)
        assert part.per_unit == pytest.approx(difference, rel=0.01, abs=1e-4 * most)


def test_an_answer_comes_back_from_a_file() -> None:
    found = classify(curves(12)[0].signature, curves_model())
    again = classification_from_hdf5(classification_to_hdf5(found))
    assert again.probabilities.tolist() == found.probabilities.tolist()
    assert (again.label, again.class_set, again.notes) == (
        found.label,
        found.class_set,
        found.notes,
    )
    assert again.explanation == found.explanation
    asked = curves_model().signature_parameters
    keys = {classification_key(asked, c, hand) for c in (0.9, 0.8) for hand in ("left", "unknown")}
    assert len(keys) == 4


@pytest.mark.parametrize("name", ["class_set", "flags", "coverage", "provenance"])
def test_a_file_with_a_value_of_another_kind_is_refused(name: str) -> None:
    nothing: dict[str, Any] = {name: None}
    found = replace(classify(curves(12)[0].signature, curves_model()), **nothing)
    with pytest.raises(CorruptFileError):
        classification_from_hdf5(classification_to_hdf5(found))
