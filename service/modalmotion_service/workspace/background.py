"""Work in the background: tried again after faults that pass, and the removal of what is old."""

from __future__ import annotations

import asyncio
import logging
import random
import sqlite3
from collections.abc import Awaitable, Callable, Iterator
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from typing import Final

from modalmotion.errors import StoreError
from modalmotion.store.deletion import forget_tombstones
from modalmotion.store.disk import is_of_the_machine
from modalmotion.store.index import to_text
from modalmotion_service.errors import ClusterError
from modalmotion_service.workspace.jobs import IdempotencyKeys, Job, Jobs
from modalmotion_service.workspace.spool import Spool

logger = logging.getLogger(__name__)

# Between one try and the next. Not longer: when the disk has room again, work goes on at once.
_FIRST_SECONDS: Final = 0.5
_LAST_SECONDS: Final = 5.0

# What fails in the background is tried again no later than this.
_AGAIN_SECONDS: Final = 60.0


def passes(error: BaseException) -> bool:
    """Return whether a fault may be gone by itself: of the disk, of the index, of a cluster.

    Files that are missing, damaged or not understood stay so, and so do wrong parameters: these
    are errors below StoreError, or others.
    """
    if type(error) is StoreError or isinstance(error, (ClusterError, MemoryError, sqlite3.Error)):
        return True
    # As Python says that the system has no more threads.
    no_thread = isinstance(error, RuntimeError) and "can't start new thread" in str(error)
    return no_thread or is_of_the_machine(error)


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

    def __init__(
        self,
        jobs: Jobs,
        keys: IdempotencyKeys,
        spool: Spool,
        root: Path,
        *,
        file_age: timedelta,
        job_age: timedelta,
    ) -> None:
        self._jobs = jobs
        self._keys = keys
        self._spool = spool
        self._root = root
        self.file_age = file_age
        self._job_age = max(job_age, file_age)

    def needed(self) -> set[str]:
        """Names of files in the spool that a job still needs."""
        uploads = {job.request["file"] for job in self._jobs.unfinished() if "file" in job.request}
        return uploads | {
            job.result["file"] for job in self._jobs.with_files() if not self._is_old(job)
        }

    def sweep(self) -> int:
        """Remove files, jobs and keys whose time has passed; gives how many files there were."""
        old = [job.result["file"] for job in self._jobs.with_files() if self._is_old(job)]
        present = [name for name in old if self._spool.at(name).is_file()]
        for name in present:
            self._spool.remove(name)
        past = to_text((datetime.now(UTC) - self._job_age).timestamp())
        self._jobs.forget_before(past)
        self._keys.forget_before(past)
        forget_tombstones(self._root)
        return len(present)

    def _is_old(self, job: Job) -> bool:
        return datetime.now(UTC) - datetime.fromisoformat(job.updated) > self.file_age
