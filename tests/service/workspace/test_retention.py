"""Files that jobs have made are kept for a while, and then removed."""

from __future__ import annotations

import os
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from job_requests import ASYNC, finished

from modalmotion.store import ResultStore
from modalmotion.store.index import to_text
from modalmotion_service.app import create_app
from modalmotion_service.schemas.general import JobState
from modalmotion_service.settings import Settings
from modalmotion_service.workspace.job_runner import Retention
from modalmotion_service.workspace.jobs import IdempotencyKeys, Jobs
from modalmotion_service.workspace.spool import Spool


def made(store: ResultStore, spool: Spool, name: str) -> str:
    jobs = Jobs(store.database)
    job = jobs.create("signatures", {})
    spool.at(name).write_text("result")
    jobs.update(job.id, state=JobState.SUCCEEDED, result={"file": name, "media_type": "text/plain"})
    return job.id


def keeping(
    store: ResultStore, spool: Spool, file_seconds: float, job_seconds: float = 3600.0
) -> Retention:
    ages = (timedelta(seconds=seconds) for seconds in (file_seconds, job_seconds))
    tables = Jobs(store.database), IdempotencyKeys(store.database)
    return Retention(*tables, spool, store.root, file_age=next(ages), job_age=next(ages))


def half_an_hour_ago() -> str:
    return to_text((datetime.now(UTC) - timedelta(minutes=30)).timestamp())


def test_only_files_whose_time_has_passed_are_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with ResultStore(tmp_path) as store:
        jobs, spool = Jobs(store.database), Spool(tmp_path / "spool")
        upload = jobs.create("upload", {"file": "upload"})
        spool.at("upload").write_text("bytes")
        with monkeypatch.context() as earlier:
            earlier.setattr("modalmotion_service.workspace.jobs.now", half_an_hour_ago)
            made(store, spool, "old")
        made(store, spool, "new")
        retention = keeping(store, spool, 900.0)
        assert retention.needed() == {"new", "upload"}
        assert retention.sweep() == 1
        assert {path.name for path in spool.folder.iterdir()} == {"new", "upload"}
        assert retention.sweep() == 0
        assert keeping(store, spool, 3600.0).needed() == {"old", "new", "upload"}
        assert not jobs.get(upload.id).is_finished


def test_what_nobody_needs_goes_after_a_day(tmp_path: Path) -> None:
    """A cancelled task on another machine wrote its file when it had been removed already."""
    with ResultStore(tmp_path) as store:
        spool = Spool(tmp_path / "spool")
        Jobs(store.database).create("upload", {"file": "upload"})
        for name in ("upload", "left", "left.abc", "new"):
            spool.at(name).write_text("bytes")
            os.utime(spool.at(name), None if name == "new" else (time.time() - 90_000,) * 2)
        keeping(store, spool, 3600.0).sweep()
        assert {path.name for path in spool.folder.iterdir()} == {"upload", "new"}


def test_the_results_of_all_jobs_are_kept(tmp_path: Path) -> None:
    with ResultStore(tmp_path) as store:
        spool = Spool(tmp_path / "spool")
        names = {made(store, spool, f"f{n}") and f"f{n}" for n in range(20)}
        assert keeping(store, spool, 60.0).needed() == names


def test_finished_jobs_and_keys_are_forgotten_but_none_that_has_work_or_a_file(
    tmp_path: Path,
) -> None:
    with ResultStore(tmp_path) as store:
        jobs, keys = Jobs(store.database), IdempotencyKeys(store.database)
        spool = Spool(tmp_path / "spool")
        queued = jobs.create("upload", {"file": "upload"}).id
        failed = jobs.create("upload", {}).id
        jobs.update(failed, state=JobState.FAILED, error={})
        succeeded = made(store, spool, "file")
        keys.claim("key", "request")
        time.sleep(0.05)
        keeping(store, spool, 3600.0, 0.01).sweep()
        assert jobs.get(failed).is_finished
        keeping(store, spool, 0.01, 3600.0).sweep()
        assert jobs.get(succeeded).is_finished
        keeping(store, spool, 0.01, 0.01).sweep()
        assert [job.id for job in jobs.list()[0]] == [queued]
        assert keys.forget_before("9999") == 0


def test_a_running_service_removes_them_by_itself(tmp_path: Path, beat: bytes) -> None:
    settings = Settings(data_dir=tmp_path, workers=1, wait_seconds=120.0, result_hours=1 / 3600)
    with TestClient(create_app(settings)) as client:
        sequence_id = client.post("/v1/sequences", content=beat).json()["id"]
        job = client.post("/v1/signatures/query", json={"ids": [sequence_id]}, headers=ASYNC).json()
        link = finished(client, job)["result"]
        for _ in range(200):
            answer = client.get(link)
            if answer.status_code == 404:
                break
            time.sleep(0.05)
        assert "no longer kept" in answer.json()["detail"]
        assert list((tmp_path / "spool").iterdir()) == []
