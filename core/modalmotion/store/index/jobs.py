"""The record of jobs: long work that outlives the process which began it."""

from __future__ import annotations

import json
import uuid
from dataclasses import dataclass
from enum import Enum, StrEnum
from typing import Any, Final

from modalmotion.errors import NotFoundError
from modalmotion.representation import shown
from modalmotion.store.index.cursor import from_cursor, now, require_limit, to_cursor
from modalmotion.store.index.database import Database


class Unset(Enum):
    """What an argument is that was not given, where None means something."""

    UNSET = "unset"


UNSET: Final = Unset.UNSET


class JobState(StrEnum):
    """How far a job is; the last three are final."""

    QUEUED = "queued"
    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELLED = "cancelled"


@shown("kind", "state", "progress", "created", "id")
@dataclass(frozen=True)
class Job:
    """One row of the jobs' table.

    Parameters
    ----------
    id : str
    kind : str
        What is done.
    state : JobState
    progress : float
        Share that is done, 0 to 1.
    request, result, error : JSON value
        What was asked, what came of it, what went wrong; None until there is one.
    created, updated : str
        UTC, ISO 8601 with microseconds.
    """

    id: str
    kind: str
    state: JobState
    progress: float
    request: Any
    result: Any
    error: Any
    created: str
    updated: str

    @property
    def is_finished(self) -> bool:
        """Whether nothing more will happen to it."""
        return self.state not in (JobState.QUEUED, JobState.RUNNING)


@shown()
@dataclass(frozen=True)
class JobPage:
    """Part of a list of jobs, newest first.

    Parameters
    ----------
    jobs : tuple of Job
    cursor : str or None
        For the page after this one; None on the last.
    """

    jobs: tuple[Job, ...]
    cursor: str | None


class Jobs:
    """The jobs' table.

    Parameters
    ----------
    database : Database
    """

    def __init__(self, database: Database) -> None:
        self._database = database

    def create(self, kind: str, request: Any) -> Job:
        """Note a new job, queued.

        Parameters
        ----------
        kind : str
        request : JSON value
        """
        time = now()
        job = Job(uuid.uuid4().hex, kind, JobState.QUEUED, 0.0, request, None, None, time, time)
        with self._database.write() as connection:
            connection.execute(
                "INSERT INTO jobs VALUES (?, ?, ?, ?, ?, NULL, NULL, ?, ?)",
                (job.id, kind, job.state, job.progress, json.dumps(request), time, time),
            )
        return job

    def update(
        self,
        job_id: str,
        *,
        state: JobState | Unset = UNSET,
        progress: float | Unset = UNSET,
        result: Any = UNSET,
        error: Any = UNSET,
    ) -> bool:
        """Change what is given of a job that is not finished.

        Once it is, `subject` and `label` go from the `query` of its request.

        Returns
        -------
        bool
            False if the job had finished before, and was left as it was: of a cancellation
            and a result that meet, the first one stands.

        Raises
        ------
        NotFoundError
            If there is no such job.
        """
        changes = (
            None if isinstance(state, Unset) else JobState(state),
            None if isinstance(progress, Unset) else float(progress),
            None if result is UNSET else json.dumps(result),
            None if error is UNSET else json.dumps(error),
        )
        is_last = changes[0] not in (None, JobState.QUEUED, JobState.RUNNING)
        with self._database.write() as connection:
            done = connection.execute(
                "UPDATE jobs SET state = coalesce(?, state), progress = coalesce(?, progress), "
                "result = coalesce(?, result), error = coalesce(?, error), updated = ?, "
                # Whose it is and what it shows is of no more use: it stands in the record.
                "request = CASE WHEN ? THEN json_remove(request, '$.query.subject', "
                "'$.query.label') ELSE request END "
                "WHERE id = ? AND state IN ('queued', 'running')",
                (*changes, now(), is_last, job_id),
            )
            if done.rowcount == 1:
                return True
        self.get(job_id)
        return False

    def get(self, job_id: str) -> Job:
        """One job.

        Raises
        ------
        NotFoundError
            If there is no such job.
        """
        rows = self._database.read("SELECT * FROM jobs WHERE id = ?", (job_id,))
        if not rows:
            raise NotFoundError(
                "There is no such job.", remedy="Use the id that was answered when it was made."
            )
        return job_of(rows[0])

    def list(
        self, *, state: JobState | None = None, limit: int = 100, cursor: str | None = None
    ) -> JobPage:
        """Jobs from the newest to the oldest.

        Raises
        ------
        ParameterError
            If the limit is out of range or the cursor is none.
        """
        after, number = from_cursor(cursor), require_limit(limit) + 1
        if state is None:
            rows = self._database.read(
                "SELECT * FROM jobs WHERE (created, id) < (?, ?) "
                "ORDER BY created DESC, id DESC LIMIT ?",
                (*after, number),
            )
        else:
            rows = self._database.read(
                "SELECT * FROM jobs WHERE state = ? AND (created, id) < (?, ?) "
                "ORDER BY created DESC, id DESC LIMIT ?",
                (state, *after, number),
            )
        jobs = tuple(job_of(row) for row in rows[:limit])
        last = to_cursor(jobs[-1].created, jobs[-1].id) if len(rows) > limit else None
        return JobPage(jobs, last)

    def count(self) -> dict[tuple[str, JobState], int]:
        """Count jobs by kind and state."""
        rows = self._database.read("SELECT kind, state, count(*) FROM jobs GROUP BY kind, state")
        return {(kind, JobState(state)): number for kind, state, number in rows}

    def forget_before(self, updated: str) -> int:
        """Remove jobs that finished before a time (UTC, ISO 8601); returns how many."""
        with self._database.write() as connection:
            return connection.execute(
                "DELETE FROM jobs WHERE updated < ? AND state NOT IN ('queued', 'running')",
                (updated,),
            ).rowcount

    def unfinished(self) -> tuple[Job, ...]:
        """Jobs to take up again after a restart, oldest first."""
        rows = self._database.read(
            "SELECT * FROM jobs WHERE state IN ('queued', 'running') ORDER BY created, id"
        )
        return tuple(job_of(row) for row in rows)


def job_of(row: tuple[Any, ...]) -> Job:
    """Make a job of its row."""
    job_id, kind, state, progress, request, result, error, created, updated = row
    return Job(
        id=job_id,
        kind=kind,
        state=JobState(state),
        progress=progress,
        request=json.loads(request),
        result=None if result is None else json.loads(result),
        error=None if error is None else json.loads(error),
        created=created,
        updated=updated,
    )
