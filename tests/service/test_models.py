"""Models over HTTP: trained on kept sequences, described, asked, deleted."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pytest
from conftest import files_of
from fastapi.testclient import TestClient
from training_cohort import CLASSES, Sent, cohort, finished, send, train

from modalmotion.classify import DEFAULT_MODEL, load_model
from modalmotion.formats import read_npz
from modalmotion.signature import modal_signature
from modalmotion.store import ResultStore, model_from_hdf5
from modalmotion_service.app import create_app
from modalmotion_service.settings import Settings

N_PER_CLASS = 6
# Where it does not matter how scores come about.
QUICK = {"estimator": "linear"}


@dataclass
class Trained:
    """A service that has trained a model."""

    client: TestClient
    data_dir: Path
    ids: list[str]
    model: dict[str, Any]
    test: list[Sent]
    texts: list[str | None] = field(default_factory=list)

    @property
    def store(self) -> ResultStore:
        found: ResultStore = self.client.app.state.owners.local.store  # type: ignore[attr-defined]
        return found


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Trained]:
    data_dir = tmp_path_factory.mktemp("models") / "results"
    app = create_app(Settings(data_dir=data_dir, workers=2))
    with TestClient(app, raise_server_exceptions=False) as client:
        ids = send(client, cohort(N_PER_CLASS, seed=1))
        model = train(client, "wall-motion", ids)
        yield Trained(client, data_dir, ids, model, list(cohort(2, seed=2)))


def test_a_trained_model_is_described_with_its_card(trained: Trained) -> None:
    model = trained.model
    assert (model["name"], model["version"], model["origin"]) == ("wall-motion", 1, "trained")
    assert model["classes"] == sorted(map(str, CLASSES))
    assert model["versions"] == [1]
    assert model["parameters"]["modes"] == 7
    card = model["card"]
    assert card["n_cases"] == dict.fromkeys(map(str, sorted(CLASSES)), N_PER_CLASS)
    assert card["n_subjects"] == card["n_cases"]
    assert card["is_grouped"]
    assert len(card["training_set"]) == 64
    low, high = card["accuracy_interval"]
    assert 0 <= low <= card["accuracy"] <= high <= 1
    assert sum(map(sum, card["confusion"])) == 2 * N_PER_CLASS
    assert card["calibration_curve"]
    assert card["intended_use"]
    assert "modalmotion" in card["versions"]
    assert (trained.data_dir / model["file"]).is_file()
    assert trained.client.get(model["links"]["self"]).json() == model
    assert trained.client.get(model["links"]["newest"]).json() == model


def test_the_answer_is_that_of_the_same_model_in_the_library(trained: Trained) -> None:
    from modalmotion.classify import classify

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
    here = f"/v1/sequences/{trained.ids[0]}/classifications"
    first = trained.client.post(here, json={"model": "wall-motion"})
    again = trained.client.post(here, json={"model": "wall-motion@1"})
    assert (first.status_code, again.status_code) == (201, 200)
    answer = first.json()
    assert answer == again.json()
    assert (answer["model"], answer["version"]) == ("wall-motion", 1)
    assert answer["model_id"] == trained.model["id"]
    assert answer["coverage"] == 0.9
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
    here = f"/v1/sequences/{trained.ids[0]}/classifications"
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
            f"/v1/sequences/{trained.ids[0]}/classifications", json={"model": name}
        ),
        trained.client.post("/v1/classify", params={"model": name}, content=trained.test[0].body),
    ):
        assert (answer.status_code, answer.json()["code"]) == (status, code)
        assert answer.json()["remedy"]


def test_classifying_an_upload_stores_nothing(trained: Trained) -> None:
    before = files_of(trained.data_dir)
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
    assert list((trained.data_dir / "spool").iterdir()) == []


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
    here = f"/v1/models/{DEFAULT_MODEL}/versions/1"
    answer = trained.client.delete(here)
    assert (answer.status_code, answer.json()["code"]) == (409, "conflict")
    assert trained.client.get(here).status_code == 200
    answer = trained.client.post(
        "/v1/models", json={"name": DEFAULT_MODEL, "sequences": trained.ids}
    )
    assert (answer.status_code, answer.json()["code"]) == (409, "conflict")
    assert trained.client.delete(f"/v1/models/{DEFAULT_MODEL}/versions/2").status_code == 404


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


def test_a_name_trained_again_gets_its_next_version_whatever_was_deleted(
    trained: Trained,
) -> None:
    client, ids = trained.client, trained.ids
    first = train(client, "again", ids, options=QUICK)
    second = train(client, "again", ids[2:], options={**QUICK, "seed": 1})
    assert [first["version"], second["version"]] == [1, 2]
    assert second["versions"] == [1, 2]
    assert first["id"] != second["id"]
    here = f"/v1/sequences/{ids[0]}/classifications"
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


def test_trainings_of_one_name_at_once_are_distinct_versions(trained: Trained) -> None:
    made: list[int] = []

    def one() -> None:
        model = train(trained.client, "at-once", trained.ids, options=QUICK)
        made.append(model["version"])

    threads = [threading.Thread(target=one) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(made) == [1, 2, 3]


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
    assert model["card"]["options"]["estimator"] == "linear"
    # What was stated is the training's own: nothing kept is changed.
    assert trained.client.get(f"/v1/sequences/{ids[0]}").json()["label"] in map(str, CLASSES)


def test_a_training_says_how_far_it_is(trained: Trained, monkeypatch: pytest.MonkeyPatch) -> None:
    from modalmotion_service.training import Trainer

    seen: list[tuple[float, str]] = []
    original: Any = Trainer.train

    async def listening(*args: Any) -> Any:
        report = args[-1]

        def told(share: float, text: str = "") -> None:
            seen.append((share, text))
            report(share, text)
            jobs = trained.client.app.state.owners.local.jobs  # type: ignore[attr-defined]
            trained.texts += jobs._texts.values()

        return await original(*args[:-1], told)

    monkeypatch.setattr(Trainer, "train", listening)
    train(trained.client, "told", trained.ids, options=QUICK)
    shares = [share for share, _ in seen]
    assert shares == sorted(shares)
    assert (0.5, f"signature {len(trained.ids)} of {len(trained.ids)}") in seen
    assert all(0 < share <= 1 for share in shares)
    assert all(text for _, text in seen)
    assert {text for _, text in seen} == set(trained.texts)


def assert_problem(answer: Any, status: int, code: str, *words: str) -> dict[str, Any]:
    problem = dict(answer.json())
    assert answer.headers["content-type"] == "application/problem+json"
    assert (answer.status_code, problem["code"]) == (status, code), problem
    assert problem["remedy"]
    for word in words:
        assert word in problem["detail"], problem
    return problem


def test_what_no_model_can_be_trained_on_is_refused_by_name(trained: Trained) -> None:
    client, ids = trained.client, trained.ids

    def ask(sequences: list[Any], **more: Any) -> Any:
        return client.post("/v1/models", json={"name": "bad", "sequences": sequences, **more})

    before = client.get("/v1/jobs").json()
    problem = assert_problem(
        ask([*ids, "0" * 64, "1" * 64]), 404, "not_found", "2 sequences", "000000000000"
    )
    assert problem["sequence_ids"] == ["0" * 64, "1" * 64]
    problem = assert_problem(
        ask([*ids, ids[0]]), 422, "bad_parameter", "more than once", ids[0][:12]
    )
    assert problem["sequence_ids"] == [ids[0]]
    one_class = ids[::2]
    problem = assert_problem(ask(one_class), 422, "bad_parameter", "at least two classes")
    assert list(problem["classes"].values()) == [N_PER_CLASS]
    assert_problem(ask([]), 422, "bad_parameter", "at least two classes")
    problem = assert_problem(ask([*one_class, ids[1]]), 422, "bad_parameter", "fewer than 2")
    assert problem["sequence_ids"] == [ids[1]]
    unlabelled = client.post("/v1/sequences", content=next(cohort(1, seed=50)).body).json()["id"]
    problem = assert_problem(ask([*ids, unlabelled]), 422, "bad_parameter", "without a label")
    assert problem["sequence_ids"] == [unlabelled]
    assert "PATCH" in problem["remedy"]
    assert_problem(ask(ids, options={"modes": 0}), 422, "bad_parameter", "modes")
    assert_problem(ask(ids, options={"depth": 3}), 422, "bad_parameter", "depth")
    assert_problem(ask(ids, options={"estimator": "oracle"}), 422, "bad_parameter", "oracle")
    named = client.post("/v1/models", json={"name": "Not a name", "sequences": ids})
    assert "lower-case" in assert_problem(named, 422, "bad_parameter", "Not a name")["remedy"]
    for body in (
        {"sequences": ids},
        {"name": "bad"},
        {"name": "bad", "sequences": ["short"]},
        {"name": "bad", "sequences": [{"label": "x"}]},
        {"name": "bad", "sequences": [{"id": ids[0], "lable": "x"}]},
        {"name": "bad", "sequences": ids, "colour": "red"},
        {"name": "bad", "sequences": ids, "options": [1]},
    ):
        assert_problem(client.post("/v1/models", json=body), 422, "invalid_request")
    assert client.get("/v1/jobs").json() == before
    assert client.get("/v1/models/bad").status_code == 404


@pytest.mark.parametrize("moment", ["before its signature", "before the training reads it"])
def test_a_sequence_deleted_meanwhile_ends_the_training_by_name(
    trained: Trained, monkeypatch: pytest.MonkeyPatch, moment: str
) -> None:
    from modalmotion_service import training
    from modalmotion_service.analysis import Analysis

    ids = send(trained.client, cohort(2, seed=len(moment)))
    target = ids[-1]
    if moment == "before its signature":
        original = Analysis.signature

        async def late(self: Analysis, sequence_id: str, *rest: Any) -> Path:
            if sequence_id == target and trained.store.has_sequence(target):
                trained.store.delete_sequence(target)
            return await original(self, sequence_id, *rest)

        monkeypatch.setattr(Analysis, "signature", late)
    else:
        write = training._write_plan

        def write_late(*args: Any) -> None:
            write(*args)
            trained.store.delete_sequence(target)

        monkeypatch.setattr(training, "_write_plan", write_late)
    answer = trained.client.post("/v1/models", json={"name": "gone", "sequences": ids})
    job = finished(trained.client, answer.json())
    assert (job["state"], job["error"]["code"]) == ("failed", "not_found")
    assert job["error"]["sequence_id"] == target
    assert "deleted" in job["error"]["detail"]
    assert job["error"]["remedy"]
    assert job["text"] is None
    assert trained.client.get("/v1/models/gone").status_code == 404
    assert list((trained.data_dir / "spool").iterdir()) == []


def test_a_sequence_that_cannot_be_fitted_ends_the_training_by_name(
    trained: Trained, npz: Callable[..., bytes]
) -> None:
    import numpy as np

    tiny = npz(
        vertices=np.random.default_rng(1).normal(size=(4, 4, 3)), topology="cup", grid=(2, 2)
    )
    odd = trained.client.post("/v1/sequences", content=tiny, params={"label": "odd"}).json()["id"]
    cases = [*trained.ids[:4], {"id": odd, "label": str(CLASSES[0])}]
    answer = trained.client.post("/v1/models", json={"name": "unfit", "sequences": cases})
    job = finished(trained.client, answer.json())
    assert job["state"] == "failed"
    assert job["error"]["sequence_id"] == odd
    assert odd[:12] in job["error"]["detail"]
    assert "without this sequence" in job["error"]["remedy"]


def test_a_sequence_of_another_topology_ends_the_training_by_name(
    trained: Trained, npz: Callable[..., bytes]
) -> None:
    import numpy as np

    phase = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)
    x = np.linspace(0.0, 30.0, 12)
    curve = np.zeros((8, 12, 3))
    curve[:, :, 0] = x
    curve[:, :, 1] = 3.0 * np.sin(phase)[:, None] * np.sin(x / 5.0)
    body = npz(vertices=curve, topology="open curve", unit="mm")
    odd = trained.client.post("/v1/sequences", content=body).json()["id"]
    cases = [*trained.ids, {"id": odd, "label": str(CLASSES[0])}]
    answer = trained.client.post("/v1/models", json={"name": "mixed", "sequences": cases})
    job = finished(trained.client, answer.json())
    assert (job["state"], job["error"]["code"]) == ("failed", "bad_parameter")
    assert job["error"]["sequence_ids"] == [odd]
    assert odd[:12] in job["error"]["detail"]
    assert "one topology" in job["error"]["remedy"]


def test_a_model_that_no_longer_reproduces_is_refused_and_others_are_served(
    trained: Trained,
) -> None:
    kept = trained.store.kept_model("wall-motion", 1)
    record = replace(kept.record, name="drifted", training=None)
    wrong = trained.store.put_model(replace(kept, record=record, data=kept.data[:-100]))
    here = f"/v1/sequences/{trained.ids[1]}/classifications"
    answer = trained.client.post("/v1/classify?model=drifted", content=trained.test[0].body)
    problem = assert_problem(answer, 409, "model_not_reproduced", "drifted@1")
    assert (problem["model"], problem["version"]) == ("drifted", wrong.version)
    assert_problem(
        trained.client.post(here, json={"model": "drifted"}), 409, "model_not_reproduced"
    )
    assert trained.client.get("/v1/models/drifted").json()["card"] == trained.model["card"]
    assert trained.client.post(here, json={"model": "wall-motion"}).status_code in (200, 201)
    names = [model["name"] for model in trained.client.get("/v1/models").json()["models"]]
    assert "drifted" in names


def test_a_damaged_model_is_refused_and_others_are_served(trained: Trained) -> None:
    kept = trained.store.kept_model("wall-motion", 1)
    record = replace(kept.record, name="damaged", training=None)
    trained.store.put_model(replace(kept, record=record))
    path = trained.data_dir / "models" / "damaged" / "1.h5"
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    answer = trained.client.post("/v1/classify?model=damaged", content=trained.test[0].body)
    assert_problem(answer, 500, "corrupt_file")
    assert_problem(trained.client.get("/v1/models/damaged"), 500, "corrupt_file")
    assert trained.client.get("/v1/models").status_code == 200
    assert trained.client.get("/v1/models/wall-motion").status_code == 200
    # It can be removed like any other.
    assert trained.client.delete("/v1/models/damaged/versions/1").status_code == 204


def test_a_training_that_is_cancelled_leaves_nothing(
    trained: Trained, monkeypatch: pytest.MonkeyPatch
) -> None:
    import asyncio
    import time

    from modalmotion_service.training import Trainer

    async def endless(self: Trainer, *_: Any) -> list[Path]:
        await asyncio.sleep(3600)
        return []

    monkeypatch.setattr(Trainer, "_fit", endless)
    body = {"name": "cancelled", "sequences": trained.ids}
    job = trained.client.post("/v1/models", json=body).json()
    for _ in range(200):
        if trained.client.get(job["links"]["self"]).json()["state"] == "running":
            break
        time.sleep(0.02)
    assert trained.client.delete(job["links"]["self"]).json()["state"] == "cancelled"
    assert trained.client.get("/v1/models/cancelled").status_code == 404
    for _ in range(100):
        if not list((trained.data_dir / "spool").iterdir()):
            break
        time.sleep(0.02)
    assert list((trained.data_dir / "spool").iterdir()) == []
