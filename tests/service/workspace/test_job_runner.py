"""Long work as jobs."""

from __future__ import annotations

import io
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from clouds import small_recording
from fastapi.testclient import TestClient
from job_requests import ASYNC, finished

from modalmotion.formats import read_npz, write_npz
from modalmotion.mesh.sequence import mesh_sequence
from modalmotion.progress import Progress, Reporter
from modalmotion.simulate import Acquisition, simulate_ventricle
from modalmotion_service.workspace.job_runner import JobRunner
from modalmotion_service.workspace.jobs import Job


@pytest.fixture(scope="module")
def client(engine_client: TestClient) -> TestClient:
    return engine_client


@pytest.fixture(scope="module")
def data_dir(engine_data_dir: Path) -> Path:
    return engine_data_dir


def test_an_upload_can_be_left_to_a_job(client: TestClient, beat: bytes) -> None:
    answer = client.post("/v1/sequences", content=beat, headers=ASYNC)
    assert answer.status_code == 202
    assert answer.headers["preference-applied"] == "respond-async"
    assert answer.headers["location"] == answer.json()["links"]["self"]
    job = finished(client, answer.json())
    assert (job["state"], job["progress"]) == ("succeeded", 1.0)
    assert job["result"] == f"/v1/sequences/{read_npz(beat).sequence.id}"
    assert client.get(job["result"]).status_code == 200


def test_a_job_that_fails_keeps_the_problem(client: TestClient) -> None:
    answer = client.post("/v1/sequences", content=b"nonsense", headers=ASYNC)
    job = finished(client, answer.json())
    assert job["state"] == "failed"
    assert (job["error"]["code"], job["error"]["status"]) == ("malformed_file", 400)
    assert job["error"]["remedy"]
    assert job["result"] is None


def test_a_signature_can_be_left_to_a_job(client: TestClient, beat: bytes) -> None:
    here = client.post("/v1/sequences", content=beat).headers["location"]
    answer = client.post(f"{here}/signatures", json={"modes": 18, "topology": "cup"}, headers=ASYNC)
    assert answer.status_code == 202
    job = finished(client, answer.json())
    assert client.get(job["result"]).json()["shape"][1] == 18


def test_work_that_takes_longer_than_the_client_waits_becomes_a_job(
    client: TestClient, beat: bytes
) -> None:
    answer = client.post("/v1/sequences", content=beat, headers={"Prefer": "wait=0"})
    assert answer.status_code == 202
    assert finished(client, answer.json())["state"] == "succeeded"


def test_many_signatures_come_in_one_answer(client: TestClient, beat: bytes) -> None:
    sequence = read_npz(beat).sequence
    ids = []
    for shift in range(3):
        buffer = io.BytesIO()
        frames = sequence.vertices[shift:]
        np.savez(buffer, vertices=frames, grid=(8, 16), topology="cup")
        ids.append(client.post("/v1/sequences", content=buffer.getvalue()).json()["id"])
    answer = client.post("/v1/signatures/query", json={"ids": ids, "modes": 7})
    assert answer.headers["content-type"] == "application/x-npz"
    packed = np.load(io.BytesIO(answer.content), allow_pickle=False)
    assert packed["ids"].tolist() == ids
    for number, sequence_id in enumerate(ids):
        own = client.get(f"/v1/sequences/{sequence_id}/signature").json()
        assert np.array_equal(packed[f"amplitudes_{number}"], np.array(own["amplitudes"]))
    job = client.post("/v1/signatures/query", json={"ids": ids}, headers=ASYNC).json()
    done = finished(client, job)
    assert client.get(done["result"]).content == answer.content
    hdf5 = client.post(
        "/v1/signatures/query", json={"ids": ids}, headers={"Accept": "application/x-hdf5"}
    )
    assert hdf5.content.startswith(b"\x89HDF")


def test_a_finished_job_cannot_be_cancelled(client: TestClient, beat: bytes) -> None:
    job = client.post("/v1/sequences", content=beat, headers=ASYNC).json()
    finished(client, job)
    answer = client.delete(job["links"]["self"])
    assert (answer.status_code, answer.json()["code"]) == (409, "conflict")


