"""Long work that goes on without its request, and after a restart.

The jobs' table is the record: a job is there before it is acknowledged, and unfinished
jobs are taken up again when the service starts. A fault that may pass (a full disk, an index that
cannot be written, a store or a cluster that is away) leads to another try; any other one fails the
job by name. Its files are kept until one or the other.
"""

import asyncio
import contextlib
import logging
import math
import random
import sqlite3
import time
from collections.abc import Awaitable, Callable, Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from typing import Any, Final

from modalmotion.errors import ModalMotionError, NotFoundError, StoreError
from modalmotion.progress import Progress, Reporter
from modalmotion.store import deletion, disk, index
from modalmotion_service.errors import BusyError, ClusterError, ConflictError, WorkerDiedError
from modalmotion_service.http.problems import internal_problem, problem_body
from modalmotion_service.schemas.general import JobState
from modalmotion_service.workspace.jobs import IdempotencyKeys, Job, Jobs
from modalmotion_service.workspace.spool import Spool

logger = logging.getLogger(__name__)

# Between one try and the next. Not longer: when the disk has room again, work goes on at once.
_FIRST_SECONDS: Final = 0.5
_LAST_SECONDS: Final = 5.0

# What fails in the background is tried again no later than this.
_AGAIN_SECONDS: Final = 60.0
# After which a file in the spool that no job needs is nobody's.
_LEFT_SECONDS: Final = 86_400.0


def passes(error: BaseException) -> bool:
    """Return whether a fault may be gone by itself: of the disk, of the index, of a cluster.

    Files that are missing, damaged or not understood stay so, and so do wrong parameters: these
    are errors below StoreError, or others.
    """
    if type(error) is StoreError or isinstance(error, (ClusterError, MemoryError, sqlite3.Error)):
        return True
    # As Python says that the system has no more threads.
    no_thread = isinstance(error, RuntimeError) and "can't start new thread" in str(error)
    return no_thread or disk.is_of_the_machine(error)


def waits() -> Iterator[float]:
    """Seconds before each further try: longer and longer, and never for many at the same time."""
    seconds = _FIRST_SECONDS
    while True:
        yield seconds * random.uniform(0.8, 1.2)  # noqa: S311 (no secret)
        seconds = min(2 * seconds, _LAST_SECONDS)


async def for_ever(name: str, work: Callable[[], Awaitable[object]], seconds: float) -> None:
    """Do something now and again, whatever becomes of it.

    Parameters
    ----------
    name : str
        What the log calls it.
    work : async function
    seconds : float
        Between two times; after a failure a minute at most.
    """
    wait = seconds
    while True:
        await asyncio.sleep(wait)
        try:
            await work()
        except Exception as error:  # noqa: BLE001 (whatever it is, the next time comes)
            logger.error(  # noqa: TRY400 (its name says enough, and it may contain a path)
                "work in the background failed",
                extra={"work": name, "error": type(error).__name__},
            )
            wait = min(seconds, _AGAIN_SECONDS)
        else:
            wait = seconds


async def sweep_for_ever(name: str, sweep: Callable[[], object], age: timedelta) -> None:
    """Sweep now and again, at least every hour, what is kept for some time."""
    seconds = min(3600.0, age.total_seconds() / 4)
    await for_ever(name, partial(asyncio.to_thread, sweep), seconds)


@dataclass(frozen=True)
class Retention:
    """Keeps finished jobs for a while, and their files for another.

    Parameters
    ----------
    jobs : Jobs
    keys : IdempotencyKeys
    spool : Spool
        Where the files are.
    root : Path
        Of the store.
    file_age : timedelta
        From the job's end on; then its result is answered 404.
    job_age : timedelta
        The same of the job itself, and of idempotency keys from their first use on. A job is kept
        as long as its file.
    """

    jobs: Jobs
    keys: IdempotencyKeys
    spool: Spool
    root: Path
    file_age: timedelta
    job_age: timedelta

    def needed(self) -> set[str]:
        """Names of files in the spool that a job still needs."""
        uploads = {job.request["file"] for job in self.jobs.unfinished() if "file" in job.request}
        return uploads | {
            job.result["file"] for job in self.jobs.with_files() if not self._is_old(job)
        }

    def sweep(self) -> int:
        """Remove files, jobs and keys whose time has passed; gives how many files there were."""
        old = [job.result["file"] for job in self.jobs.with_files() if self._is_old(job)]
        present = [name for name in old if self.spool.at(name).is_file()]
        for name in present:
            self.spool.remove(name)
        past = index.to_text((datetime.now(UTC) - max(self.job_age, self.file_age)).timestamp())
        self.jobs.forget_before(past)
        self.keys.forget_before(past)
        deletion.forget_tombstones(self.root)
        # What a cancelled task on another machine has written since.
        self.spool.clear(self.needed(), time.time() - _LEFT_SECONDS)
        return len(present)

    def _is_old(self, job: Job) -> bool:
        return datetime.now(UTC) - datetime.fromisoformat(job.updated) > self.file_age


