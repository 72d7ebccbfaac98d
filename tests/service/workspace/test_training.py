"""Trainings that outlive their service, run into limits, and keep nobody waiting."""

from __future__ import annotations

import asyncio
import json
import pickle
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from running import RunningService
from training_cohort import QUICK, cohort, finished, send

from modalmotion.classification import CaseFile
from modalmotion.errors import NotFoundError
from modalmotion.formats import read_npz
from modalmotion.progress import Progress, Reporter
from modalmotion.signature.making import modal_signature
from modalmotion.store import ResultStore, model_from_hdf5, signature_to_hdf5
from modalmotion.store.database import Database
from modalmotion_service.app import create_app
from modalmotion_service.schemas.general import JobState
from modalmotion_service.schemas.queries import LabelledSequence
from modalmotion_service.settings import Settings
from modalmotion_service.workspace.job_runner import JobRunner
from modalmotion_service.workspace.jobs import Job, Jobs
from modalmotion_service.workspace.training import find_cases


@pytest.fixture
def service(tmp_path: Path) -> Iterator[RunningService]:
    running = RunningService(tmp_path / "results", {"WORKERS": "2", "DRAIN_SECONDS": "0"})
    yield running
    running.stop()


def sent_to(service: RunningService, n_per_class: int) -> list[str]:
    ids = []
    for case in cohort(n_per_class, seed=5):
        # Spaces in names are written as the form of queries does.
        query = f"label={case.label}&subject={case.subject}".replace(" ", "+")
        answer = service.request("POST", f"/v1/sequences?{query}", case.body)
        assert answer.status == 201, answer.body
        ids.append(answer.json["id"])
    return ids


def wait_until(service: RunningService, link: str, states: set[str]) -> Any:
    for _ in range(2400):
        job = service.request("GET", link).json
        if job["state"] in states:
            return job
        time.sleep(0.02)
    raise AssertionError(job)


@pytest.mark.parametrize("end", ["kill", pytest.param("terminate", marks=pytest.mark.soak)])
def test_a_training_is_taken_up_again_after_a_restart(service: RunningService, end: str) -> None:
    service.start()
    ids = sent_to(service, 4)
    body = json.dumps({"name": "survivor", "sequences": ids, "options": QUICK}).encode()
    kind = {"Content-Type": "application/json"}
    answer = service.request("POST", "/v1/models", body, kind)
    assert answer.status == 202, answer.body
    link = answer.headers["location"]
    job = wait_until(service, link, {"running"})
    getattr(service, end)()
    service.start()
    job = wait_until(service, link, {"succeeded", "failed", "cancelled"})
    assert job["state"] == "succeeded", job["error"]
    assert job["result"] == "/v1/models/survivor@1"
    model = service.request("GET", "/v1/models/survivor").json
    assert model["versions"] == [1]
    assert list((service.data_dir / "spool").iterdir()) == []
    here = f"/v1/signatures/{ids[0]}/classifications"
    said = service.request("POST", here, b'{"model": "survivor"}', kind)
    assert said.status == 201
    if end == "terminate":
        return
    # The model is read from its file by a service that did not train it.
    service.kill()
    service.start()
    assert service.request("POST", here, b'{"model": "survivor@1"}', kind).json == said.json
    other = f"/v1/signatures/{ids[1]}/classifications"
    assert service.request("POST", other, b'{"model": "survivor"}', kind).status == 201


def test_a_training_that_takes_too_long_is_ended_and_says_which_limit(tmp_path: Path) -> None:
    # Importing scikit-learn alone takes longer than this.
    settings = Settings(data_dir=tmp_path / "r", workers=2, training_seconds=0.01)
    with TestClient(create_app(settings)) as client:
        ids = send(client, cohort(2, seed=3))
        answer = client.post("/v1/models", json={"name": "slow", "sequences": ids})
        job = finished(client, answer.json())
        assert job["state"] == "failed"
        assert job["error"]["code"] == "limit_exceeded"
        assert job["error"]["limit"] == "training_seconds"
        assert client.get("/v1/limits").json()["training_seconds"] == 0.01
        assert client.get("/v1/models/slow").status_code == 404


def test_more_sequences_than_a_model_may_have_are_refused(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path / "r", max_training_sequences=3)
    with TestClient(create_app(settings)) as client:
        body = {"name": "large", "sequences": [f"{n:064x}" for n in range(4)]}
        answer = client.post("/v1/models", json=body)
        assert (answer.status_code, answer.json()["limit"]) == (413, "training_sequences")
        assert client.get("/v1/limits").json()["training_sequences"] == 3


