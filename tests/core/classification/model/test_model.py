"""A model is its arrays: written, read back, checked, and never taken from a stranger's path."""

from __future__ import annotations

import base64
import json
import subprocess
import sys
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from classify_samples import cohort, small_model
from hypothesis import given
from hypothesis import strategies as st

from modalmotion.classification import (
    DEFAULT_MODEL,
    Model,
    TrainingOptions,
    available_models,
    classify,
    load_model,
    model_from_bytes,
    model_to_bytes,
    train,
)
from modalmotion.classification.estimators import estimator
from modalmotion.classification.estimators.machine import ALLOWED
from modalmotion.classification.model.conformal import Calibration
from modalmotion.errors import CorruptFileError, NotFoundError

SIGNED = ("radial", "turning", "axial")


@pytest.fixture(scope="module")
def small() -> Model:
    return small_model()


@pytest.fixture(scope="module")
def forest() -> Model:
    with pytest.MonkeyPatch.context() as small:
        small.setattr(estimator, "_N_TREES", 20)
        return train(cohort(6), "forest", TrainingOptions(estimator="forest", folds=2))


def test_probabilities_are_what_the_definition_says(small: Model) -> None:
    for row, shares in zip(
        small.golden_features, small.probabilities(small.golden_features), strict=True
    ):
        z = (row - small.blend.centre) / small.blend.scale
        parts = []
        for scorer in small.blend.scorers:
            k = z
            if len(scorer.anchors):
                apart = ((z - scorer.anchors) ** 2).sum(axis=1)
                k = np.exp(-scorer.gamma * apart)
            scores = (k @ scorer.weights + scorer.intercepts) / scorer.temperature
            weights = np.exp(scores - scores.max())
            parts.append(weights / weights.sum())
        mixed = np.mean(parts, axis=0) ** (1.0 / small.blend.temperature)
        assert shares == pytest.approx(mixed / mixed.sum(), abs=1e-9)


def test_the_distance_is_that_of_the_kind_of_motion_from_the_nearest_class(small: Model) -> None:
    found = small.reader.read(cohort(6)[0].signature)
    for values, kind, distance in zip(
        found.values, found.kinds, small.distance(found.kinds), strict=True
    ):
        # Roots of lengths grow with the root of the motion.
        sizes = [
            (100.0 * found.motion) ** (1.0 if name.split()[0] in SIGNED else 0.5)
            for name in found.names
        ]
        assert kind == pytest.approx([*(values / sizes), np.log(found.motion)])
        apart = [np.linalg.norm((kind - m) @ small.domain.whitening) for m in small.domain.means]
        assert distance == pytest.approx(min(apart))


@given(st.lists(st.floats(-1e6, 1e6), min_size=35, max_size=35))
def test_probabilities_add_up_to_one_however_far_the_features_lie(values: list[float]) -> None:
    shares = load_model().probabilities(np.array([values]))
    assert shares.sum() == pytest.approx(1.0)
    assert (shares >= 0).all()


def test_a_model_read_back_is_the_same(small: Model, tmp_path: Path) -> None:
    text = model_to_bytes(small)
    again = model_from_bytes(text)
    assert again.id == small.id
    assert model_to_bytes(again) == text
    assert again.card == small.card
    path = tmp_path / "small.json"
    path.write_bytes(text)
    assert load_model(path).id == small.id
    signature = cohort(6)[0].signature
    one, other = classify(signature, small), classify(signature, again)
    assert (one.label, one.class_set, one.notes) == (other.label, other.class_set, other.notes)
    assert np.array_equal(one.probabilities, other.probabilities)


def test_the_card_is_json(small: Model) -> None:
    card = json.loads(json.dumps(small.card.as_json(), allow_nan=False))
    assert card["classes"] == list(small.classes)
    assert card["n_cases"] == dict.fromkeys(small.classes, 6)
    assert np.sum(card["confusion"]) == 12
    assert card["accuracy_interval"][0] <= card["accuracy"] <= card["accuracy_interval"][1]