Ending = Callable[[Any], Awaitable[None]]


class JobRunner:
    """Runs the jobs of one owner; what they do is said by the class below it.

    Parameters
    ----------
    jobs : Jobs
    n_at_once : int
    most_unfinished : int
        Queued and running jobs beyond so many are refused.
    apart : dict
        Number at once of kinds that run in places of their own: hours of one kind should not
        keep the others waiting.
    retry_seconds : float
        How long a job is tried again and again after faults that may pass.
    """

    def __init__(
        self,
        jobs: Jobs,
        n_at_once: int,
        most_unfinished: int,
        apart: Mapping[str, int],
        retry_seconds: float = math.inf,
    ) -> None:
        self._jobs = jobs
        self._places = asyncio.Semaphore(n_at_once)
        self._apart = {kind: asyncio.Semaphore(n) for kind, n in apart.items()}
        self._texts: dict[str, str] = {}
        self._most = most_unfinished
        self._retry_seconds = retry_seconds
        self._tasks: dict[str, asyncio.Task[None]] = {}

    async def do(self, job: Job, report: Reporter) -> Any:
        """Do a job; gives its result, a JSON value."""
        raise NotImplementedError

    def ending(self, job: Job) -> Ending | None:  # noqa: ARG002 (for the class below it)
        """Give what ends that which a job began with, called with its result.

        The result is noted before, and a job that is taken up again goes on from it.
        """
        return None

    def clean_up(self, request: Any) -> None:
        """Remove what is stored for a job's work, by its request, once the job is finished."""

    def require_store(self) -> None:
        """Raise StoreError while nothing can be written where the jobs' files are."""

    async def resume(self) -> None:
        """Take up jobs that an earlier process left unfinished, or that this one lost track of."""
        for job in await asyncio.to_thread(self._jobs.unfinished):
            self._begin(job)

    async def start(
        self, kind: str, request: Any, instead_of: asyncio.Task[Any] | None = None
    ) -> Job:
        """Note a job durably, and begin it.

        Parameters
        ----------
        kind : str
        request : JSON value
        instead_of : asyncio.Task, optional
            A waiter for the same work that gives way to the job; keeps the work until the job
            does.

        Raises
        ------
        BusyError
            If as many jobs are unfinished as may be.
        """
        if len(self._tasks) >= self._most:
            raise BusyError(
                f"{self._most} jobs are queued or running, as many as may be.",
                remedy="Wait until some are finished.",
                limit="unfinished_jobs",
                details={"most": self._most},
            )
        making = asyncio.ensure_future(self._start(kind, request, instead_of))
        try:
            return await asyncio.shield(making)
        except asyncio.CancelledError:
            # Noted perhaps, and told to nobody: it must not wait for somebody to begin it.
            await asyncio.wait([making])
            if making.exception() is None:
                with contextlib.suppress(ModalMotionError):
                    await self.cancel(making.result().id)
            raise

    async def _start(self, kind: str, request: Any, instead_of: asyncio.Task[Any] | None) -> Job:
        job = await asyncio.to_thread(self._jobs.create, kind, request)
        self._begin(job, instead_of)
        return job

    def text(self, job: Job) -> str | None:
        """Say what a job is doing now; None if it is not running or does not report."""
        # Kept here and not in the store: it means nothing once the work has stopped, which the
        # store knows a moment before this does.
        return None if job.is_finished else self._texts.get(job.id)

    async def cancel(self, job_id: str) -> Job:
        """End a job.

        Raises
        ------
        NotFoundError
            If no job has that id.
        ConflictError
            If it is finished.
        """
        if not await asyncio.to_thread(self._jobs.update, job_id, state=JobState.CANCELLED):
            job = await asyncio.to_thread(self._jobs.get, job_id)
            raise ConflictError(
                f"The job has {job.state.value} already.",
                remedy="A finished job stays as it is; its sequence can be deleted.",
                details={"state": job.state.value},
            )
        task = self._tasks.get(job_id)
        if task is not None:
            task.cancel()
            await asyncio.wait([task])
        job = await asyncio.to_thread(self._jobs.get, job_id)
        self._remove_files(job)
        return job

    async def close(self, drain_seconds: float) -> None:
        """Let jobs under way finish for a while; the rest is taken up at the next start."""
        running = list(self._tasks.values())
        if running:
            _, late = await asyncio.wait(running, timeout=drain_seconds)
            for task in late:
                task.cancel()
            if late:
                await asyncio.wait(late)

    def _begin(self, job: Job, instead_of: asyncio.Task[Any] | None = None) -> None:
        task = self._tasks.get(job.id)
        if task is None:
            task = asyncio.create_task(self._run(job), name=f"job {job.id}")
            self._tasks[job.id] = task
            task.add_done_callback(lambda task: self._end(job, task))
        if instead_of is not None:
            task.add_done_callback(lambda _: instead_of.cancel())

    def _end(self, job: Job, task: asyncio.Task[None]) -> None:
        del self._tasks[job.id]
        self._texts.pop(job.id, None)
        if not task.cancelled() and (error := task.exception()) is not None:
            # By a fault of ours; `resume` takes it up again.
            logger.error("a job was left", extra={"job": job.id}, exc_info=error)

    async def _run(self, job: Job) -> None:
        clock, since = asyncio.get_running_loop().time, math.inf
        for seconds in waits():
            is_last = clock() - since > self._retry_seconds
            async with self._apart.get(job.kind, self._places):
                fault = await self._try(job, is_last=is_last)
            if fault is None:
                return
            since = min(since, clock())
            self._texts[job.id] = f"waits for another try: {_words(fault)}"
            # Not in its place: others may be able to do what this one cannot now.
            await asyncio.sleep(seconds)

    async def _try(self, job: Job, *, is_last: bool) -> Exception | None:
        """Do a job; a fault that may pass leaves it in the queue and is given back."""
        if not await self._note(job, state=JobState.RUNNING):
            return None
        # Cancelled by the client, and noted so; or by shutdown, to be taken up again.
        try:
            await asyncio.to_thread(self.require_store)
            result = await self._result(job)
        except Exception as error:
            if not is_last and await self._may_pass(error):
                logger.warning(
                    "a job is tried again", extra={"job": job.id, "error": type(error).__name__}
                )
                await self._note(job, state=JobState.QUEUED)
                return error
            if isinstance(error, ModalMotionError):
                problem = problem_body(error)
            elif disk.is_of_the_machine(error) and isinstance(error, OSError):
                problem = problem_body(disk.cannot_write(Path(error.filename or "a file"), error))
            else:
                logger.exception("job failed", extra={"job": job.id}, exc_info=error)
                problem = internal_problem()
            await self._note(job, state=JobState.FAILED, error=problem)
        else:
            await self._note(job, state=JobState.SUCCEEDED, progress=1.0, result=result)
        self._remove_files(job)
        return None

    async def _may_pass(self, error: Exception) -> bool:
        if passes(error):
            return True
        if not isinstance(error, (StoreError, OSError, WorkerDiedError)):
            return False
        # While the store is away its files are missing, and a full disk may end a process.
        try:
            await asyncio.to_thread(self.require_store)
        except StoreError:
            return True
        return False

    async def _note(self, job: Job, **changes: Any) -> bool:
        """Note a change however long it takes; False if the job had finished before."""
        for seconds in waits():
            try:
                return await asyncio.to_thread(self._jobs.update, job.id, **changes)
            except NotFoundError:
                return False
            except (ModalMotionError, OSError, RuntimeError, MemoryError, sqlite3.Error) as error:
                logger.warning(
                    "a job's state cannot be noted yet",
                    extra={"job": job.id, "error": type(error).__name__},
                )
                self._texts[job.id] = f"waits until its state can be noted: {_words(error)}"
            await asyncio.sleep(seconds)
        raise AssertionError("there is always another try")

    async def _result(self, job: Job) -> Any:
        """Do the work of a job, all but what an earlier try has done."""
        if (end := self.ending(job)) is None:
            return await self.do(job, self._reporter(job))
        result = (await asyncio.to_thread(self._jobs.get, job.id)).result
        if result is None:
            result = await self.do(job, self._reporter(job))
            await self._note(job, result=result)
        await end(result)
        return result

    def _remove_files(self, job: Job) -> None:
        """Remove what a finished job was kept for; what stays is removed at the next start."""
        try:
            self.clean_up(job.request)
        except (StoreError, OSError) as error:
            logger.warning(
                "a job's files stay", extra={"job": job.id, "error": type(error).__name__}
            )

    def _reporter(self, job: Job) -> Reporter:
        loop = asyncio.get_running_loop()
        pending: set[asyncio.Future[None]] = set()
        shown = job.progress

        def report(progress: Progress) -> None:
            nonlocal shown
            self._texts[job.id], share = progress.stage, progress.share
            # One write under way at a time: what comes meanwhile is soon out of date.
            if share > shown and not pending:
                shown = share
                writing = asyncio.ensure_future(self._show(job, share), loop=loop)
                pending.add(writing)
                writing.add_done_callback(pending.discard)

        return report

    async def _show(self, job: Job, share: float) -> None:
        # The next one may be noted.
        with contextlib.suppress(ModalMotionError, OSError, RuntimeError):
            await asyncio.to_thread(self._jobs.update, job.id, progress=share)


def _words(error: Exception) -> str:
    # Never the text of a foreign error, which may name a path.
    if isinstance(error, ModalMotionError):
        return error.message
    return (isinstance(error, OSError) and error.strerror) or type(error).__name__