def test_ten_thousand_sequences_are_looked_up_in_a_moment(tmp_path: Path) -> None:
    # Of which none is kept: the answer names some, and how many there are.
    with TestClient(create_app(Settings(data_dir=tmp_path / "r"))) as client:
        body = {"name": "large", "sequences": [f"{n:064x}" for n in range(10_000)]}
        answer = client.post("/v1/models", json=body)
        assert (answer.status_code, answer.json()["n_sequences"]) == (404, 10_000)
        assert len(answer.content) < 5_000


def test_a_long_kind_of_job_keeps_the_others_from_waiting(tmp_path: Path) -> None:
    order: list[str] = []

    async def check(store: ResultStore) -> None:
        release = asyncio.Event()

        async def long(request: Any, _: Reporter) -> None:
            order.append(f"long {request}")
            await release.wait()

        async def short(request: Any, report: Reporter) -> None:
            report(Progress(0.5, stage="half of it"))
            order.append(f"short {request}")

        kinds = {"long": long, "short": short}

        class Runner(JobRunner):
            async def do(self, job: Job, report: Reporter) -> Any:
                await kinds[job.kind](job.request, report)

        table = Jobs(store.database)
        runner = Runner(table, 1, 100, {"long": 1})
        jobs = [await runner.start("long", number) for number in range(3)]
        jobs += [await runner.start("short", number) for number in range(3)]
        while len(order) < 4:
            await asyncio.sleep(0.01)
        await asyncio.sleep(0.05)
        assert sorted(order) == ["long 0", "short 0", "short 1", "short 2"]
        assert table.get(jobs[1].id).state == JobState.QUEUED
        release.set()
        await runner.close(10.0)
        assert {table.get(job.id).state for job in jobs} == {JobState.SUCCEEDED}
        assert runner._texts == {}

    with ResultStore(tmp_path) as store:
        asyncio.run(asyncio.wait_for(check(store), 30))


def peak_memory(folder: Path, n_cases: int) -> int:
    """Peak memory, in bytes, of a process that trains on so many signatures."""
    labelled = [(read_npz(c.body).sequence, c.label) for c in cohort(10, seed=3)]
    signatures = [(modal_signature(sequence), label) for sequence, label in labelled]
    cases = []
    for number in range(n_cases):
        signature, label = signatures[number % len(signatures)]
        # A little larger each time, for the same recording again would count once.
        amplitudes = signature.amplitudes * (1.0 + 1e-4 * number)
        name, path = f"{number:064x}", folder / f"{number}.h5"
        other = replace(signature, amplitudes=amplitudes, sequence_id=name)
        path.write_bytes(signature_to_hdf5(other))
        cases.append(CaseFile(path, name, label, f"s{number}"))
    listed = folder / f"cases-{n_cases}"
    listed.write_bytes(pickle.dumps(cases))
    code = (
        "import pickle, resource, sys; from pathlib import Path;"
        "from modalmotion_service.work.tasks.training import train_model;"
        "a, b, c = map(Path, sys.argv[1:]);"
        "cases = pickle.loads(a.read_bytes());"
        "train_model(cases, None, 'large', {'card': 'quick'}, 't', b, None, 1, c);"
        "sys.stdout.write(str(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024))"
    )
    files = [listed, folder / "model.h5", folder / "progress"]
    run = [sys.executable, "-c", code, *map(str, files)]
    done = subprocess.run(run, capture_output=True, text=True, check=True)
    assert sum(model_from_hdf5(files[1]).card.n_cases.values()) == n_cases
    return int(done.stdout)


@pytest.mark.soak
@pytest.mark.timeout(900)
def test_a_training_takes_some_kilobytes_a_sequence(tmp_path: Path) -> None:
    few, many = 1_000, 4_000
    small, large = (peak_memory(tmp_path, n) for n in (few, many))
    # Features and the matrices of the fit, whatever the frames and vertices.
    assert large - small < 30e3 * (many - few), f"peaks of {small} and {large} bytes"


def test_unknown_sequences_are_found_in_one_query(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []
    read = Database.read

    def counted(self: Database, *args: Any) -> Any:
        asked.append(args[0])
        return read(self, *args)

    with ResultStore(tmp_path) as store:
        store.count()
        monkeypatch.setattr(Database, "read", counted)
        cases = [LabelledSequence(id=f"{n:064x}", label="a") for n in range(5_000)]
        with pytest.raises(NotFoundError, match="5000 sequences are not kept here"):
            find_cases(store, cases, 10_000, "training_sequences")
    assert len([one for one in asked if "FROM sequences" in one]) == 1
