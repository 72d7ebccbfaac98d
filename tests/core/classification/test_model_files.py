"""Models as files: the same answers again, and damage refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from classify_samples import curves, curves_model, small_model

from modalmotion.classification import (
    available_models,
    classify,
    load_model,
    model_from_hdf5,
    model_to_hdf5,
    shipped_for,
)
from modalmotion.classification.model_files import kept_model, numbered
from modalmotion.errors import CorruptFileError, NotFoundError, StoreError
from modalmotion.mesh import Facts
from modalmotion.notes import Note


def test_a_model_comes_back_with_the_same_answers(tmp_path: Path) -> None:
    for model in (small_model(), curves_model()):
        data = model_to_hdf5(model)
        again = model_from_hdf5(data)
        assert again.id == model.id
        assert model_to_hdf5(again)[:4] == data[:4]
        assert again.card == model.card
        assert again.columns == model.columns
    signature = curves(12)[3].signature
    path = tmp_path / "mine.h5"
    path.write_bytes(model_to_hdf5(curves_model()))
    one, other = classify(signature, curves_model()), classify(signature, load_model(path))
    assert one.probabilities.tolist() == other.probabilities.tolist()
    assert load_model(str(path)).id == load_model(path).id
    with pytest.raises(NotFoundError, match=r"no file .*none\.h5"):
        load_model("none.h5")


def test_a_file_holds_no_names_of_files_or_subjects() -> None:
    data = model_to_hdf5(curves_model())
    assert b"speaker 3" not in data
    held = model_from_hdf5(data).cross_validation
    assert held is not None
    assert set(held.names) == {""}
    assert held.subjects[0] == "subject 1"


def test_all_that_an_answer_depends_on_is_part_of_the_id() -> None:
    model = curves_model()
    weights = model.weights.copy()
    weights[0, 0] += 1e-6
    limits = model.outliers.limits + 1.0
    for other in (
        replace(model, weights=weights),
        replace(model, name="other"),
        replace(model, notes={"": (Note("more", "more"),)}),
        replace(model, outliers=replace(model.outliers, limits=limits)),
        replace(model, shares=model.shares + 1e-9),
    ):
        assert other.id != model.id or np.isinf(model.shares).all()
    assert replace(model, cross_validation=None).id == model.id


def test_damage_and_another_model_under_its_id_are_refused() -> None:
    kept = kept_model(curves_model())
    data = bytearray(model_to_hdf5(kept))
    data[len(data) // 2] ^= 1
    with pytest.raises(CorruptFileError):
        model_from_hdf5(bytes(data))
    arrays = {**kept.arrays, "intercepts": kept.arrays["intercepts"] + 1.0}
    with pytest.raises(CorruptFileError, match="does not contain the model"):
        model_from_hdf5(model_to_hdf5(replace(kept, arrays=arrays)))
    for name in ("weights", "means", "strangeness"):
        broken = {**kept.arrays, name: kept.arrays[name][:-1]}
        with pytest.raises(StoreError):
            model_from_hdf5(model_to_hdf5(replace(kept, arrays=broken)))


def test_a_number_and_a_time_are_no_part_of_the_model() -> None:
    kept = numbered(kept_model(curves_model()), 3, "2026-01-01T00:00:00Z")
    assert kept.record.version == 3
    assert model_from_hdf5(model_to_hdf5(kept)).id == curves_model().id


def test_shipped_models_are_chosen_by_what_the_points_follow() -> None:
    assert available_models() == ("ventricle-simulated", "ventricle-simulated-normal-displacement")
    material, other = Facts(tracking="material"), Facts()
    assert shipped_for("ventricle-simulated", material) == "ventricle-simulated"
    assert (
        shipped_for("ventricle-simulated@2", other) == "ventricle-simulated-normal-displacement@2"
    )
    assert shipped_for("mine", other) == "mine"
    with pytest.raises(NotFoundError):
        load_model("../secret")
