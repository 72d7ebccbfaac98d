"""A deleted sequence is gone from jobs, their files, kept answers, and the pages of the index."""

from __future__ import annotations

import asyncio
import contextlib
import json
import sqlite3
from pathlib import Path

import pytest
from access_parts import guarded
from fastapi import FastAPI
from fastapi.testclient import TestClient
from job_requests import ASYNC, finished

from modalmotion_service.app import create_app
from modalmotion_service.settings import Settings
from modalmotion_service.workspace.recording_operations import erase

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
            client.post(f"{link}/signatures", headers=ASYNC).json(),
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
        # While it is open too: the log is merged into the file, and what was free is overwritten.
        assert files_with(folder, NAME) == []
    assert files_with(folder, NAME) == []


def files_with(folder: Path, *texts: str) -> list[Path]:
    """Files that hold one of the texts, as text or in JSON."""
    wanted = {text.encode() for text in texts} | {json.dumps(text)[1:-1].encode() for text in texts}
    contents = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    return [path for path in contents if any(text in contents[path] for text in wanted)]


def test_of_names_nothing_is_left_in_any_file_while_the_service_idles(
    tmp_path: Path, beat: bytes
) -> None:
    names = ["Zebedäus A", "Zebedäus B", "Zebedäus C", "Zebedäus-Q"]
    with guarded(tmp_path / "results") as service:
        link = service.ask(
            "lab",
            "POST",
            f"/v1/sequences?subject={names[0]}&label={names[1]}",
            content=beat,
            headers={"Idempotency-Key": names[3].replace("ä", "ae")},
        ).json()["links"]["self"]
        folder = tmp_path / "results"
        # A client's own key is kept as a digest from the beginning.
        assert files_with(folder, names[3].replace("ä", "ae")) == []
        for name in names[1:3]:
            changed = service.ask("lab", "PATCH", link, json={"subject": name, "label": None})
            assert changed.json()["subject"] == name
            assert files_with(folder, names[0]) == []
        assert files_with(folder, names[1]) == []
        assert files_with(folder, names[2])
        assert service.ask("lab", "DELETE", link).status_code == 204
        assert files_with(folder, *names, "Zebed") == []


def test_what_another_process_reads_is_cut_from_the_log_with_the_next_deletion(
    tmp_path: Path, beat: bytes
) -> None:
    with TestClient(create_app(Settings(data_dir=tmp_path, workers=1))) as client:
        one, other = (
            client.post(f"/v1/sequences?subject={NAME}&unit={unit}", content=beat).json()
            for unit in ("mm", "cm")
        )
        with contextlib.closing(sqlite3.connect(tmp_path / "index.sqlite")) as reader:
            rows = reader.execute("SELECT id FROM sequences")
            rows.fetchone()
            assert client.delete(one["links"]["self"]).status_code == 204
            assert files_with(tmp_path, NAME)
            rows.close()
        assert client.delete(other["links"]["self"]).status_code == 204
        assert files_with(tmp_path, NAME) == []


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
