"""Retention of jobs, their files, and idempotency keys."""

from __future__ import annotations

import asyncio
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path

from modalmotion.store.deletion import forget_tombstones
from modalmotion.store.index.cursor import to_text
from modalmotion_service.workspace.idempotency import IdempotencyKeys
from modalmotion_service.workspace.jobs import Job, Jobs
from modalmotion_service.workspace.perseverance import for_ever
from modalmotion_service.workspace.spool import Spool


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
        self._file_age = file_age
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

    async def sweep_for_ever(self) -> None:
        """Sweep now and again, at least every hour."""
        seconds = min(3600.0, self._file_age.total_seconds() / 4)
        await for_ever("sweep", partial(asyncio.to_thread, self.sweep), seconds)

    def _is_old(self, job: Job) -> bool:
        return datetime.now(UTC) - datetime.fromisoformat(job.updated) > self._file_age
