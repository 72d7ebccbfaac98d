"""Models over HTTP: trained on kept sequences, described, asked, deleted."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import pytest
from bent_surfaces import bent_beat, bent_cohort
from services import files_of
from training_cohort import (
    CLASSES,
    N_PER_CLASS,
    QUICK,
    Sent,
    Trained,
    cohort,
    finished,
    send,
    train,
)

from modalmotion.classification import DEFAULT_MODEL, load_model
from modalmotion.formats import read_npz, write_npz
from modalmotion.mesh.sequence import mesh_sequence
from modalmotion.progress import Progress
from modalmotion.signature.making import modal_signature
from modalmotion.store import model_from_hdf5


def test_a_trained_model_is_described_with_its_card(trained: Trained) -> None:
    model = trained.model
    assert (model["name"], model["version"], model["origin"]) == ("wall-motion", 1, "trained")
    assert model["classes"] == sorted(map(str, CLASSES))
    assert model["versions"] == [1]
    assert model["parameters"]["modes"] == 18
    card = model["card"]
    assert card["n_cases"] == dict.fromkeys(map(str, sorted(CLASSES)), N_PER_CLASS)
    assert card["n_subjects"] == card["n_cases"]
    assert card["is_grouped"]
    assert len(card["training_set"]) == 64
    low, high = card["accuracy_interval"]
    assert 0 <= low <= card["accuracy"] <= high <= 1
    assert card["repetitions"] == 2
    assert sum(map(sum, card["confusion"])) == 2 * 2 * N_PER_CLASS
    assert set(card["sensitivity"]) == set(card["specificity"]) == set(model["classes"])
    for figure in (*card["sensitivity"].values(), *card["class_auc"].values()):
        assert 0 <= figure["low"] <= figure["value"] <= figure["high"] <= 1
    assert all("Holm" in test["text"] for test in card["confounds"])
    assert card["calibration_curve"]
    assert card["intended_use"]
    assert "modalmotion" in card["versions"]
    assert (trained.data_dir / model["file"]).is_file()
    assert trained.client.get(model["links"]["self"]).json() == model
    assert trained.client.get(model["links"]["newest"]).json() == model


def test_a_card_is_a_page_of_its_own_by_accept(trained: Trained) -> None:
    here = "/v1/models/wall-motion"
    page = trained.client.get(here, headers={"Accept": "text/markdown"})
    assert page.headers["content-type"] == "text/markdown; charset=utf-8"
    assert "# wall-motion@1" in page.text
    assert trained.model["id"] in page.text
    seen = {"Accept": "text/markdown", "If-None-Match": page.headers["etag"]}
    assert trained.client.get(here, headers=seen).status_code == 304


def test_the_answer_is_that_of_the_same_model_in_the_library(trained: Trained) -> None:
    from modalmotion.classification import classify

    image = trained.client.get(
        trained.model["links"]["self"], headers={"Accept": "application/x-hdf5"}
    )
    assert image.headers["content-type"] == "application/x-hdf5"
    assert 'filename="wall-motion-1.h5"' in image.headers["content-disposition"]
    model = model_from_hdf5(image.content)
    assert model.id == trained.model["id"]
    for case in trained.test:
        sequence = read_npz(case.body).sequence
        own = classify(modal_signature(sequence, model.signature_parameters), model, 0.8)
        answer = trained.client.post(
            "/v1/classify", params={"model": "wall-motion@1", "coverage": 0.8}, content=case.body
        ).json()
        assert answer["probabilities"] == dict(
            zip(own.classes, own.probabilities.tolist(), strict=True)
        )
        assert (answer["label"], answer["class_set"]) == (own.label, list(own.class_set))
        assert answer["sequence_id"] == sequence.id


def test_a_sequence_is_asked_about_once_for_each_model_and_coverage(trained: Trained) -> None:
    here = f"/v1/signatures/{trained.ids[0]}/classifications"
    first = trained.client.post(here, json={"model": "wall-motion", "coverage": 0.91})
    again = trained.client.post(here, json={"model": "wall-motion@1", "coverage": 0.91})
    assert (first.status_code, again.status_code) == (201, 200)
    answer = first.json()
    assert answer == again.json()
    assert (answer["model"], answer["version"]) == ("wall-motion", 1)
    assert answer["model_id"] == trained.model["id"]
    assert answer["coverage"] == 0.91
    assert (trained.data_dir / answer["file"]).is_file()
    surer = trained.client.post(here, json={"model": "wall-motion", "coverage": 0.99})
    assert surer.status_code == 201
    assert surer.json()["coverage"] == 0.99
    assert set(surer.json()["class_set"]) >= set(answer["class_set"])
    shipped = trained.client.post(here).json()
    assert (shipped["model"], shipped["version"]) == (DEFAULT_MODEL, 1)
    listed = trained.client.get(here).json()["classifications"]
    for one in (answer, surer.json(), shipped):
        assert one in listed


@pytest.mark.parametrize("coverage", [0, 1, -0.1, 1.5, "nan", "many"])
def test_a_coverage_that_is_no_share_is_refused(trained: Trained, coverage: object) -> None:
    here = f"/v1/signatures/{trained.ids[0]}/classifications"
    answer = trained.client.post(here, json={"coverage": coverage})
    assert (answer.status_code, answer.json()["code"]) == (422, "invalid_request")
    answer = trained.client.post(
        "/v1/classify", params={"coverage": str(coverage)}, content=trained.test[0].body
    )
    assert (answer.status_code, answer.json()["code"]) == (422, "invalid_request")


@pytest.mark.parametrize(
    ("name", "status", "code"),
    [
        ("nobody", 404, "not_found"),
        ("wall-motion@77", 404, "not_found"),
        (f"{DEFAULT_MODEL}@2", 404, "not_found"),
        ("Wall Motion", 404, "not_found"),
        ("../wall-motion", 404, "not_found"),
        ("wall-motion@0", 404, "not_found"),
        ("", 404, "not_found"),
        ("x" * 200, 422, "invalid_request"),
    ],
)
def test_a_model_that_is_none_is_refused(
    trained: Trained, name: str, status: int, code: str
) -> None:
    for answer in (
        trained.client.post(
            f"/v1/signatures/{trained.ids[0]}/classifications", json={"model": name}
        ),
        trained.client.post("/v1/classify", params={"model": name}, content=trained.test[0].body),
    ):
        assert (answer.status_code, answer.json()["code"]) == (status, code)
        assert answer.json()["remedy"]


def test_classifying_an_upload_stores_nothing(trained: Trained) -> None:
    before, spool = files_of(trained.data_dir), trained.data_dir / "spool"
    waiting = set(spool.iterdir())
    listed = trained.client.get("/v1/sequences").json()
    unseen = next(cohort(1, seed=99))
    answer = trained.client.post(
        "/v1/classify", params={"model": "wall-motion", "unit": "mm"}, content=unseen.body
    )
    assert answer.status_code == 200
    assert answer.json()["file"] is None
    assert answer.json()["reading"]["format"] == "npz"
    assert (answer.json()["model"], answer.json()["version"]) == ("wall-motion", 1)
    form = trained.client.post("/v1/classify", files={"file": ("x.npz", unseen.body)})
    assert form.json()["model"] == DEFAULT_MODEL
    bad = trained.client.post("/v1/classify", content=b"nonsense")
    assert (bad.status_code, bad.json()["code"]) == (400, "malformed_file")
    assert files_of(trained.data_dir) == before
    assert trained.client.get("/v1/sequences").json() == listed
    assert set(spool.iterdir()) <= waiting


def test_models_are_listed_by_name_with_those_that_are_shipped(trained: Trained) -> None:
    everything = trained.client.get("/v1/models").json()
    names = [model["name"] for model in everything["models"]]
    assert names == sorted(names)
    assert {"wall-motion", DEFAULT_MODEL} <= set(names)
    assert everything["cursor"] is None
    paged, cursor = [], None
    while True:
        query = {"limit": 1} | ({"cursor": cursor} if cursor else {})
        page = trained.client.get("/v1/models", params=query).json()
        paged += page["models"]
        cursor = page["cursor"]
        if cursor is None:
            break
    assert paged == everything["models"]
    assert trained.client.get("/v1/models?cursor=nonsense").status_code == 422


def test_a_shipped_model_has_a_card_and_cannot_be_changed(trained: Trained) -> None:
    model = trained.client.get(f"/v1/models/{DEFAULT_MODEL}").json()
    assert (model["origin"], model["version"], model["file"]) == ("shipped", 1, None)
    assert model["id"] == load_model().id
    assert model["card"]["has_seen"]
    assert model["card"]["has_not_seen"]
    here = f"/v1/models/{DEFAULT_MODEL}@1"
    answer = trained.client.delete(here)
    assert (answer.status_code, answer.json()["code"]) == (409, "conflict")
    assert trained.client.get(here).status_code == 200
    answer = trained.client.post(
        "/v1/models", json={"name": DEFAULT_MODEL, "sequences": trained.ids}
    )
    assert (answer.status_code, answer.json()["code"]) == (409, "conflict")
    assert trained.client.delete(f"/v1/models/{DEFAULT_MODEL}@2").status_code == 404


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["wall-motion", DEFAULT_MODEL])
def test_a_model_has_a_picture_and_an_etag(trained: Trained, name: str) -> None:
    here = f"/v1/models/{name}"
    picture = trained.client.get(here, headers={"Accept": "image/png"})
    assert picture.headers["content-type"] == "image/png"
    assert picture.content.startswith(b"\x89PNG")
    tag = picture.headers["etag"]
    again = trained.client.get(here, headers={"Accept": "image/png", "If-None-Match": tag})
    assert (again.status_code, again.content) == (304, b"")
    assert trained.client.get(here, headers={"If-None-Match": tag}).status_code == 200
    assert trained.client.get(here, headers={"Accept": "text/html"}).status_code == 406


@pytest.mark.thorough
def test_a_name_trained_again_gets_its_next_version_whatever_was_deleted(
    trained: Trained,
) -> None:
    client, ids = trained.client, trained.ids
    first = train(client, "again", ids, options=QUICK)
    second = train(client, "again", ids[2:], options={**QUICK, "seed": 1})
    assert [first["version"], second["version"]] == [1, 2]
    assert second["versions"] == [1, 2]
    assert first["id"] != second["id"]
    here = f"/v1/signatures/{ids[0]}/classifications"
    answer = client.post(here, json={"model": "again"}).json()
    assert (answer["version"], answer["model_id"]) == (2, second["id"])
    assert client.post(here, json={"model": "again@1"}).json()["model_id"] == first["id"]
    assert client.delete(second["links"]["self"]).status_code == 204
    gone = client.get(second["links"]["self"])
    assert (gone.status_code, gone.json()["code"]) == (404, "not_found")
    assert "deleted" in gone.json()["detail"]
    assert client.delete(second["links"]["self"]).status_code == 404
    assert client.get("/v1/models/again").json()["version"] == 1
    refused = client.post(here, json={"model": "again@2"})
    assert (refused.status_code, refused.json()["code"]) == (404, "not_found")
    # What it has said stays, and says which version said it.
    assert answer in client.get(here).json()["classifications"]
    assert train(client, "again", ids, options=QUICK)["version"] == 3


@pytest.mark.thorough
def test_trainings_of_one_name_at_once_are_distinct_versions(trained: Trained) -> None:
    made: list[int] = []

    def one() -> None:
        model = train(trained.client, "at-once", trained.ids, options=QUICK)
        made.append(model["version"])

    threads = [threading.Thread(target=one) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(made) == [1, 2]


def test_a_training_sent_again_with_its_key_is_one_job(trained: Trained) -> None:
    body = {"name": "keyed", "sequences": trained.ids, "options": QUICK}
    key = {"Idempotency-Key": "train once"}
    first = trained.client.post("/v1/models", json=body, headers=key)
    again = trained.client.post("/v1/models", json=body, headers=key)
    assert (first.status_code, again.status_code) == (202, 202)
    assert first.json()["id"] == again.json()["id"]
    assert again.headers["idempotency-replayed"] == "true"
    other = trained.client.post("/v1/models", json={**body, "name": "other"}, headers=key)
    assert other.json()["code"] == "idempotency_mismatch"
    finished(trained.client, first.json())
    assert trained.client.get("/v1/models/keyed").json()["versions"] == [1]


def test_labels_and_subjects_may_be_stated_for_the_training(trained: Trained) -> None:
    ids = trained.ids
    stated: list[Any] = [
        {"id": ids[n], "label": f"group {n % 3}", "subject": f"s{n // 2}"} for n in range(9)
    ]
    stated += [{"id": ids[9]}, ids[11]]
    kept = trained.client.get(f"/v1/sequences/{ids[9]}").json()["label"]
    model = train(trained.client, "stated", stated, options=QUICK)
    assert model["classes"] == sorted({"group 0", "group 1", "group 2", kept})
    assert model["card"]["n_cases"]["group 1"] == 3
    assert model["card"]["n_cases"][kept] == 2
    # What was stated is the training's own: nothing kept is changed.
    assert trained.client.get(f"/v1/sequences/{ids[0]}").json()["label"] in map(str, CLASSES)


def test_a_training_says_how_far_it_is(trained: Trained, monkeypatch: pytest.MonkeyPatch) -> None:
    from modalmotion_service.workspace import model_operations

    seen: list[Progress] = []
    original: Any = vars(model_operations)["train"]

    async def listening(*args: Any) -> Any:
        report = args[-1]

        def told(progress: Progress) -> None:
            seen.append(progress)
            report(progress)
            runner = trained.client.app.state.owners.local.runner  # type: ignore[attr-defined]
            trained.texts += runner._texts.values()

        return await original(*args[:-1], told)

    monkeypatch.setattr(model_operations, "train", listening)
    train(trained.client, "told", trained.ids, options=QUICK)
    shares = [one.share for one in seen]
    assert shares == sorted(shares)
    assert Progress(0.5, stage=f"signature {len(trained.ids)} of {len(trained.ids)}") in seen
    assert all(0 < share <= 1 for share in shares)
    assert all(one.stage for one in seen)
    assert {one.stage for one in seen} == set(trained.texts)


@pytest.mark.thorough
def test_a_cohort_of_bent_surfaces_is_trained_in_one_basis(trained: Trained) -> None:
    client = trained.client
    bent = (
        Sent(write_npz(sequence), label, f"bent {number}")
        for number, (sequence, label) in enumerate(bent_cohort(3, 1))
    )
    ids = send(client, bent)
    every: list[tuple[dict[str, str], str]] = [({}, "mesh"), ({"topology": "sphere"}, "sphere")]
    for options, surface in every:
        model = train(client, f"bent-{surface}", ids, options={**QUICK, **options})
        image = client.get(model["links"]["self"], headers={"Accept": "application/x-hdf5"})
        assert model_from_hdf5(image.content).readable.topology == surface
        answers = [
            client.post(
                f"/v1/signatures/{known}/classifications", json={"model": f"bent-{surface}"}
            )
            for known in ids[:4]
        ]
        assert {answer.status_code for answer in answers} <= {200, 201}
        assert not any("topology" in note["text"] for a in answers for note in a.json()["notes"])
        sent = client.post(
            "/v1/classify",
            params={"model": f"bent-{surface}"},
            content=write_npz(bent_beat("strong", 3.3, np.random.default_rng(9))),
        )
        assert sent.status_code == 200
        assert not any("topology" in note["text"] for note in sent.json()["notes"])


def test_covariates_of_a_training_are_the_sequences_own_and_those_stated(
    trained: Trained,
) -> None:
    from modalmotion_service.schemas.queries import LabelledSequence
    from modalmotion_service.workspace.spool import SpoolFile
    from modalmotion_service.workspace.training import look_up, read_cases, write_cases

    first = trained.ids[0]
    here = f"/v1/sequences/{first}"
    trained.client.patch(here, json={"facts": {"covariates": {"age": 61, "sex": "f"}}})
    named = [LabelledSequence(id=name) for name in trained.ids[1:]]
    named.append(LabelledSequence(id=first, covariates={"age": 62}))
    cases = look_up(trained.store, named, 1000)
    trained.client.patch(here, json={"facts": None})
    assert cases[-1].covariates == {"age": 62, "sex": "f"}
    assert cases[0].covariates == {}
    file = SpoolFile(trained.data_dir / "spool" / "cases.json")
    write_cases(file, cases)
    assert read_cases(file.path) == cases
    file.remove()


@pytest.mark.thorough
def test_a_training_goes_on_without_a_sequence_that_does_not_fit(trained: Trained) -> None:
    flat = mesh_sequence(np.zeros((3, 4, 3)), grid=(2, 2), topology="cup", unit="mm")
    odd = Sent(write_npz(flat), str(CLASSES[0]), "flat")
    (name,) = send(trained.client, iter([odd]))
    cases = [*trained.ids, name]
    request = {"name": "careful", "sequences": cases, "options": QUICK}
    job = finished(trained.client, trained.client.post("/v1/models", json=request).json())
    assert job["state"] == "failed"
    assert name[:12] in job["error"]["detail"]
    model = train(trained.client, "careful", cases, options={**QUICK, "on_error": "leave out"})
    notes = [note["text"] for note in model["card"]["notes"]]
    assert notes[0] == "Cases left out: 1."
    assert notes[1].startswith(f"Left out: Sequence {name[:12]}: ")
    assert sum(model["card"]["n_cases"].values()) == len(trained.ids)
    trained.client.delete(f"/v1/sequences/{name}")
    trained.client.delete(model["links"]["self"])
