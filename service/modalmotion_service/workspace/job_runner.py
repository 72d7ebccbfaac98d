"""Long work that goes on without its request, and after a restart.

The jobs' table is the record: a job stands there before it is acknowledged, and unfinished
jobs are taken up again when the service starts.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable, Mapping
from typing import Any, Protocol

from modalmotion.errors import ModalMotionError
from modalmotion_service.errors import BusyError, ClusterError, ConflictError
from modalmotion_service.http.problems import internal_problem, problem_body
from modalmotion_service.schemas import JobState
from modalmotion_service.workspace.jobs import Job, Jobs

logger = logging.getLogger(__name__)


class Report(Protocol):
    """Reports the progress of a job."""

    def __call__(self, share: float, text: str = "") -> None:
        """Note the share that is done, 0 to 1, and in words what is done now."""


# How soon a job is tried again while there is nobody to do it.
_RETRY_SECONDS = 1.0

Handler = Callable[[Any, Report], Awaitable[Any]]


class JobRunner:
    """Runs the jobs of one owner.

    Parameters
    ----------
    jobs : Jobs
    handlers : dict
        For each kind of job an async function of the request and of a function that reports
        progress; it gives the result. Request and result are JSON values.
    clean_up : dict
        For kinds that store something for their work: a function of the request that removes it
        once the job is finished.
    n_at_once : int
    most_unfinished : int
        Queued and running jobs beyond so many are refused.
    apart : dict
        Number at once of kinds that run in places of their own: hours of one kind should not
        keep the others waiting.
    """

    def __init__(
        self,
        jobs: Jobs,
        handlers: Mapping[str, Handler],
        clean_up: Mapping[str, Callable[[Any], None]],
        n_at_once: int,
        most_unfinished: int,
        apart: Mapping[str, int] | None = None,
    ) -> None:
        self._jobs = jobs
        self._handlers = handlers
        self._clean_up = clean_up
        self._places = asyncio.Semaphore(n_at_once)
        self._apart = {kind: asyncio.Semaphore(n) for kind, n in (apart or {}).items()}
        self._texts: dict[str, str] = {}
        self._most = most_unfinished
        self._tasks: dict[str, asyncio.Task[None]] = {}

    async def resume(self) -> None:
        """Take up jobs that an earlier process left unfinished."""
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
            A waiter for the same work that gives way to the job; holds the work until the job
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
        job = await asyncio.to_thread(self._jobs.create, kind, request)
        self._begin(job, instead_of)
        return job

    def text(self, job: Job) -> str | None:
        """Say what a job is doing now; None where it is not running or does not report."""
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
        return await asyncio.to_thread(self._jobs.get, job_id)

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
        task = asyncio.create_task(self._run(job), name=f"job {job.id}")
        self._tasks[job.id] = task

        def end(_: asyncio.Task[None]) -> None:
            del self._tasks[job.id]
            self._texts.pop(job.id, None)
            if instead_of is not None:
                instead_of.cancel()

        task.add_done_callback(end)

    async def _run(self, job: Job) -> None:
        async with self._apart.get(job.kind, self._places):
            while not await self._try(job):
                await asyncio.sleep(_RETRY_SECONDS)

    async def _try(self, job: Job) -> bool:
        """Do a job; False if there was nobody to do it, and it is in the queue again."""
        if await self._update(job, state=JobState.RUNNING):
            try:
                result = await self._handlers[job.kind](job.request, self._reporter(job))
            except ClusterError:
                return not await self._update(job, state=JobState.QUEUED)
            except ModalMotionError as error:
                await self._update(job, state=JobState.FAILED, error=problem_body(error))
            except asyncio.CancelledError:
                # Cancelled by the client, and noted so; or by shutdown, to be taken up again.
                raise
            except Exception as error:
                logger.exception("job failed", extra={"job": job.id}, exc_info=error)
                await self._update(job, state=JobState.FAILED, error=internal_problem())
            else:
                await self._update(job, state=JobState.SUCCEEDED, progress=1.0, result=result)
            finally:
                if job.kind in self._clean_up and self._jobs.get(job.id).is_finished:
                    self._clean_up[job.kind](job.request)
        return True

    async def _update(self, job: Job, **changes: Any) -> bool:
        return await asyncio.to_thread(self._jobs.update, job.id, **changes)

    def _reporter(self, job: Job) -> Report:
        loop = asyncio.get_running_loop()
        pending: set[asyncio.Future[bool]] = set()

        def report(share: float, text: str = "") -> None:
            self._texts[job.id] = text
            # One write under way at a time: what comes meanwhile is soon out of date.
            if not pending:
                writing = asyncio.ensure_future(self._update(job, progress=share), loop=loop)
                pending.add(writing)
                writing.add_done_callback(pending.discard)

        return report
