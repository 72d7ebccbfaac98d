"""What was acknowledged and is gone is said to be lost, which is not deleted."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from job_requests import ASYNC, finished
from signing import signed

ROUTES = (
    ("GET", "sequences/{}/signature"),
    ("POST", "sequences/{}/signatures"),
    ("POST", "sequences/{}/tradeoff"),
    ("GET", "sequences/{}/encoded?rms=0.5"),
    ("GET", "signatures/{}"),
    ("GET", "signatures/{}/readouts"),
    ("GET", "signatures/{}/reconstruction"),
    ("POST", "signatures/{}/classifications"),
)


@pytest.fixture(scope="module")
def client(shared_client: TestClient) -> TestClient:
    return shared_client


@pytest.fixture
def lost(client: TestClient, beat: bytes, shared_data_dir: Path) -> str:
    """The address of a sequence whose vertices were removed by somebody else."""
    answer = client.post("/v1/sequences", content=beat).json()
    here = f"/v1/sequences/{answer['id']}"
    for path in shared_data_dir.glob(f"*/*/{answer['id']}*.h5"):
        path.unlink()
    return here


def assert_lost(problem: dict[str, Any]) -> None:
    assert (problem["status"], problem["code"]) == (409, "lost_file"), problem
    assert problem["type"] == "urn:modalmotion:problem:lost_file"
    assert "lost" in problem["detail"]


@pytest.mark.parametrize(("method", "path"), ROUTES, ids=[path for _, path in ROUTES])
def test_lost_vertices_are_said_by_every_route(
    client: TestClient, lost: str, method: str, path: str, beat: bytes
) -> None:
    here = f"/v1/{path.format(lost.rpartition('/')[2])}"
    answer = client.request(method, here)
    assert answer.status_code == 409
    assert_lost(answer.json())
    job = client.request(method, here, headers=ASYNC)
    if job.status_code == 202:
        assert_lost(finished(client, job.json())["error"])
    else:
        assert_lost(job.json())
    # As the remedy says.
    assert answer.json()["remedy"].startswith("Send the sequence again")
    assert client.post("/v1/sequences", content=beat).status_code == 200
    if "encoded" not in path:
        again = client.request(method, here)
        assert again.status_code in (200, 201), again.text


def test_many_signatures_and_a_training_name_the_one_that_is_lost(
    client: TestClient, lost: str
) -> None:
    name = lost.rpartition("/")[2]
    assert_lost(client.post("/v1/signatures/query", json={"ids": [name]}).json())


def test_what_does_not_need_them_is_answered(client: TestClient, lost: str) -> None:
    assert client.get(lost).status_code == 200
    assert client.patch(lost, json={"label": "a"}).status_code == 200
    assert client.delete(lost).status_code == 204
    assert client.get(f"{lost}/signature").status_code == 404


def test_a_lost_signature_or_classification_is_made_again(
    client: TestClient, beat: bytes, shared_data_dir: Path
) -> None:
    name = client.post("/v1/sequences", content=beat).json()["id"]
    here = signed(client, name).rpartition("-")[0]
    first = client.post(f"{here}/classifications")
    assert first.status_code == 201
    for kind in ("signatures", "classifications"):
        for path in shared_data_dir.glob(f"{kind}/*/{name}*.h5"):
            path.unlink()
    assert_lost(client.get(f"{here}/classifications").json())
    again = client.post(f"{here}/classifications")
    assert (again.status_code, again.json()) == (201, first.json())
    assert client.get(f"{here}/classifications").status_code == 200
    assert client.get(here).status_code == 200


def test_a_lost_file_of_a_job_is_said(client: TestClient, beat: bytes) -> None:
    name = client.post("/v1/sequences", content=beat).json()["id"]
    job = client.post("/v1/signatures/query", json={"ids": [name]}, headers=ASYNC).json()
    link = finished(client, job)["result"]
    state = client.app.state.owners.local  # type: ignore[attr-defined]
    state.spool.remove(state.jobs.get(job["id"]).result["file"])
    assert_lost(client.get(link).json())


def test_an_upload_that_is_lost_before_it_is_read_fails_its_job_by_name(
    client: TestClient, beat: bytes
) -> None:
    state = client.app.state.owners.local  # type: ignore[attr-defined]
    assert client.portal is not None
    job = client.portal.call(state.runner.start, "upload", {"name": "upload", "file": "gone"})
    ended = finished(client, client.get(f"/v1/jobs/{job.id}").json())
    assert_lost(ended["error"])
