"""A model is its arrays: written, read back, checked, and never taken from a stranger's path."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import h5py
import numpy as np
import pytest
from classify_samples import cohort, small_model
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from sealed_files import changed, put, sealed

from modalmotion.classification import (
    DEFAULT_MODEL,
    OFFSET_MODEL,
    Model,
    TrainingOptions,
    available_models,
    classify,
    load_model,
    model_from_hdf5,
    model_to_hdf5,
    train,
)
from modalmotion.classification.estimators import estimator
from modalmotion.classification.estimators.machine import ALLOWED
from modalmotion.classification.model.conformal import Calibration
from modalmotion.classification.model.member import Member
from modalmotion.errors import (
    CorruptFileError,
    ModelNotReproducedError,
    NotFoundError,
    OlderFileError,
)

SIGNED = ("radial", "turning", "axial")


@pytest.fixture(scope="module")
def small() -> Model:
    return small_model()


@pytest.fixture(scope="module")
def forest() -> Model:
    with pytest.MonkeyPatch.context() as small:
        small.setattr(estimator, "_N_TREES", 20)
        return train(
            cohort(6),
            "forest",
            TrainingOptions(estimator="forest", folds=2, repetitions=1, card="quick"),
        )


def _shares_of(member: Member, row: NDArray[np.float64]) -> NDArray[np.float64]:
    """Probabilities of one member, by the definition."""
    z = (row - member.blend.centre) / member.blend.scale
    parts = []
    for scorer in member.blend.scorers:
        k = z
        if len(scorer.anchors):
            k = np.exp(-scorer.gamma * ((z - scorer.anchors) ** 2).sum(axis=1))
        scores = (k @ scorer.weights + scorer.intercepts) / scorer.temperature
        weights = np.exp(scores - scores.max())
        parts.append(weights / weights.sum())
    mixed = np.mean(parts, axis=0) ** (1.0 / member.blend.temperature)
    return np.asarray(mixed / mixed.sum())


def test_probabilities_are_what_the_definition_says(small: Model) -> None:
    assert len(small.members) > 1
    assert sum(member.weight for member in small.members) == pytest.approx(1.0)
    for row, shares in zip(
        small.golden_features, small.probabilities(small.golden_features), strict=True
    ):
        first, product = 0, np.ones(len(small.classes))
        for member in small.members:
            d = len(member.columns)
            product *= _shares_of(member, row[first : first + d]) ** member.weight
            first += d
        assert first == len(row)
        pool = product ** (1.0 / small.temperature)
        assert shares == pytest.approx(pool / pool.sum(), abs=1e-9)


def test_the_distance_is_that_of_the_kind_of_motion_from_the_nearest_class(small: Model) -> None:
    found = small.domain.reader.read(cohort(6)[0].signature)
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


@given(arrays(np.float64, len(load_model().columns), elements=st.floats(-1e6, 1e6)))
def test_probabilities_add_up_to_one_however_far_the_features_lie(
    values: NDArray[np.float64],
) -> None:
    shares = load_model().probabilities(values[None])
    assert shares.sum() == pytest.approx(1.0)
    assert (shares >= 0).all()


def test_a_model_read_back_is_the_same(small: Model, tmp_path: Path) -> None:
    image = model_to_hdf5(small)
    again = model_from_hdf5(image)
    assert again.id == small.id
    assert model_to_hdf5(again) == image
    assert again.card == small.card
    path = tmp_path / "small.h5"
    path.write_bytes(image)
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
    assert (
        replace(small, domain=replace(small.domain, limits=small.domain.limits + 1.0)).id
        != small.id
    )
    assert replace(small, notes={"": ("other",)}).id != small.id
    assert replace(small, calibration=Calibration((np.zeros(1), np.zeros(1)))).id != small.id


def test_an_altered_model_is_refused(small: Model) -> None:
    image = model_to_hdf5(small)
    with pytest.raises(CorruptFileError, match="sha256"):
        model_from_hdf5(changed(image, put("temperature", 1e-3)))
    wrong = replace(small, golden_probabilities=small.golden_probabilities + 1e-6)
    with pytest.raises(ModelNotReproducedError, match="golden"):
        model_from_hdf5(model_to_hdf5(wrong))
    later = changed(image, lambda file: file.attrs.__setitem__("schema_version", 99))
    with pytest.raises(CorruptFileError, match="version 99"):
        model_from_hdf5(later)
    earlier = changed(image, lambda file: file.attrs.__setitem__("schema_version", 1))
    with pytest.raises(OlderFileError, match="version 1"):
        model_from_hdf5(earlier)


@pytest.mark.parametrize(
    "data", [b"", b"[]", b"not HDF5", sealed(b"\x89HDF\r\n\x1a\n" + b"x" * 99)]
)
def test_what_is_no_model_is_refused(data: bytes, tmp_path: Path) -> None:
    path = tmp_path / "mine.h5"
    path.write_bytes(data)
    with pytest.raises(CorruptFileError, match=r"mine\.h5"):
        load_model(path)


def test_half_a_model_is_refused(small: Model) -> None:
    image = model_to_hdf5(small)
    with pytest.raises(CorruptFileError):
        model_from_hdf5(image[: len(image) // 2])
    with pytest.raises(CorruptFileError):
        model_from_hdf5(sealed(image[: len(image) // 2]))


def text(value: object) -> np.bytes_:
    return np.bytes_(json.dumps(value))


HOSTILE: dict[str, tuple[str, object]] = {
    "an array that is too short": ("centre", np.ones(2)),
    "an array of another shape": ("means", np.ones(7)),
    "fewer than no anchors": ("n_anchors", np.array([-1, 7])),
    "more anchors than there are": ("n_anchors", np.array([10**15, 10**15])),
    "anchors whose number overflows": ("n_anchors", np.full(4, 2**62)),
    "scores of no class": ("n_scores", np.array([1])),
    "texts where numbers belong": ("limits", text([1, 2, 3])),
    "a list where a table belongs": ("readers", text([[], 1])),
    "text that is not JSON": ("columns", np.bytes_("{")),
    "JSON in itself": ("notes", np.bytes_("[" * 5000)),
    "an infinite number of modes": ("readable", np.bytes_('{"n_modes": Infinity}')),
    "columns of no modes": ("columns", text([["a", [999], 1.0]])),
    "parameters that are not known": ("parameters", text({"modes": 7, "unheard": 1})),
    "a card of something else": ("card", text({"of": "cards"})),
    "one class": ("classes", text(["a"])),
    "a machine beside scorers": ("machine", np.ones(9, dtype=np.uint8)),
}


@pytest.mark.parametrize("what", HOSTILE)
def test_a_hostile_model_with_a_right_seal_is_refused_by_name(
    what: str, small: Model, tmp_path: Path
) -> None:
    path = tmp_path / "foreign.h5"
    path.write_bytes(changed(model_to_hdf5(small), put(*HOSTILE[what])))
    with pytest.raises(CorruptFileError, match="foreign") as caught:
        load_model(path)
    assert caught.value.remedy


def reader_of(small: Model, **changes: object) -> Model:
    first, *others = small.members
    reader = replace(first.reader, **changes)  # type: ignore[arg-type]
    return replace(small, members=(replace(first, reader=reader), *others))


def test_a_model_that_would_read_without_end_is_refused(small: Model) -> None:
    with pytest.raises(CorruptFileError, match="harmonics"):
        model_from_hdf5(model_to_hdf5(reader_of(small, n_harmonics=10**9)))


def test_one_dataset_under_many_names_fills_no_memory(small: Model) -> None:
    def link(file: h5py.File) -> None:
        for number in range(1000):
            file[f"again_{number}"] = file["whitening"]

    with pytest.raises(CorruptFileError, match="on one another"):
        model_from_hdf5(changed(model_to_hdf5(small), link))


def test_a_link_out_of_the_file_is_not_followed(small: Model) -> None:
    for link in (h5py.ExternalLink("/etc/passwd", "/"), h5py.SoftLink("/means")):
        with pytest.raises(CorruptFileError, match="link"):
            model_from_hdf5(changed(model_to_hdf5(small), put("scale", link)))


def test_a_file_that_is_too_large_is_not_read(
    small: Model, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "large.h5"
    path.write_bytes(model_to_hdf5(small))
    monkeypatch.setattr("modalmotion.classification.model.hdf5._LARGEST", 1000)
    for source in (path, path.read_bytes()):
        with pytest.raises(CorruptFileError, match="at most 1000"):
            model_from_hdf5(source)


def test_what_is_not_a_number_does_not_reproduce(small: Model) -> None:
    with pytest.raises(ModelNotReproducedError):
        model_from_hdf5(model_to_hdf5(replace(small, temperature=0.0)))


def test_an_estimator_that_is_no_arrays_is_kept_without_pickle(forest: Model) -> None:
    (member,) = forest.members
    assert member.machine
    again = model_from_hdf5(model_to_hdf5(forest))
    assert again.id == forest.id
    signature = cohort(6)[1].signature
    assert classify(signature, again).label == classify(signature, forest).label


def test_a_type_that_is_not_allowed_is_refused(forest: Model) -> None:
    from skops.io import dumps, get_untrusted_types

    (member,) = forest.members
    assert set(get_untrusted_types(data=member.machine)) <= set(ALLOWED)
    # A foreign archive with a right hash: only the allow-list stands in its way.
    foreign = replace(forest, members=(replace(member, machine=dumps(Fraction(1, 2))),))
    with pytest.raises(CorruptFileError, match="Fraction"):
        foreign.probabilities(forest.golden_features)
    with pytest.raises(ModelNotReproducedError, match="Fraction"):
        model_from_hdf5(model_to_hdf5(foreign))
    plain = replace(forest, members=(replace(member, machine=dumps([1, 2, 3])),))
    with pytest.raises(CorruptFileError, match="not a motion classifier"):
        plain.probabilities(forest.golden_features)


@pytest.mark.parametrize("name", ["none", "../data/ventricle-simulated", "/model.h5", ""])
def test_a_name_is_never_a_path(name: str) -> None:
    with pytest.raises(NotFoundError) as caught:
        load_model(name)
    assert DEFAULT_MODEL in caught.value.remedy


def test_a_missing_file_is_not_found(tmp_path: Path) -> None:
    with pytest.raises(NotFoundError):
        load_model(tmp_path / "none.h5")


def test_the_shipped_model_is_small_whole_and_honest() -> None:
    assert available_models() == (DEFAULT_MODEL, OFFSET_MODEL)
    model = load_model()
    assert len(model_to_hdf5(model)) < 1_000_000
    assert model.id.startswith("30a85a5f267f")
    assert model.card.extra["has_seen_patients"] is False
    assert any("no patient" in note for note in model.notes[""])
    assert model.card.accuracy is not None
    assert model.card.accuracy > 0.9
    assert not any(member.machine for member in model.members)


def test_predicting_needs_no_scikit_learn() -> None:
    code = (
        "import sys; from modalmotion.classification import load_model;"
        "m = load_model(); m.probabilities(m.golden_features); print('sklearn' in sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "False"
