"""Whatever fails for a while: an acknowledged job ends, and its file stays until then."""

from __future__ import annotations

import asyncio
import errno
import math
import sqlite3
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from modalmotion.errors import CorruptFileError, MalformedFileError, NotFoundError, StoreError
from modalmotion.progress import Progress, Reporter
from modalmotion.store import ResultStore
from modalmotion_service.errors import ClusterError, WorkerDiedError
from modalmotion_service.schemas.general import JobState
from modalmotion_service.workspace import job_runner
from modalmotion_service.workspace.job_runner import Ending, JobRunner
from modalmotion_service.workspace.jobs import Job, Jobs

PASSING = (
    StoreError("The index could not be read or written (database or disk is full)."),
    OSError(errno.ENOSPC, "No space left on device", "/secret/folder/file"),
    OSError(errno.EIO, "Input/output error"),
    OSError(errno.EMFILE, "Too many open files"),
    sqlite3.OperationalError("disk I/O error"),
    sqlite3.DatabaseError("anything"),
    MemoryError(),
    RuntimeError("can't start new thread"),
)
LASTING = (
    MalformedFileError("The file is not understood."),
    NotFoundError("There is no such sequence."),
    CorruptFileError("The file is damaged."),
    WorkerDiedError("The process ended three times in a row."),
    KeyError("a fault of ours"),
)


@pytest.fixture(autouse=True)
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(job_runner, "_FIRST_SECONDS", 0.001)
    monkeypatch.setattr(job_runner, "_LAST_SECONDS", 0.004)


@pytest.fixture
def jobs(tmp_path: Path) -> Iterator[Jobs]:
    with ResultStore(tmp_path / "store") as store:
        yield Jobs(store.database)


class Failing:
    """Calls a function, after it has failed so often."""

    def __init__(self, function: Callable[..., Any], error: BaseException, n_times: int) -> None:
        self.function, self.error, self.n_left = function, error, n_times

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        if self.n_left > 0:
            self.n_left -= 1
            raise self.error
        return self.function(*args, **kwargs)


async def ended(runner: JobRunner, jobs: Jobs, file: Path) -> Job:
    """Start a job, and wait for its end; its file is there until then."""
    file.touch()
    job = await runner.start("kind", {"file": str(file)})
    while True:
        known, there = jobs.get(job.id), file.exists()
        if known.is_finished:
            await runner.close(10.0)
            return known
        assert there
        await asyncio.sleep(0.001)


class Runner(JobRunner):
    """Does jobs by a function, one at a time; each has a file until its end."""

    def __init__(
        self,
        jobs: Jobs,
        handler: Callable[[Any, Reporter], Any],
        settle: Callable[[Any, Any], Any] | None = None,
        require_store: Callable[[], None] = lambda: None,
        retry_seconds: float = math.inf,
    ) -> None:
        super().__init__(jobs, 1, 100, {}, retry_seconds)
        self.handler, self.settle, self.required = handler, settle, require_store

    async def do(self, job: Job, report: Reporter) -> Any:
        return await self.handler(job.request, report)

    def ending(self, job: Job) -> Ending | None:
        return self.settle and partial(self.settle, job)

    def clean_up(self, request: Any) -> None:
        Path(request["file"]).unlink()

    def require_store(self) -> None:
        self.required()


async def done(_request: Any, _report: Reporter) -> Any:
    return {"link": "there"}


