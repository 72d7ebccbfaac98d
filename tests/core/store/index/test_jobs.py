from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from modalmotion.errors import CorruptFileError, NotFoundError, ParameterError, StoreError
from modalmotion.store import Job, JobState, ResultStore
from modalmotion.store.index.database import SCHEMA_VERSION, Database


@pytest.fixture
def store(tmp_path: Path) -> Iterator[ResultStore]:
    with ResultStore(tmp_path) as opened:
        yield opened


def test_a_job_goes_from_queued_to_finished_and_stays_there(store: ResultStore) -> None:
    job = store.jobs.create("signature", {"modes": 7, "id": "ä"})
    assert store.jobs.get(job.id) == job
    assert (job.state, job.progress, job.is_finished) == (JobState.QUEUED, 0.0, False)
    assert store.jobs.update(job.id, state=JobState.RUNNING, progress=0.5)
    running = store.jobs.get(job.id)
    assert (running.state, running.progress, running.result) == (JobState.RUNNING, 0.5, None)
    assert running.request == {"modes": 7, "id": "ä"}
    assert running.updated >= job.updated
    assert store.jobs.update(job.id, state=JobState.SUCCEEDED, progress=1, result=["a", None])
    done = store.jobs.get(job.id)
    assert (done.result, done.error, done.is_finished) == (["a", None], None, True)
    assert not store.jobs.update(job.id, state=JobState.CANCELLED, error="late")
    assert store.jobs.get(job.id) == done


def test_of_a_result_and_a_cancellation_the_first_one_stands(store: ResultStore) -> None:
    for _ in range(10):
        job = store.jobs.create("train", None)
        with ThreadPoolExecutor(2) as pool:
            won = [
                pool.submit(store.jobs.update, job.id, state=state)
                for state in (JobState.SUCCEEDED, JobState.CANCELLED)
            ]
        assert sorted(future.result() for future in won) == [False, True]
        expected = JobState.SUCCEEDED if won[0].result() else JobState.CANCELLED
        assert store.jobs.get(job.id).state == expected


def test_unfinished_jobs_are_there_after_a_restart_oldest_first(tmp_path: Path) -> None:
    with ResultStore(tmp_path) as store:
        jobs = [store.jobs.create("a", number) for number in range(5)]
        store.jobs.update(jobs[1].id, state=JobState.FAILED, error={"code": "x"})
        store.jobs.update(jobs[2].id, state=JobState.RUNNING)
    with ResultStore(tmp_path) as store:
        assert [job.request for job in store.jobs.unfinished()] == [0, 2, 3, 4]
        assert store.jobs.get(jobs[1].id).error == {"code": "x"}


def test_jobs_are_listed_newest_first_by_state_and_page(store: ResultStore) -> None:
    jobs = [store.jobs.create("a", number) for number in range(7)]
    for job in jobs[::2]:
        store.jobs.update(job.id, state=JobState.SUCCEEDED)

    def pages(state: JobState | None) -> list[object]:
        found: list[Job] = []
        cursor = None
        while True:
            page = store.jobs.list(state=state, limit=2, cursor=cursor)
            found += page.jobs
            cursor = page.cursor
            if cursor is None:
                return [job.request for job in found]

    assert pages(None) == [6, 5, 4, 3, 2, 1, 0]
    assert pages(JobState.SUCCEEDED) == [6, 4, 2, 0]
    assert pages(JobState.QUEUED) == [5, 3, 1]
    assert pages(JobState.FAILED) == []
    with pytest.raises(ParameterError):
        store.jobs.list(cursor="?")


def test_an_unknown_job_is_not_found(store: ResultStore) -> None:
    for call in (store.jobs.get, lambda name: store.jobs.update(name, progress=1.0)):
        with pytest.raises(NotFoundError):
            call("unknown")