def test_the_id_is_of_what_an_answer_depends_on(small: Model) -> None:
    assert replace(small, card=replace(small.card, has_seen="more")).id == small.id
    assert replace(small, domain=replace(small.domain, limit=5.0)).id != small.id
    assert replace(small, notes={"": ("other",)}).id != small.id
    assert replace(small, calibration=Calibration((np.zeros(1), np.zeros(1)))).id != small.id


def altered(text: bytes, **changes: object) -> bytes:
    return json.dumps({**json.loads(text), **changes}).encode()


def test_an_altered_model_is_refused(small: Model) -> None:
    text = model_to_bytes(small)
    with pytest.raises(CorruptFileError, match="sha256"):
        model_from_bytes(altered(text, temperature=1e-3))
    wrong = replace(small, golden_probabilities=small.golden_probabilities + 1e-6)
    with pytest.raises(CorruptFileError, match="golden"):
        model_from_bytes(model_to_bytes(wrong))
    with pytest.raises(CorruptFileError, match="schema"):
        model_from_bytes(altered(text, schema=99))


@pytest.mark.parametrize("text", [b"", b"[]", b"not json", b'{"schema": 2}', b"\xff\xfe"])
def test_what_is_no_model_is_refused(text: bytes) -> None:
    with pytest.raises(CorruptFileError):
        model_from_bytes(text)


def test_half_a_model_is_refused(small: Model) -> None:
    text = model_to_bytes(small)
    with pytest.raises(CorruptFileError):
        model_from_bytes(text[: len(text) // 2])
    short = {"shape": [2], "float64": base64.b64encode(np.ones(2).tobytes()).decode()}
    with pytest.raises(CorruptFileError):
        model_from_bytes(altered(text, centre=short))
    with pytest.raises(CorruptFileError):
        model_from_bytes(altered(text, scorers="many"))


def test_an_estimator_that_is_no_arrays_is_kept_without_pickle(forest: Model) -> None:
    assert forest.machine
    again = model_from_bytes(model_to_bytes(forest))
    assert again.id == forest.id
    signature = cohort(6)[1].signature
    assert classify(signature, again).label == classify(signature, forest).label


def test_a_type_that_is_not_allowed_is_refused(forest: Model) -> None:
    from skops.io import dumps, get_untrusted_types

    assert set(get_untrusted_types(data=forest.machine)) <= set(ALLOWED)
    # A foreign archive with a right hash: only the allow-list stands in its way.
    foreign = replace(forest, machine=dumps(Fraction(1, 2)))
    with pytest.raises(CorruptFileError, match="Fraction"):
        foreign.probabilities(forest.golden_features)
    plain = replace(forest, machine=dumps([1, 2, 3]))
    with pytest.raises(CorruptFileError, match="no motion classifier"):
        plain.probabilities(forest.golden_features)


@pytest.mark.parametrize("name", ["none", "../data/ventricle-simulated", "/model.json", ""])
def test_a_name_is_never_a_path(name: str) -> None:
    with pytest.raises(NotFoundError) as caught:
        load_model(name)
    assert DEFAULT_MODEL in caught.value.remedy


def test_a_missing_file_is_not_found(tmp_path: Path) -> None:
    with pytest.raises(NotFoundError):
        load_model(tmp_path / "none.json")


def test_the_shipped_model_is_small_whole_and_honest() -> None:
    assert available_models() == (DEFAULT_MODEL,)
    model = load_model()
    assert len(model_to_bytes(model)) < 500_000
    assert model.card.extra["has_seen_patients"] is False
    assert any("no patient" in note for note in model.notes[""])
    assert model.card.accuracy is not None
    assert model.card.accuracy > 0.9
    assert not model.machine


def test_predicting_needs_no_scikit_learn() -> None:
    code = (
        "import sys; from modalmotion.classification import load_model;"
        "m = load_model(); m.probabilities(m.golden_features); print('sklearn' in sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "False"