@pytest.mark.parametrize("error", PASSING, ids=repr)
@pytest.mark.parametrize("n_times", [1, 2, 5])
def test_a_state_that_cannot_be_noted_is_noted_later(
    jobs: Jobs, tmp_path: Path, error: Exception, n_times: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    # First that it runs, then its progress and its end.
    failing = Failing(jobs.update, error, n_times)
    monkeypatch.setattr(jobs, "update", failing)
    n_tries = 0

    async def handler(_request: Any, report: Reporter) -> Any:
        nonlocal n_tries
        n_tries += 1
        failing.n_left = n_times
        report(Progress(0.5, stage="half"))
        return {"link": "there"}

    job = asyncio.run(ended(Runner(jobs, handler), jobs, tmp_path / "file"))
    assert (job.state, job.result) == (JobState.SUCCEEDED, {"link": "there"})
    # Done once: only its end was noted again.
    assert n_tries == 1
    assert not (tmp_path / "file").exists()


@pytest.mark.parametrize("error", [*PASSING, ClusterError("No workers.")], ids=repr)
def test_a_fault_that_passes_leads_to_another_try(
    jobs: Jobs, tmp_path: Path, error: Exception
) -> None:
    tries = Failing(lambda: {"link": "there"}, error, 3)
    texts = []

    async def handler(_request: Any, report: Reporter) -> Any:
        texts.append(runner.text(jobs.list()[0][0]))
        report(Progress(0.9 - 0.1 * tries.n_left))
        return tries()

    runner = Runner(jobs, handler)
    job = asyncio.run(ended(runner, jobs, tmp_path / "file"))
    assert (job.state, tries.n_left) == (JobState.SUCCEEDED, 0)
    # Who asks is told why it waits, but for what is inside.
    assert all(str(text).startswith("waits for another try") for text in texts[1:])
    assert not any("secret" in str(text) for text in texts)


@pytest.mark.parametrize("error", LASTING, ids=repr)
def test_any_other_fault_fails_it_by_name(jobs: Jobs, tmp_path: Path, error: Exception) -> None:
    tries = Failing(dict, error, 100)

    async def handler(_request: Any, _report: Reporter) -> Any:
        return tries()

    job = asyncio.run(ended(Runner(jobs, handler), jobs, tmp_path / "file"))
    assert (job.state, tries.n_left) == (JobState.FAILED, 99)
    assert job.error["code"] == getattr(error, "code", "internal_error")


@pytest.mark.parametrize(
    "error", [NotFoundError("no file"), FileNotFoundError(2, "no file"), LASTING[3]], ids=repr
)
def test_what_is_missing_while_the_store_is_away_is_no_fault_of_the_job(
    jobs: Jobs, tmp_path: Path, error: Exception
) -> None:
    away = Failing(lambda: None, StoreError("away"), 7)
    n_tries = 0

    async def handler(_request: Any, _report: Reporter) -> Any:
        nonlocal n_tries
        n_tries += 1
        if n_tries == 1:
            # Between the look at the store and the end of the work it goes away.
            away.n_left = 5
            raise error
        return {}

    away.n_left = 2
    runner = Runner(jobs, handler, require_store=away)
    job = asyncio.run(ended(runner, jobs, tmp_path / "file"))
    assert (job.state, n_tries, away.n_left) == (JobState.SUCCEEDED, 2, 0)


def test_what_does_not_pass_for_long_fails_by_name(jobs: Jobs, tmp_path: Path) -> None:
    async def handler(_request: Any, _report: Reporter) -> Any:
        raise OSError(errno.ENOSPC, "No space left on device", "/secret/file")

    runner = Runner(jobs, handler, retry_seconds=0.05)
    job = asyncio.run(ended(runner, jobs, tmp_path / "file"))
    assert job.state is JobState.FAILED
    assert (job.error["status"], job.error["errno"]) == (507, "ENOSPC")


def test_a_job_that_waits_for_another_try_keeps_no_other_one_waiting(
    jobs: Jobs, tmp_path: Path
) -> None:
    async def handler(request: Any, _report: Reporter) -> Any:
        if request["file"].endswith("large"):
            raise StoreError("The disk is full.")
        return {}

    async def both() -> Job:
        runner = Runner(jobs, handler)
        (tmp_path / "large").touch()
        large = await runner.start("kind", {"file": str(tmp_path / "large")})
        await ended_beside(runner, jobs, tmp_path / "small")
        assert not jobs.get(large.id).is_finished
        cancelled = await runner.cancel(large.id)
        assert not (tmp_path / "large").exists()
        return cancelled

    assert asyncio.run(both()).state is JobState.CANCELLED


async def ended_beside(runner: JobRunner, jobs: Jobs, file: Path) -> None:
    file.touch()
    job = await runner.start("kind", {"file": str(file)})
    while not jobs.get(job.id).is_finished:
        await asyncio.sleep(0.001)


def test_a_job_that_nobody_does_is_taken_up(jobs: Jobs, tmp_path: Path) -> None:
    lost = jobs.create("kind", {"file": str(tmp_path / "file")})
    (tmp_path / "file").touch()

    async def taken_up() -> None:
        runner = Runner(jobs, done)
        # Twice at once: it is done once.
        await asyncio.gather(runner.resume(), runner.resume())
        await runner.close(10.0)

    asyncio.run(taken_up())
    assert jobs.get(lost.id).state is JobState.SUCCEEDED


def test_whoever_leaves_while_a_job_is_noted_leaves_none_behind(
    jobs: Jobs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    create = jobs.create
    left: list[asyncio.Future[Job]] = []

    def slow(*args: Any) -> Job:
        job = create(*args)
        left[0].get_loop().call_soon_threadsafe(left[0].cancel)
        return job

    monkeypatch.setattr(jobs, "create", slow)

    async def leave() -> None:
        runner = Runner(jobs, done)
        starting = asyncio.ensure_future(runner.start("kind", {"file": str(tmp_path / "file")}))
        left.append(starting)
        with pytest.raises(asyncio.CancelledError):
            await starting
        await runner.close(10.0)

    asyncio.run(leave())
    assert not jobs.unfinished()


def test_what_is_done_for_ever_survives_its_faults() -> None:
    times: list[int] = []

    async def work() -> None:
        times.append(len(times))
        if len(times) < 4:
            raise StoreError("The disk is full.")

    async def some() -> None:
        task = asyncio.create_task(job_runner.for_ever("test", work, 0.001))
        while len(times) < 6:
            await asyncio.sleep(0.001)
        task.cancel()

    asyncio.run(some())


def test_what_goes_in_the_end_goes_once_the_result_is_noted(jobs: Jobs, tmp_path: Path) -> None:
    """Images are needed until nothing begins with them again: not even after a crash."""
    steps: list[str] = []
    way = {"is open": False}

    async def handler(_request: Any, _report: Reporter) -> Any:
        steps.append("worked")
        return {"link": "there"}

    async def settle(request: Any, result: Any) -> None:
        known = jobs.list()[0][0]
        assert (known.state, known.result, result) == (JobState.RUNNING, {"link": "there"}, result)
        steps.append("settled")
        while not way["is open"]:
            await asyncio.sleep(0.01)

    async def killed() -> str:
        runner = Runner(jobs, handler, settle=settle)
        (tmp_path / "file").touch()
        job = await runner.start("kind", {"file": str(tmp_path / "file")})
        while "settled" not in steps:
            await asyncio.sleep(0.001)
        await runner.close(0.0)
        return job.id

    async def resumed(job_id: str) -> Job:
        runner = Runner(jobs, handler, settle=settle)
        await runner.resume()
        await runner.close(10.0)
        return jobs.get(job_id)

    job_id = asyncio.run(killed())
    assert not jobs.get(job_id).is_finished
    way["is open"] = True
    job = asyncio.run(resumed(job_id))
    assert (job.state, job.result) == (JobState.SUCCEEDED, {"link": "there"})
    # The work was not done again, for what it begins with may be gone.
    assert steps == ["worked", "settled", "settled"]


@pytest.mark.parametrize("error", PASSING, ids=repr)
def test_a_fault_at_the_end_leads_to_another_try_of_the_end(
    jobs: Jobs, tmp_path: Path, error: Exception
) -> None:
    steps: list[str] = []

    async def handler(_request: Any, _report: Reporter) -> Any:
        steps.append("worked")
        return {"link": "there"}

    ends = Failing(lambda *_: steps.append("settled"), error, 2)

    async def settle(request: Any, result: Any) -> None:
        ends(request, result)

    runner = Runner(jobs, handler, settle=settle)
    job = asyncio.run(ended(runner, jobs, tmp_path / "file"))
    assert (job.state, steps) == (JobState.SUCCEEDED, ["worked", "settled"])