def test_a_key_is_claimed_once_and_answers_again_what_was_answered(store: ResultStore) -> None:
    keys = store.idempotency
    assert keys.get("k") is None
    assert keys.claim("k", "sent") is None
    under_way = keys.claim("k", "sent")
    assert under_way is not None
    assert (under_way.fingerprint, under_way.status, under_way.response) == ("sent", None, None)
    keys.complete("k", 201, {"id": "a"})
    again = keys.claim("k", "otherwise")
    assert again is not None
    assert (again.fingerprint, again.status, again.response) == ("sent", 201, {"id": "a"})
    assert keys.get("k") == again
    keys.release("k")
    assert keys.claim("k", "otherwise") is None


def test_of_many_requests_at_once_one_has_the_key(store: ResultStore) -> None:
    with ThreadPoolExecutor(8) as pool:
        claims = list(pool.map(lambda n: store.idempotency.claim("k", str(n)), range(32)))
    assert claims.count(None) == 1


def test_keys_of_requests_that_died_and_of_long_ago_are_freed(tmp_path: Path) -> None:
    with ResultStore(tmp_path) as store:
        store.idempotency.claim("dead", "a")
        store.idempotency.claim("done", "a")
        store.idempotency.complete("done", 200, None)
    with ResultStore(tmp_path) as store:
        assert store.idempotency.release_unfinished() == 1
        assert store.idempotency.get("dead") is None
        assert store.idempotency.forget_before("2020") == 0
        assert store.idempotency.forget_before("9999") == 1
        assert store.idempotency.get("done") is None


def test_a_failing_block_changes_nothing(tmp_path: Path) -> None:
    database = Database(tmp_path / "index.sqlite")

    def write(statement: str, number: int) -> None:
        with database.write() as connection:
            connection.execute("INSERT INTO state VALUES ('a', 1)")
            connection.execute(statement, (1 // number,))

    with pytest.raises(ZeroDivisionError):
        write("INSERT INTO state VALUES ('b', ?)", 0)
    assert database.read("SELECT * FROM state") == []
    with pytest.raises(StoreError, match="no such table"):
        write("INSERT INTO no_such_table VALUES (?)", 1)
    assert database.read("SELECT * FROM state") == []
    with database.write() as connection:
        connection.execute("INSERT INTO state VALUES ('a', 1)")
    assert database.read("SELECT * FROM state") == [("a", 1)]
    database.close()
    with pytest.raises(StoreError, match="closed"):
        database.read("SELECT * FROM state")


def test_commits_wait_for_the_disk(tmp_path: Path) -> None:
    database = Database(tmp_path / "index.sqlite")
    for connection in (database._writer, database._reader):
        assert connection.execute("PRAGMA journal_mode").fetchone() == ("wal",)
        assert connection.execute("PRAGMA synchronous").fetchone() == (2,)
        assert connection.execute("PRAGMA foreign_keys").fetchone() == (1,)
    database.close()


@pytest.mark.parametrize(
    "content", [b"no database at all" * 100, b"SQLite format 3\x00" + b"x" * 5000]
)
def test_an_index_that_is_none_asks_for_a_rebuild(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "index.sqlite").write_bytes(content)
    with pytest.raises(CorruptFileError) as caught:
        ResultStore(tmp_path).open()
    assert "modalmotion store rebuild" in caught.value.remedy
    # The lock was given back.
    with pytest.raises(CorruptFileError):
        ResultStore(tmp_path).open()


@pytest.mark.parametrize("version", [SCHEMA_VERSION - 1, SCHEMA_VERSION + 1, 99])
def test_an_index_of_another_version_is_not_touched(version: int, tmp_path: Path) -> None:
    ResultStore(tmp_path).open().close()
    connection = sqlite3.connect(tmp_path / "index.sqlite")
    connection.execute(f"PRAGMA user_version = {version}")
    connection.close()
    before = (tmp_path / "index.sqlite").read_bytes()
    with pytest.raises(StoreError, match=f"version {version}"):
        ResultStore(tmp_path).open()
    assert (tmp_path / "index.sqlite").read_bytes() == before


def test_a_foreign_sqlite_file_is_not_taken_for_an_index(tmp_path: Path) -> None:
    connection = sqlite3.connect(tmp_path / "index.sqlite")
    connection.execute("CREATE TABLE mine (a)")
    connection.close()
    with pytest.raises(StoreError, match="version 0"):
        ResultStore(tmp_path).open()
