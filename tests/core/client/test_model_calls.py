"""The client: models, read-outs, pictures and templates are those of the service."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from running import RunningService
from training_cohort import cohort

import modalmotion as mm
from modalmotion.classification import classify, load_model
from modalmotion.client import Client, RemoteError
from modalmotion.clinical import clinical_readouts
from modalmotion.formats import read_npz
from modalmotion.notes import notes_as_json
from modalmotion.progress import Progress

PNG = b"\x89PNG"


@pytest.fixture(scope="module")
def remote(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Client]:
    running = RunningService(tmp_path_factory.mktemp("service") / "results", {"WORKERS": "1"})
    running.start()
    with Client(running.base) as client:
        yield client
    running.stop()


@pytest.fixture(scope="module")
def kept(remote: Client, beat: bytes) -> str:
    return str(remote.upload(beat).id)


def test_the_features_of_sequences_are_the_librarys_own(remote: Client, tmp_path: Path) -> None:
    from modalmotion.classification import SignatureFeatures, TrainingCase, feature_table

    sent = list(cohort(2, 7))
    infos = [remote.upload(one.body, label=one.label, subject=one.subject) for one in sent]
    cases = [{"id": info.id, "covariates": {"age": 50 + k}} for k, info in enumerate(infos)]
    table = remote.features(cases, covariates=["age"], kind="summary")
    own = feature_table(
        [
            TrainingCase(read_npz(one.body).sequence, one.label, covariates={"age": 50 + k})
            for k, one in enumerate(sent)
        ],
        SignatureFeatures(covariates=["age"], kind="summary"),
    )
    assert np.allclose(table.values, own.values, rtol=1e-9, atol=1e-12)
    assert (table.columns, table.labels) == (own.columns, own.labels)
    ids = [info.id for info in infos]
    remote.save("features", tmp_path / "features.csv", sequences=ids)
    assert (tmp_path / "features.csv").read_text() == remote.features(ids).as_csv()
    for one in ids:
        remote.delete(one)


def test_a_model_is_trained_asked_saved_and_deleted(remote: Client, tmp_path: Path) -> None:
    sent = list(cohort(4, 1))
    ids = [remote.upload(one.body, label=one.label, subject=one.subject).id for one in sent]
    seen: list[Progress] = []
    quick: dict[str, Any] = {"modes": 7, "repetitions": 1}
    first = remote.train("walls", ids, progress=seen.append, **quick)
    assert (first.name, first.version, first.origin) == ("walls", 1, "trained")
    shares = [progress.share for progress in seen]
    assert shares == sorted(shares)
    renamed = [{"id": one, "label": f"{sent[k].label}!"} for k, one in enumerate(ids)]
    second = remote.start_training("walls", renamed, **quick).wait()
    assert second["versions"] == [1, 2]
    assert remote.model("walls") == second
    assert remote.model("walls@1")["classes"] == sorted({one.label for one in sent})
    assert remote.model("walls@1")["card"]["options"]["modes"] == 7
    assert {model.name for model in remote.models(page=1)} >= {"walls", "ventricle-simulated"}

    remote.save("model", tmp_path / "own.h5", "walls@1")
    remote.save("model", tmp_path / "card.png", "walls")
    assert (tmp_path / "card.png").read_bytes().startswith(PNG)
    with pytest.raises(mm.ParameterError, match=r"\.h5"):
        remote.save("model", tmp_path / "own.xyz", "walls")
    answer = remote.classify_of(sent[0].body, model="walls@1")
    own = classify(read_npz(sent[0].body).sequence, load_model(tmp_path / "own.h5"))
    assert (answer.label, answer.model_id) == (own.label, first.id)
    stated = dict(zip(own.classes, own.probabilities, strict=True))
    assert answer.probabilities == pytest.approx(stated, abs=1e-12)
    assert remote.classify(ids[0], model="walls@1").probabilities == answer.probabilities

    result = remote.evaluate("walls@1", ids, coverage=0.8)
    assert (result["n_cases"], result["version"], result["coverage"]) == (len(ids), 1, 0.8)
    remote.save("evaluation", tmp_path / "cases.csv", "walls", sequences=renamed)
    assert len((tmp_path / "cases.csv").read_text().splitlines()) == 1 + len(ids)
    remote.save("model", tmp_path / "held-out.csv", "walls@1")
    assert len((tmp_path / "held-out.csv").read_text().splitlines()) == 1 + len(ids)
    same = remote.evaluate("walls@1", ids, compare_with="walls@1")
    assert same["accuracy"]["difference"] == 0.0

    remote.delete_model("walls@1")
    assert remote.model("walls")["versions"] == [2]
    with pytest.raises(mm.NotFoundError):
        remote.model("walls@1")
    with pytest.raises(RemoteError, match="shipped"):
        remote.train("ventricle-simulated", ids)
    with pytest.raises(RemoteError, match="chocolate"):
        remote.train("walls", ids, chocolate=1)


def test_volumes_are_the_librarys_own(remote: Client, kept: str, beat: bytes) -> None:
    sequence = read_npz(beat).sequence
    signature = mm.modal_signature(sequence, mm.SignatureParameters(modes=18))
    own = clinical_readouts(signature, sequence)
    found = remote.readouts(kept, modes=18)
    assert found.volume_unit == "ml"
    ours = found.from_signature
    np.testing.assert_array_equal(ours.volumes, own.curve.volumes * own.shown_in)
    np.testing.assert_array_equal(ours.bounds, own.curve.bounds * own.shown_in)
    np.testing.assert_array_equal(found.of_mesh.volumes, own.mesh_curve.volumes * own.shown_in)
    np.testing.assert_array_equal(found.times, sequence.times)
    assert ours.ejection_fraction.value == own.curve.ejection_fraction
    assert (ours.ejection_fraction.low, ours.ejection_fraction.high) == own.curve.share_range
    assert found.of_mesh.ejection_fraction.value == own.mesh_curve.ejection_fraction
    assert found["notes"] == notes_as_json(own.notes)


@pytest.mark.thorough
def test_the_trade_and_the_pictures(remote: Client, kept: str, tmp_path: Path) -> None:
    trade = remote.tradeoff(kept, front_modes=12, modes=4)
    assert trade["sequence_id"] == kept
    pictures = {}
    asked: dict[str, tuple[str, dict[str, Any]]] = {
        "signature.png": ("signature", {"modes": 4}),
        "more.png": ("signature", {"modes": 9}),
        "readouts.png": ("readouts", {"modes": 4}),
        "tradeoff.png": ("tradeoff", {"front_modes": 12}),
    }
    for name, (what, options) in asked.items():
        remote.save(what, tmp_path / name, kept, **options)
        pictures[name] = (tmp_path / name).read_bytes()
        assert pictures[name].startswith(PNG)
    assert len(set(pictures.values())) == len(pictures)
    sheet = mm.mesh_sequence(np.random.default_rng(1).normal(size=(2, 64, 3)), grid=(8, 8))
    with pytest.raises(RemoteError):
        remote.save("readouts", tmp_path / "none.png", remote.upload(sheet).id)
    assert not (tmp_path / "none.png").exists()


def test_templates_are_listed_and_deleted(remote: Client, beat: bytes) -> None:
    template = remote.make_template(beat)
    assert remote.templates() == [template.id]
    remote.delete_template(template.id)
    assert remote.templates() == []
    with pytest.raises(mm.NotFoundError):
        remote.template(template.id)


def test_who_did_what_is_listed(remote: Client, kept: str) -> None:
    newest = next(remote.audit(page=2))
    assert newest["method"] in ("GET", "POST", "DELETE")
    uploads = [one for one in remote.audit(owner="local") if kept in one["ids"]]
    assert uploads[-1]["route"] == "/v1/sequences"
    assert list(remote.audit(owner="nobody")) == []
