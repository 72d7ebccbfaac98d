"""The table of jobs."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from modalmotion.errors import NotFoundError, ParameterError
from modalmotion.store import ResultStore
from modalmotion_service.schemas.general import JobState
from modalmotion_service.workspace.jobs import IdempotencyKeys, Job, Jobs

NAME = "Mustermann, Erika"


@pytest.fixture
def jobs(tmp_path: Path) -> Iterator[Jobs]:
    with ResultStore(tmp_path) as store:
        yield Jobs(store.database)


def test_a_job_goes_from_queued_to_finished_and_stays_there(jobs: Jobs) -> None:
    job = jobs.create("signature", {"modes": 7, "id": "ä"})
    assert jobs.get(job.id) == job
    assert (job.state, job.progress, job.is_finished) == (JobState.QUEUED, 0.0, False)
    assert jobs.update(job.id, state=JobState.RUNNING, progress=0.5)
    running = jobs.get(job.id)
    assert (running.state, running.progress, running.result) == (JobState.RUNNING, 0.5, None)
    assert running.request == {"modes": 7, "id": "ä"}
    assert running.updated >= job.updated
    assert jobs.update(job.id, state=JobState.SUCCEEDED, progress=1, result=["a", None])
    done = jobs.get(job.id)
    assert (done.result, done.error, done.is_finished) == (["a", None], None, True)
    assert not jobs.update(job.id, state=JobState.CANCELLED, error="late")
    assert jobs.get(job.id) == done


def test_of_a_result_and_a_cancellation_the_first_one_stands(jobs: Jobs) -> None:
    for _ in range(10):
        job = jobs.create("train", None)
        with ThreadPoolExecutor(2) as pool:
            won = [
                pool.submit(jobs.update, job.id, state=state)
                for state in (JobState.SUCCEEDED, JobState.CANCELLED)
            ]
        assert sorted(future.result() for future in won) == [False, True]
        expected = JobState.SUCCEEDED if won[0].result() else JobState.CANCELLED
        assert jobs.get(job.id).state == expected


def test_unfinished_jobs_are_there_after_a_restart_oldest_first(tmp_path: Path) -> None:
    with ResultStore(tmp_path) as store:
        jobs = Jobs(store.database)
        ids = [jobs.create("a", number).id for number in range(5)]
        jobs.update(ids[1], state=JobState.FAILED, error={"code": "x"})
        jobs.update(ids[2], state=JobState.RUNNING)
    with ResultStore(tmp_path) as store:
        jobs = Jobs(store.database)
        assert [job.request for job in jobs.unfinished()] == [0, 2, 3, 4]
        assert jobs.get(ids[1]).error == {"code": "x"}


def test_jobs_are_listed_newest_first_by_state_and_page(jobs: Jobs) -> None:
    ids = [jobs.create("a", number).id for number in range(7)]
    for job_id in ids[::2]:
        jobs.update(job_id, state=JobState.SUCCEEDED)

    def pages(state: JobState | None) -> list[object]:
        found: list[Job] = []
        cursor = None
        while True:
            page, cursor = jobs.list(state=state, limit=2, cursor=cursor)
            found += page
            if cursor is None:
                return [job.request for job in found]

    assert pages(None) == [6, 5, 4, 3, 2, 1, 0]
    assert pages(JobState.SUCCEEDED) == [6, 4, 2, 0]
    assert pages(JobState.QUEUED) == [5, 3, 1]
    assert pages(JobState.FAILED) == []
    with pytest.raises(ParameterError):
        jobs.list(cursor="?")


def test_an_unknown_job_is_not_found(jobs: Jobs) -> None:
    for call in (jobs.get, lambda name: jobs.update(name, progress=1.0)):
        with pytest.raises(NotFoundError):
            call("unknown")


def test_only_finished_jobs_are_forgotten_and_found_without_reading_all(jobs: Jobs) -> None:
    queued = jobs.create("signature", {"sequence_id": "ab"}).id
    done = jobs.create("signatures", {"ids": ["cd", "ab"]}).id
    jobs.update(done, state=JobState.FAILED, error={})
    sent = jobs.create("upload", {"file": "x"}).id
    jobs.update(sent, state=JobState.SUCCEEDED, result={"link": "/v1/sequences/ab"})
    jobs.create("upload", {"file": "ab"})
    found = {job.id for job in jobs.about("ab", "/v1/sequences/ab")}
    assert found == {queued, done, sent}
    jobs.forget(*found)
    assert {job.id for job in jobs.about("ab", "/v1/sequences/ab")} == {queued}


def test_no_query_reads_all_jobs_or_keys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with ResultStore(tmp_path) as store:
        jobs, _ = Jobs(store.database), IdempotencyKeys(store.database)
        connection = sqlite3.connect(tmp_path / "index.sqlite")
        asked: list[str] = []

        def explain(statement: str, values: tuple[object, ...] = ()) -> list[object]:
            asked.extend(
                row[3] for row in connection.execute(f"EXPLAIN QUERY PLAN {statement}", values)
            )
            return []

        monkeypatch.setattr(jobs._database, "read", explain)
        jobs.about("ab", "/v1/sequences/ab")
        jobs.with_files()
        location = "json_extract(response, '$.headers.location')"
        update = f"UPDATE idempotency SET status = 1 WHERE {location} = ? OR {location} >= ?"  # noqa: S608
        explain(update, ("a", "b"))
        connection.close()
    about = [step for step in asked if " jobs" in step or " idempotency" in step]
    assert len(about) == 7
    assert all("INDEX" in step for step in about), about


def test_no_list_look_up_or_number_reads_what_jobs_hold(
    jobs: Jobs, monkeypatch: pytest.MonkeyPatch
) -> None:
    job_id = jobs.create("signature", {}).id
    steps: list[str] = []
    read = jobs._database.read

    def explain(statement: str, values: tuple[object, ...] = ()) -> list[object]:
        steps.extend(row[3] for row in read(f"EXPLAIN QUERY PLAN {statement}", values))
        return read(statement, values)

    monkeypatch.setattr(jobs._database, "read", explain)
    jobs.list()
    jobs.list(state=JobState.FAILED)
    jobs.get(job_id)
    jobs.count()
    first, of_state, one, count = steps
    assert first.startswith("SEARCH jobs USING INDEX jobs_by_time ((created,id)<(?,?))")
    assert of_state.startswith("SEARCH jobs USING INDEX jobs_by_state (state=? AND")
    assert one.startswith("SEARCH jobs USING INDEX")
    assert count == "SCAN jobs USING COVERING INDEX jobs_by_kind"
    unfinished = "state NOT IN ('queued', 'running')"
    explain(f"SELECT 1 FROM jobs WHERE updated < ? AND {unfinished}", ("2026",))  # noqa: S608
    assert "finished_jobs (updated<?)" in steps[-1]


def test_numbers_of_jobs_follow_them(jobs: Jobs) -> None:
    ids = [jobs.create(kind, {}).id for kind in ("upload", "upload", "training")]
    queued, done = JobState.QUEUED, JobState.SUCCEEDED
    assert jobs.count() == {("upload", queued): 2, ("training", queued): 1}
    jobs.update(ids[0], progress=0.5)
    jobs.update(ids[0], state=done)
    jobs.update(ids[0], state=JobState.FAILED)
    assert jobs.count() == {
        ("upload", queued): 1,
        ("upload", done): 1,
        ("training", queued): 1,
    }
    jobs.forget(*ids)
    assert jobs.count() == {("upload", queued): 1, ("training", queued): 1}
    jobs.update(ids[1], state=done)
    assert jobs.forget_before("9999") == 1
    assert jobs.count() == {("training", queued): 1}


@pytest.mark.parametrize("state", [JobState.FAILED, JobState.SUCCEEDED, JobState.CANCELLED])
def test_a_finished_job_names_nobody(tmp_path: Path, state: JobState) -> None:
    with ResultStore(tmp_path) as store:
        jobs = Jobs(store.database)
        request = {"file": "x", "query": {"subject": NAME, "label": "rest", "unit": "mm"}}
        job = jobs.create("upload", request)
        jobs.update(job.id, state=JobState.RUNNING, progress=0.5)
        jobs.update(job.id, progress=0.7)
        # Taken up again after a crash, it needs them.
        assert jobs.get(job.id).request == request
        jobs.update(job.id, state=state)
        assert jobs.get(job.id).request == {"file": "x", "query": {"unit": "mm"}}
        for other in (7, None, ["subject"], {"modes": 7}):
            kept = jobs.create("other", other)
            jobs.update(kept.id, state=state)
            assert jobs.get(kept.id).request == other
    for path in tmp_path.rglob("*"):
        assert not path.is_file() or NAME.encode() not in path.read_bytes(), path
