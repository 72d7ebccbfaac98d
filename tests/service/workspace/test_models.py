"""Models that cannot be trained, asked or kept: refused by name, and nothing is left behind."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from training_cohort import CLASSES, N_PER_CLASS, QUICK, Trained, cohort, finished, send

from modalmotion.classification import DEFAULT_MODEL
from modalmotion_service.workspace import models


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
    assert_problem(ask(ids, options={"depth": 3}), 422, "invalid_request", "depth")
    assert_problem(ask(ids, options={"timing": "oracle"}), 422, "bad_parameter", "oracle")
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


def spool(trained: Trained) -> set[Path]:
    return set((trained.data_dir / "spool").iterdir())


def assert_spool_is(trained: Trained, before: set[Path]) -> None:
    # The job has ended for whoever asks a moment before its own file goes.
    for _ in range(100):
        if spool(trained) <= before:
            return
        time.sleep(0.02)
    assert spool(trained) <= before


@pytest.mark.parametrize("moment", ["before its signature", "before the training reads it"])
def test_a_sequence_deleted_meanwhile_ends_the_training_by_name(
    trained: Trained, monkeypatch: pytest.MonkeyPatch, moment: str
) -> None:
    from modalmotion_service.workspace import training
    from modalmotion_service.workspace.analysis import Analysis

    before = spool(trained)
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
        take = training._cases

        def take_late(*args: Any) -> Any:
            if trained.store.has_sequence(target):
                trained.store.delete_sequence(target)
            return take(*args)

        monkeypatch.setattr(training, "_cases", take_late)
    answer = trained.client.post("/v1/models", json={"name": "gone", "sequences": ids})
    job = finished(trained.client, answer.json())
    assert (job["state"], job["error"]["code"]) == ("failed", "not_found")
    assert job["error"]["sequence_id"] == target
    assert "deleted" in job["error"]["detail"]
    assert job["error"]["remedy"]
    assert job["text"] is None
    assert trained.client.get("/v1/models/gone").status_code == 404
    assert_spool_is(trained, before)


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
    assert "leave this sequence out" in job["error"]["remedy"]


@pytest.mark.thorough
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
    assert trained.client.delete("/v1/models/damaged@1").status_code == 204


@pytest.mark.thorough
def test_both_kinds_are_weighed_where_points_may_slide(trained: Trained) -> None:
    client = trained.client
    ids = send(client, cohort(3, seed=77))

    def card(name: str) -> dict[str, Any]:
        body = {
            "name": name,
            "sequences": ids,
            "options": {**QUICK, "kind": None, "modes": 7, "folds": 2},
        }
        job = finished(client, client.post("/v1/models", json=body).json())
        assert job["state"] == "succeeded", job
        answer: dict[str, Any] = client.get(f"/v1/models/{name}").json()["card"]
        return answer

    stated = card("stated")
    assert stated["options"]["kind"] == "material"
    assert not any("Both kinds" in note["text"] for note in stated["notes"])
    for sequence_id in ids:
        client.patch(f"/v1/sequences/{sequence_id}", json={"facts": None})
    unstated = card("unstated")
    assert any("Both kinds" in note["text"] for note in unstated["notes"])
    assert unstated["options"]["kind"] in ("material", "normal_displacement")


def test_a_training_that_is_cancelled_leaves_nothing(
    trained: Trained, monkeypatch: pytest.MonkeyPatch
) -> None:
    import asyncio

    from modalmotion_service.workspace import training

    before = spool(trained)

    async def endless(*_: Any, **_more: Any) -> list[Path]:
        await asyncio.sleep(3600)
        return []

    monkeypatch.setattr(training, "fit_each", endless)
    body = {"name": "cancelled", "sequences": trained.ids}
    job = trained.client.post("/v1/models", json=body).json()
    for _ in range(200):
        if trained.client.get(job["links"]["self"]).json()["state"] == "running":
            break
        time.sleep(0.02)
    assert trained.client.delete(job["links"]["self"]).json()["state"] == "cancelled"
    assert trained.client.get("/v1/models/cancelled").status_code == 404
    assert_spool_is(trained, before)


def test_of_a_name_that_is_shipped_no_other_is_listed() -> None:
    shipped = models.choose(SimpleNamespace(), DEFAULT_MODEL)  # type: ignore[arg-type]
    store = SimpleNamespace(models=lambda: (replace(shipped, version=2, id="0" * 64),))
    listed = models.records(SimpleNamespace(store=store))  # type: ignore[arg-type]
    assert listed[DEFAULT_MODEL] == [shipped]
