"""A deleted sequence is gone from jobs, their files, kept answers, and the pages of the index."""

from __future__ import annotations

import asyncio
import sqlite3
from pathlib import Path

import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient
from job_requests import ASYNC, finished

from modalmotion.store import JobState, ResultStore
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
        job = state.store.jobs.create("tradeoff", {"sequence_id": sequence_id})
        asyncio.run(erase(state, sequence_id))
        assert client.get(f"/v1/jobs/{job.id}").status_code == 404
        assert state.store.jobs.count() == {}


def test_kept_answers_are_replaced_at_and_below_a_place_alone(tmp_path: Path) -> None:
    with ResultStore(tmp_path) as store:
        places = ("/v1/sequences/ab", "/v1/sequences/ab/classifications", "/v1/sequences/abc", None)
        for number, place in enumerate(places):
            headers = {} if place is None else {"location": place}
            store.idempotency.claim(str(number), "request")
            store.idempotency.complete(str(number), 201, {"body": "", "headers": headers})
        store.idempotency.claim("under way", "request")
        assert store.traces.replace_answers("/v1/sequences/ab", 404, {"body": "gone"}) == 2
        found = [store.idempotency.get(str(number)) for number in range(4)]
        assert [answer and answer.status for answer in found] == [404, 404, 201, 201]


def test_only_finished_jobs_are_forgotten_and_found_without_reading_all(tmp_path: Path) -> None:
    with ResultStore(tmp_path) as store:
        queued = store.jobs.create("signature", {"sequence_id": "ab"}).id
        done = store.jobs.create("signatures", {"ids": ["cd", "ab"]}).id
        store.jobs.update(done, state=JobState.FAILED, error={})
        sent = store.jobs.create("upload", {"file": "x"}).id
        store.jobs.update(sent, state=JobState.SUCCEEDED, result={"link": "/v1/sequences/ab"})
        store.jobs.create("upload", {"file": "ab"})
        found = {job.id for job in store.traces.jobs_about("ab", "/v1/sequences/ab")}
        assert found == {queued, done, sent}
        store.traces.forget_jobs(*found)
        assert {job.id for job in store.traces.jobs_about("ab", "/v1/sequences/ab")} == {queued}


def test_no_query_reads_all_jobs_or_keys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with ResultStore(tmp_path) as store:
        traces = store.traces
        connection = sqlite3.connect(tmp_path / "index.sqlite")
        asked: list[str] = []

        def explain(statement: str, values: tuple[object, ...] = ()) -> list[object]:
            asked.extend(
                row[3] for row in connection.execute(f"EXPLAIN QUERY PLAN {statement}", values)
            )
            return []

        monkeypatch.setattr(traces._database, "read", explain)
        traces.jobs_about("ab", "/v1/sequences/ab")
        traces.jobs_with_files()
        location = "json_extract(response, '$.headers.location')"
        update = f"UPDATE idempotency SET status = 1 WHERE {location} = ? OR {location} >= ?"  # noqa: S608
        explain(update, ("a", "b"))
        connection.close()
    about = [step for step in asked if " jobs" in step or " idempotency" in step]
    assert len(about) == 6
    assert all("INDEX" in step for step in about), about


@pytest.mark.parametrize("state", [JobState.FAILED, JobState.SUCCEEDED, JobState.CANCELLED])
def test_a_finished_job_names_nobody(tmp_path: Path, state: JobState) -> None:
    with ResultStore(tmp_path) as store:
        request = {"file": "x", "query": {"subject": NAME, "label": "rest", "unit": "mm"}}
        job = store.jobs.create("upload", request)
        store.jobs.update(job.id, state=JobState.RUNNING, progress=0.5)
        store.jobs.update(job.id, progress=0.7)
        # Taken up again after a crash, it needs them.
        assert store.jobs.get(job.id).request == request
        store.jobs.update(job.id, state=state)
        assert store.jobs.get(job.id).request == {"file": "x", "query": {"unit": "mm"}}
        for other in (7, None, ["subject"], {"modes": 7}):
            kept = store.jobs.create("other", other)
            store.jobs.update(kept.id, state=state)
            assert store.jobs.get(kept.id).request == other
    for path in tmp_path.rglob("*"):
        assert not path.is_file() or NAME.encode() not in path.read_bytes(), path
