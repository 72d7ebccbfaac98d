"""Features of stored sequences over HTTP, as JSON and as CSV."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bent_surfaces import bent_cohort
from fastapi.testclient import TestClient
from services import files_of
from training_cohort import Sent, cohort, finished, send

from modalmotion.formats import write_npz
from modalmotion.mesh.sequence import mesh_sequence

CSV = {"Accept": "text/csv"}


@dataclass(frozen=True)
class Cohort:
    """A service that stores a few ventricles."""

    client: TestClient
    data_dir: Path
    ids: list[str]


@pytest.fixture(scope="module")
def stored(shared_client: TestClient, shared_data_dir: Path) -> Cohort:
    return Cohort(shared_client, shared_data_dir, send(shared_client, cohort(2, seed=31)))


def ask(stored: Cohort, sequences: list[Any], headers: Any = None, **options: Any) -> Any:
    request = {"sequences": sequences, **options}
    return stored.client.post("/v1/features", json=request, headers=headers)


def test_a_table_has_a_line_for_each_sequence(stored: Cohort) -> None:
    answer = ask(stored, stored.ids)
    assert answer.status_code == 200, answer.text
    assert answer.headers["cases-left-out"] == "0"
    table = answer.json()
    assert [case["sequence_id"] for case in table["cases"]] == stored.ids
    assert all(case["label"] and case["subject"] for case in table["cases"])
    assert {len(case["values"]) for case in table["cases"]} == {len(table["columns"])}
    text = ask(stored, stored.ids, CSV)
    assert text.headers["content-type"].startswith("text/csv")
    rows = list(csv.reader(io.StringIO(text.text)))
    assert rows[0][4:] == table["columns"]
    assert [[float(v) for v in row[4:]] for row in rows[1:]] == [
        case["values"] for case in table["cases"]
    ]


def test_covariates_are_stored_or_stated_with_the_request(stored: Cohort) -> None:
    first, second, *rest = stored.ids
    here = f"/v1/sequences/{first}"
    stored.client.patch(here, json={"facts": {"covariates": {"age": 61, "sex": "f"}}})
    stated = {"id": second, "label": "other", "covariates": {"age": 40}}
    table = ask(stored, [first, stated, *rest], covariates="all").json()
    stored.client.patch(here, json={"facts": None})
    assert table["columns"][-2:] == ["covariate age", "covariate sex=f"]
    assert [case["values"][-2:] for case in table["cases"][:3]] == [
        [61, 1],
        [40, None],
        [None, None],
    ]
    assert table["cases"][1]["label"] == "other"


def test_it_may_be_a_job_whose_result_is_the_table(stored: Cohort) -> None:
    before = files_of(stored.data_dir)
    answer = ask(stored, stored.ids, {**CSV, "Prefer": "respond-async"})
    assert answer.status_code == 202
    job = finished(stored.client, answer.json())
    assert job["state"] == "succeeded", job["error"]
    result = stored.client.get(job["result"])
    assert result.text == ask(stored, stored.ids, CSV).text
    assert set(files_of(stored.data_dir)) >= set(before)


def test_surfaces_of_one_mesh_are_read_in_one_basis(stored: Cohort) -> None:
    bent = [Sent(write_npz(s), label, f"b {k}") for k, (s, label) in enumerate(bent_cohort(2, 1))]
    ids = send(stored.client, iter(bent))
    answer = ask(stored, ids, modes=4)
    assert answer.status_code == 200, answer.text
    assert len(answer.json()["cases"]) == 4
    for name in ids:
        stored.client.delete(f"/v1/sequences/{name}")


def test_what_does_not_fit_is_named_and_left_out_on_request(stored: Cohort) -> None:
    flat = mesh_sequence(np.zeros((3, 4, 3)), grid=(2, 2), topology="cup", unit="mm")
    (odd,) = send(stored.client, iter([Sent(write_npz(flat), "normal", "flat")]))
    some = [odd, *stored.ids]
    refused = ask(stored, some)
    assert refused.status_code == 422
    assert odd[:12] in refused.json()["detail"]
    answer = ask(stored, some, on_error="leave out")
    assert answer.headers["cases-left-out"] == "1"
    (left,) = answer.json()["left_out"]
    assert left["name"] == f"Sequence {odd[:12]}"
    assert left["reason"]
    assert answer.json()["cases"] == ask(stored, stored.ids).json()["cases"]
    stored.client.delete(f"/v1/sequences/{odd}")


@pytest.mark.parametrize(
    ("request_", "status", "code"),
    [
        ({"sequences": []}, 422, "bad_parameter"),
        ({"sequences": ["0" * 64]}, 404, "not_found"),
        ({"kind": "best"}, 422, "invalid_request"),
        ({"modes": 0}, 422, "invalid_request"),
        ({"topology": "ball"}, 422, "unsupported_topology"),
        ({"covariates": ["weight"]}, 422, "bad_parameter"),
        ({"nothing": 1}, 422, "invalid_request"),
    ],
)
def test_a_request_that_cannot_be_met_is_refused(
    stored: Cohort, request_: dict[str, Any], status: int, code: str
) -> None:
    answer = stored.client.post("/v1/features", json={"sequences": stored.ids[:2], **request_})
    assert (answer.status_code, answer.json()["code"]) == (status, code), answer.text


def test_a_sequence_named_twice_and_too_many_are_refused(stored: Cohort) -> None:
    twice = ask(stored, [stored.ids[0]] * 2)
    assert (twice.status_code, twice.json()["code"]) == (422, "bad_parameter")
    many = ask(stored, [f"{k:064x}" for k in range(1001)])
    assert (many.status_code, many.json()["code"]) == (413, "limit_exceeded")
    assert ask(stored, stored.ids, {"Accept": "image/png"}).status_code == 406
