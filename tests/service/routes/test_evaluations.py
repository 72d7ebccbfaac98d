"""Models tested and compared over HTTP: what the library says, of stored sequences."""

from __future__ import annotations

import csv
import io
from typing import Any

import pytest
from training_cohort import N_PER_CLASS, Trained, send

from modalmotion.classification import TrainingCase, evaluate
from modalmotion.formats import read_npz
from modalmotion.store import model_from_hdf5

EVALUATIONS = "/v1/models/wall-motion@1/evaluations"


@pytest.fixture(scope="module")
def tested(trained: Trained) -> tuple[list[str], dict[str, Any]]:
    ids = send(trained.client, iter(trained.test))
    answer = trained.client.post(EVALUATIONS, json={"sequences": ids, "coverage": 0.8})
    assert answer.status_code == 200, answer.text
    return ids, answer.json()


def test_an_evaluation_is_that_of_the_library(
    trained: Trained, tested: tuple[list[str], dict[str, Any]]
) -> None:
    ids, answer = tested
    image = trained.client.get(
        trained.model["links"]["self"], headers={"Accept": "application/x-hdf5"}
    )
    cases = [
        TrainingCase(read_npz(case.body).sequence, case.label, case.subject)
        for case in trained.test
    ]
    own = evaluate(model_from_hdf5(image.content), cases, 0.8)
    for name in ("accuracy", "auc", "log_loss", "brier", "n_cases", "n_subjects", "abstained"):
        assert answer[name] == pytest.approx(getattr(own, name)), name
    assert answer["confusion"] == [list(row) for row in own.confusion]
    assert (answer["model"], answer["version"]) == ("wall-motion", 1)
    assert [case["sequence_id"] for case in answer["cases"]] == ids
    assert [case["subject"] for case in answer["cases"]] == [c.subject for c in trained.test]
    for case in answer["cases"]:
        assert sum(case["probabilities"].values()) == pytest.approx(1.0)
    assert answer["notes"] == []
    assert answer["methods"]
    # The classifications are stored on the way.
    kept = trained.client.get(f"/v1/signatures/{ids[0]}/classifications").json()
    assert 0.8 in {one["coverage"] for one in kept["classifications"]}


def test_answers_by_case_and_a_picture(trained: Trained, tested: tuple[list[str], Any]) -> None:
    ids, answer = tested
    body = {"sequences": ids, "coverage": 0.8}
    table = trained.client.post(EVALUATIONS, json=body, headers={"Accept": "text/csv"})
    rows = list(csv.DictReader(io.StringIO(table.text)))
    assert [row["sequence_id"] for row in rows] == ids
    assert [row["answer"] or None for row in rows] == [c["answer"] for c in answer["cases"]]
    picture = trained.client.post(EVALUATIONS, json=body, headers={"Accept": "image/png"})
    assert picture.content.startswith(b"\x89PNG")


def test_an_evaluation_may_be_a_job(trained: Trained, tested: tuple[list[str], Any]) -> None:
    ids, answer = tested
    job = trained.client.post(
        EVALUATIONS,
        json={"sequences": ids, "coverage": 0.8},
        headers={"Prefer": "respond-async"},
    )
    assert job.status_code == 202
    for _ in range(600):
        state = trained.client.get(job.headers["Location"]).json()
        if state["state"] in ("succeeded", "failed"):
            break
    assert state["state"] == "succeeded", state
    assert trained.client.get(state["result"]).json() == answer


def test_trained_on_sequences_are_named_in_a_note(trained: Trained) -> None:
    answer = trained.client.post(EVALUATIONS, json={"sequences": trained.ids[:4]}).json()
    assert "4 of the 4 cases are in the training set" in answer["notes"][0]["text"]


def test_two_versions_are_compared(trained: Trained, tested: tuple[list[str], Any]) -> None:
    ids, answer = tested
    body = {"compare_with": "wall-motion", "sequences": ids, "coverage": 0.8}
    as_table = trained.client.post(EVALUATIONS, json=body, headers={"Accept": "text/csv"})
    assert as_table.status_code == 406
    result = trained.client.post(EVALUATIONS, json=body)
    assert result.status_code == 200, result.text
    result = result.json()
    assert result["models"][0] == "wall-motion@1"
    assert result["accuracy"]["first"] == answer["accuracy"]
    assert result["evaluations"][0] == answer
    if result["models"][1] == "wall-motion@1":
        assert result["accuracy"]["difference"] == 0.0
        assert result["accuracy"]["p"] == 1.0


def test_held_out_answers_are_given_as_a_table(trained: Trained) -> None:
    here = trained.model["links"]["self"]
    table = trained.client.get(here, headers={"Accept": "text/csv"})
    assert table.headers["content-type"].startswith("text/csv")
    rows = list(csv.DictReader(io.StringIO(table.text)))
    assert len(rows) == 2 * 2 * N_PER_CLASS
    assert {row["sequence_id"] for row in rows} == set(trained.ids)
    assert all(row["subject"].startswith(row["class"]) for row in rows)
    shipped = trained.client.get("/v1/models/ventricle-simulated", headers={"Accept": "text/csv"})
    assert shipped.status_code in (200, 404)


@pytest.mark.parametrize(
    ("change", "status", "words"),
    [
        ({"sequences": []}, 422, "no sequence"),
        ({"sequences": ["f" * 64]}, 404, "not kept"),
        ({"label": "dancing"}, 422, "does not know the class 'dancing'"),
        ({"twice": True}, 422, "more than once"),
        ({"coverage": 1.0}, 422, "coverage"),
    ],
)
def test_what_cannot_be_tested_is_refused(
    trained: Trained, change: dict[str, Any], status: int, words: str
) -> None:
    body: dict[str, Any] = {"sequences": trained.ids[:2]}
    if "label" in change:
        body["sequences"] = [{"id": trained.ids[0], **change}]
    elif "twice" in change:
        body["sequences"] = trained.ids[:1] * 2
    else:
        body.update(change)
    for more in ({}, {"compare_with": "wall-motion"}):
        answer = trained.client.post(EVALUATIONS, json={**body, **more})
        assert answer.status_code == status, answer.text
        assert words in answer.text
    missing = trained.client.post(
        EVALUATIONS.replace("@1", "@99"), json={"sequences": trained.ids[:2]}
    )
    assert missing.status_code == 404