def test_a_job_can_be_cancelled(
    client: TestClient, beat: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    import asyncio

    from modalmotion_service.workspace.analysis import Analysis

    async def endless(*_: object, **__: object) -> None:
        await asyncio.sleep(3600)

    monkeypatch.setattr(Analysis, "followed", endless)
    job = client.post("/v1/sequences", content=beat, headers=ASYNC).json()
    for _ in range(100):
        if client.get(job["links"]["self"]).json()["state"] == "running":
            break
        time.sleep(0.02)
    answer = client.delete(job["links"]["self"])
    assert (answer.status_code, answer.json()["state"]) == (200, "cancelled")
    assert client.get(job["links"]["self"]).json()["state"] == "cancelled"


def test_jobs_are_listed_from_the_newest(client: TestClient, beat: bytes) -> None:
    jobs = [client.post("/v1/sequences", content=beat, headers=ASYNC).json() for _ in range(3)]
    for job in jobs:
        finished(client, job)
    page = client.get("/v1/jobs", params={"limit": 2}).json()
    assert [job["id"] for job in page["jobs"]] == [jobs[2]["id"], jobs[1]["id"]]
    rest = client.get("/v1/jobs", params={"cursor": page["cursor"]}).json()
    assert rest["jobs"][0]["id"] == jobs[0]["id"]
    failed = client.get("/v1/jobs", params={"state": "failed"}).json()["jobs"]
    assert not {job["id"] for job in failed} & {job["id"] for job in jobs}


@pytest.mark.parametrize("path", ["/v1/jobs/" + "0" * 32, "/v1/jobs/" + "0" * 32 + "/result"])
def test_an_unknown_job_is_not_found(client: TestClient, path: str) -> None:
    assert client.get(path).status_code == 404
    assert client.delete("/v1/jobs/" + "0" * 32).status_code == 404


def test_the_spool_is_empty_when_everything_is_done(
    client: TestClient, beat: bytes, data_dir: Path
) -> None:
    spool = data_dir / "spool"
    # Results that are there to be fetched, and what the cancelled job would have read.
    before = set(spool.iterdir())
    finished(client, client.post("/v1/sequences", content=beat, headers=ASYNC).json())
    here = client.post("/v1/sequences", content=beat).headers["location"]
    client.get(f"{here}/signature")
    client.post("/v1/sequences", content=b"nonsense")
    finished(client, client.post("/v1/sequences", content=b"nonsense", headers=ASYNC).json())
    for _ in range(200):
        if set(spool.iterdir()) == before:
            break
        time.sleep(0.02)
    assert set(spool.iterdir()) == before


def test_a_finished_job_says_nothing_of_what_it_did_last(client: TestClient, beat: bytes) -> None:
    job = finished(client, client.post("/v1/sequences", content=beat, headers=ASYNC).json())
    # Noted as finished by the store a moment before its last words are taken away.
    client.app.state.owners.local.runner._texts[job["id"]] = "last words"  # type: ignore[attr-defined]
    assert client.get(job["links"]["self"]).json()["text"] is None
    listed = {item["id"]: item for item in client.get("/v1/jobs").json()["jobs"]}
    assert listed[job["id"]]["text"] is None


def test_the_progress_of_every_kind_of_job_moves_and_never_falls(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: dict[str, list[Progress]] = {}
    reporter = JobRunner._reporter

    def recorded(self: JobRunner, job: Job) -> Reporter:
        report = reporter(self, job)

        def tell(progress: Progress) -> None:
            told.setdefault(job.id, []).append(progress)
            report(progress)

        return tell

    monkeypatch.setattr(JobRunner, "_reporter", recorded)
    # Of its own, so that nothing of it is known yet; small, for all that is told is reported.
    beat_of_few = simulate_ventricle(
        grid=(8, 16), acquisition=Acquisition(n_frames=9), rng=np.random.default_rng(5)
    )
    moved = mesh_sequence(beat_of_few.vertices, beat_of_few.faces, unit="mm")
    upload = client.post("/v1/sequences", content=write_npz(moved), headers=ASYNC)
    jobs = [finished(client, upload.json())]
    here = jobs[0]["result"]
    usual = here.replace("sequences", "signatures")
    for method, path, body in (
        ("POST", f"{here}/signatures", {"modes": 5}),
        ("POST", f"{here}/tradeoff", {"front_modes": 5}),
        ("POST", f"{usual}/classifications", {}),
        ("GET", f"{here}/encoded?rms=2", None),
    ):
        answer = client.request(method, path, json=body, headers=ASYNC)
        assert answer.status_code == 202, answer.text
        jobs.append(finished(client, answer.json()))
    answer = client.post("/v1/templates", content=write_npz(moved), headers=ASYNC)
    jobs.append(finished(client, answer.json()))
    cloud = small_recording(3)
    answer = client.post("/v1/tracks?modes=4", content=cloud, headers=ASYNC)
    jobs.append(finished(client, answer.json()))
    several = {"ids": [moved.id], "modes": 4}
    answer = client.post("/v1/signatures/query", json=several, headers=ASYNC)
    jobs.append(finished(client, answer.json()))
    for job in jobs:
        assert (job["state"], job["progress"]) == ("succeeded", 1.0), job
        shares = [progress.share for progress in told[job["id"]]]
        # A small surface is encoded before anybody looks.
        is_told = any(0 < share < 1 for share in shares)
        assert is_told or job["kind"] == "encoding", (job["kind"], shares)
        assert all(a <= b for a, b in pairwise(shares)), (job["kind"], shares)
