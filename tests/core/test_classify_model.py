"""A model is its arrays: written, read back, checked, and never taken from a stranger's path."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from modalmotion.classify import (
    DEFAULT_MODEL,
    Model,
    available_models,
    load_model,
    model_from_bytes,
    model_to_bytes,
)
from modalmotion.errors import CorruptFileError, NotFoundError


@pytest.fixture
def small() -> Model:
    rng = np.random.default_rng(3)
    model = Model(
        name="small",
        classes=("a", "b", "c"),
        feature_names=("x", "y"),
        topologies=("cup",),
        modes=7,
        centre=rng.standard_normal(2),
        scale=np.array([2.0, 0.5]),
        coefficients=rng.standard_normal((3, 2)),
        intercepts=rng.standard_normal(3),
        class_means=rng.standard_normal((3, 2)),
        whitening=rng.standard_normal((2, 2)),
        farthest=4.0,
        least_motion=0.003,
        least_periodic_share=0.5,
        golden_features=rng.standard_normal((4, 2)),
        golden_probabilities=np.zeros((4, 3)),
        notes={"": ("always",), "a": ("sometimes",)},
        card={"has_seen_patients": False},
    )
    return replace(model, golden_probabilities=model.probabilities(model.golden_features))


def test_probabilities_and_distances_are_what_the_definition_says(small: Model) -> None:
    x = np.array([[0.3, -1.0], [40.0, 2.0], [-3.0, 0.1]])
    for row, shares, distance in zip(x, small.probabilities(x), small.distance(x), strict=True):
        z = (row - small.centre) / small.scale
        scores = small.coefficients @ z + small.intercepts
        weights = [np.exp(score) for score in scores]
        assert shares == pytest.approx(np.array(weights) / sum(weights))
        apart = [np.linalg.norm(small.whitening @ (z - mean)) for mean in small.class_means]
        assert distance == pytest.approx(min(apart))


@given(st.lists(st.floats(-1e6, 1e6), min_size=35, max_size=35))
def test_probabilities_add_up_to_one_however_far_the_features_lie(values: list[float]) -> None:
    shares = load_model().probabilities(np.array(values))
    assert shares.sum() == pytest.approx(1.0)
    assert (shares >= 0).all()


def test_a_model_read_back_is_the_same(small: Model, tmp_path: Path) -> None:
    text = model_to_bytes(small)
    again = model_from_bytes(text)
    assert again.id == small.id
    assert model_to_bytes(again) == text
    assert again.notes == small.notes
    path = tmp_path / "small.json"
    path.write_bytes(text)
    assert load_model(path).id == small.id


def test_the_id_is_of_what_an_answer_depends_on(small: Model) -> None:
    assert replace(small, card={"other": 1}).id == small.id
    assert replace(small, farthest=5.0).id != small.id
    assert replace(small, intercepts=small.intercepts + 1e-9).id != small.id


def altered(text: bytes, **changes: object) -> bytes:
    return json.dumps({**json.loads(text), **changes}).encode()


def test_an_altered_model_is_refused(small: Model) -> None:
    text = model_to_bytes(small)
    with pytest.raises(CorruptFileError, match="sha256"):
        model_from_bytes(altered(text, farthest=1e9))
    wrong = replace(small, golden_probabilities=small.golden_probabilities + 1e-6)
    with pytest.raises(CorruptFileError, match="golden"):
        model_from_bytes(model_to_bytes(wrong))
    with pytest.raises(CorruptFileError, match="schema"):
        model_from_bytes(altered(text, schema=99))


@pytest.mark.parametrize("text", [b"", b"[]", b"not json", b'{"schema": 1}', b"\xff\xfe"])
def test_what_is_no_model_is_refused(text: bytes) -> None:
    with pytest.raises(CorruptFileError):
        model_from_bytes(text)


def test_half_a_model_is_refused(small: Model) -> None:
    text = model_to_bytes(small)
    with pytest.raises(CorruptFileError):
        model_from_bytes(text[: len(text) // 2])
    with pytest.raises(CorruptFileError):
        model_from_bytes(altered(text, centre=[1.0, 2.0, 3.0]))
    with pytest.raises(CorruptFileError):
        model_from_bytes(altered(text, coefficients="many"))


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
    assert len(model_to_bytes(model)) < 200_000
    assert model.card["has_seen_patients"] is False
    assert any("no patient" in note for note in model.notes[""])
    assert model.card["held_out"]["all"]["accuracy"] > 0.9
    assert np.array_equal(
        model.probabilities(model.golden_features).argmax(axis=1),
        model.golden_probabilities.argmax(axis=1),
    )
    assert set(model.golden_probabilities.argmax(axis=1)) == set(range(len(model.classes)))


def test_predicting_needs_no_scikit_learn() -> None:
    code = (
        "import sys; from modalmotion.classify import load_model;"
        "m = load_model(); m.probabilities(m.golden_features); print('sklearn' in sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "False"
