"""A deleted sequence is gone from jobs, their files, kept answers, and the pages of the index."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient
from job_requests import ASYNC, finished

from modalmotion_service.app import create_app
from modalmotion_service.settings import Settings
from modalmotion_service.workspace.erasure import erase

NAME = "Mustermann, Erika"


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    return Settings(data_dir=tmp_path, workers=1, wait_seconds=120.0)


def test_nothing_tells_of_a_deleted_sequence(settings: Settings, beat: bytes) -> None:
    folder, key = settings.data_dir, {"Idempotency-Key": "first"}
    with TestClient(create_app(settings)) as client:
        upload = client.post(f"/v1/sequences?subject={NAME}", content=beat, headers=ASYNC).json()
        finished(client, upload)
        (kept,) = client.get("/v1/sequences").json()["sequences"]
        link, sequence_id = kept["links"]["self"], kept["id"]
        client.post(f"/v1/sequences?subject={NAME}", content=beat, headers=key)
        ids = {"ids": [sequence_id]}
        jobs = [
            client.post("/v1/signatures/query", json=ids, headers=ASYNC).json(),
            client.get(f"{link}/encoded?rms=0.5", headers=ASYNC).json(),
            client.get(f"{link}/signature", headers=ASYNC).json(),
        ]
        results = [finished(client, job)["result"] for job in jobs]
        assert [client.get(result).status_code for result in results] == [200, 200, 200]
        assert len(list((folder / "spool").iterdir())) == 2
        assert client.delete(link).status_code == 204
        assert list((folder / "spool").iterdir()) == []
        for job in (upload, *jobs):
            assert client.get(job["links"]["self"]).status_code == 404
        for result in results:
            assert client.get(result).status_code == 404
        # Sent again by a client that knows nothing of the deletion.
        again = client.post(f"/v1/sequences?subject={NAME}", content=beat, headers=key)
        assert (again.status_code, again.json()["code"]) == (404, "not_found")
        assert again.headers["content-type"] == "application/problem+json"
        assert client.get("/v1/sequences").json()["sequences"] == []
        assert client.post("/v1/sequences", content=beat).status_code == 201
    # Closed, the log is merged into the file; what was free in it was overwritten.
    for path in folder.rglob("*"):
        if path.is_file():
            assert NAME.encode() not in path.read_bytes(), path


def test_jobs_of_others_and_what_they_made_stay(settings: Settings, beat: bytes) -> None:
    with TestClient(create_app(settings)) as client:
        ids = []
        for factor in ("mm", "cm"):
            answer = client.post(f"/v1/sequences?unit={factor}", content=beat)
            ids.append(answer.json()["id"])
        assert len(set(ids)) == 2
        asked = [
            client.post("/v1/signatures/query", json={"ids": chosen}, headers=ASYNC).json()
            for chosen in ([ids[1]], ids)
        ]
        results = [finished(client, job)["result"] for job in asked]
        assert client.delete(f"/v1/sequences/{ids[0]}").status_code == 204
        # The file of both has the deleted one, too.
        assert [client.get(result).status_code for result in results] == [200, 404]


def test_a_job_under_way_is_ended_with_its_sequence(settings: Settings, beat: bytes) -> None:
    app: FastAPI = create_app(settings)
    with TestClient(app) as client:
        sequence_id = client.post("/v1/sequences", content=beat).json()["id"]
        state = app.state.owners.local
        job = state.jobs.create("tradeoff", {"sequence_id": sequence_id})
        asyncio.run(erase(state, sequence_id))
        assert client.get(f"/v1/jobs/{job.id}").status_code == 404
        assert state.jobs.count() == {}
