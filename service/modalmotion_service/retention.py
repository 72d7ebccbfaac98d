"""How long files that jobs have made are kept."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta

from modalmotion.store import Job, Jobs, JobState
from modalmotion_service.spool import Spool


class Retention:
    """Keeps the files of finished jobs for a while.

    Parameters
    ----------
    jobs : Jobs
    spool : Spool
        Where the files lie.
    seconds : float
        From the job's end on; then its result is answered 404.
    """

    def __init__(self, jobs: Jobs, spool: Spool, seconds: float) -> None:
        self._jobs = jobs
        self._spool = spool
        self._age = timedelta(seconds=seconds)

    def needed(self) -> set[str]:
        """Names of files in the spool that a job still needs."""
        uploads = {job.request["file"] for job in self._jobs.unfinished() if "file" in job.request}
        return uploads | {job.result["file"] for job in self._made() if not self._is_old(job)}

    def sweep(self) -> int:
        """Remove the files whose time has passed; gives how many there were."""
        old = [job.result["file"] for job in self._made() if self._is_old(job)]
        present = [name for name in old if self._spool.at(name).is_file()]
        for name in present:
            self._spool.remove(name)
        return len(present)

    async def sweep_for_ever(self) -> None:
        """Sweep now and again, at least every hour."""
        while True:
            await asyncio.sleep(min(3600.0, self._age.total_seconds() / 4))
            await asyncio.to_thread(self.sweep)

    def _made(self) -> Iterator[Job]:
        cursor: str | None = None
        while True:
            page = self._jobs.list(state=JobState.SUCCEEDED, limit=1000, cursor=cursor)
            yield from (job for job in page.jobs if "file" in (job.result or {}))
            if page.cursor is None:
                return
            cursor = page.cursor

    def _is_old(self, job: Job) -> bool:
        return datetime.now(UTC) - datetime.fromisoformat(job.updated) > self._age
