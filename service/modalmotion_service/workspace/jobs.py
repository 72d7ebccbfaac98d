"""Jobs, and answers to repeated requests with the same key, in the store's index."""

import hashlib
import json
import threading
import uuid
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from modalmotion.errors import NotFoundError
from modalmotion.store.database import Database
from modalmotion.store.index import from_cursor, now, require_limit, to_cursor
from modalmotion_service.http.problems import problem_body
from modalmotion_service.schemas.general import JobState

# Neither a deletion nor the hourly look after files is to read every job of a quarter, millions
# perhaps: hence an index for each way to look.
_TABLES: Final = (
    """CREATE TABLE IF NOT EXISTS jobs (
        id TEXT PRIMARY KEY NOT NULL, kind TEXT NOT NULL, state TEXT NOT NULL,
        progress REAL NOT NULL, request TEXT NOT NULL, result TEXT, error TEXT,
        created TEXT NOT NULL, updated TEXT NOT NULL
    )""",
    *(
        f"CREATE INDEX IF NOT EXISTS {name} ON jobs {what}"
        for name, what in {
            "jobs_by_time": "(created, id)",
            # Counted in 0.1 s where there are a million.
            "jobs_by_kind": "(kind, state)",
            "jobs_by_state": "(state, created, id)",
            "jobs_by_sequence": "(json_extract(request, '$.sequence_id'))",
            "jobs_by_images": "(json_extract(request, '$.query.images'))",
            "jobs_by_link": "(json_extract(result, '$.link'))",
            "jobs_of_several": "(id) WHERE json_extract(request, '$.ids') IS NOT NULL",
            "jobs_with_files": "(id) WHERE json_extract(result, '$.file') IS NOT NULL",
            "finished_jobs": "(updated) WHERE state NOT IN ('queued', 'running')",
        }.items()
    ),
)


@dataclass(frozen=True)
class Job:
    """One row of the jobs' table.

    Parameters
    ----------
    id : str
    kind : str
        Kind of work.
    state : JobState
    progress : float
        Share that is done, 0 to 1.
    request, result, error : JSON value
        The request, and its result or error; None until there is one.
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


def results_of(jobs: Iterable[Job]) -> list[str]:
    """Name the files in the spool that jobs have made."""
    return [job.result["file"] for job in jobs if job.result and "file" in job.result]


class Jobs:
    """The jobs' table.

    Parameters
    ----------
    database : Database
        Of the store; the table is made in it where it is missing.
    """

    def __init__(self, database: Database) -> None:
        self._database = database
        database.extend(_TABLES)

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
        state: JobState | None = None,
        progress: float | None = None,
        result: Any = None,
        error: Any = None,
    ) -> bool:
        """Change a job that is not finished; what is left out stays.

        Once it is finished, `subject`, `label` and `images` go from the `query` of its request.

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
            state,
            progress,
            None if result is None else json.dumps(result),
            None if error is None else json.dumps(error),
        )
        is_last = state not in (None, JobState.QUEUED, JobState.RUNNING)
        with self._database.write(erases=is_last) as connection:
            cursor = connection.execute(
                "UPDATE jobs SET state = coalesce(?, state), "
                # Of another try, too, it never falls.
                "progress = max(progress, coalesce(?, progress)), "
                "result = coalesce(?, result), error = coalesce(?, error), updated = ?, "
                # Whose it is and what it shows is of no more use: it is in the record.
                "request = CASE WHEN ? THEN json_remove(request, '$.query.subject', "
                "'$.query.label', '$.query.images') ELSE request END "
                "WHERE id = ? AND state IN ('queued', 'running')",
                (*changes, now(), is_last, job_id),
            )
            if cursor.rowcount == 1:
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
        jobs = self._select("WHERE id = ?", job_id)
        if not jobs:
            raise NotFoundError(
                "There is no such job.", remedy="Use the id from the answer that created it."
            )
        return jobs[0]

    def list(
        self, *, state: JobState | None = None, limit: int = 100, cursor: str | None = None
    ) -> tuple[tuple[Job, ...], str | None]:
        """Jobs of a page, from the newest on, and the cursor for the next; None on the last.

        Raises
        ------
        ParameterError
            If the limit is out of range or the cursor is not one of a list.
        """
        condition, values = "(created, id) < (?, ?)", [*from_cursor(cursor)]
        if state is not None:
            condition, values = f"state = ? AND {condition}", [state, *values]
        jobs = self._select(
            f"WHERE {condition} ORDER BY created DESC, id DESC LIMIT ?",
            *(*values, require_limit(limit) + 1),
        )
        page = jobs[:limit]
        last = to_cursor(page[-1].created, page[-1].id) if len(jobs) > limit else None
        return page, last

    def count(self) -> dict[tuple[str, JobState], int]:
        """Count jobs by kind and state."""
        rows = self._database.read("SELECT kind, state, count(*) FROM jobs GROUP BY kind, state")
        return {(kind, JobState(state)): number for kind, state, number in rows}

    def forget_before(self, updated: str) -> int:
        """Remove jobs that finished before a time (UTC, ISO 8601); returns how many."""
        with self._database.write(erases=True) as connection:
            return connection.execute(
                "DELETE FROM jobs WHERE updated < ? AND state NOT IN ('queued', 'running')",
                (updated,),
            ).rowcount

    def forget(self, *job_ids: str) -> None:
        """Remove finished jobs; one that is not stays."""
        with self._database.write(erases=True) as connection:
            connection.executemany(
                "DELETE FROM jobs WHERE id = ? AND state NOT IN ('queued', 'running')",
                [(job_id,) for job_id in job_ids],
            )

    def unfinished(self) -> tuple[Job, ...]:
        """Jobs to take up again after a restart, oldest first."""
        return self._select("WHERE state IN ('queued', 'running') ORDER BY created, id")

    def with_files(self) -> tuple[Job, ...]:
        """Jobs whose result names a `file`."""
        return self._select("WHERE json_extract(result, '$.file') IS NOT NULL")

    def about(self, sequence_id: str, link: str) -> tuple[Job, ...]:
        """Jobs whose request names a sequence, alone or among others, or whose result is one.

        Parameters
        ----------
        sequence_id : str
            As `sequence_id`, in `ids` or as `images` of the `query` of the request.
        link : str
            As `link` of the result.
        """
        return self._select(
            "WHERE json_extract(request, '$.sequence_id') = ? "
            "UNION SELECT * FROM jobs WHERE json_extract(result, '$.link') = ? "
            "UNION SELECT * FROM jobs WHERE json_extract(request, '$.query.images') = ? "
            "UNION SELECT * FROM jobs WHERE json_extract(request, '$.ids') IS NOT NULL "
            "AND EXISTS (SELECT 1 FROM json_each(request, '$.ids') WHERE value = ?)",
            *(sequence_id, link, sequence_id, sequence_id),
        )

    def _select(self, rest: str, *values: Any) -> tuple[Job, ...]:
        statement = f"SELECT * FROM jobs {rest}"  # noqa: S608 (of constants)
        return tuple(_job(row) for row in self._database.read(statement, values))


def _job(row: tuple[Any, ...]) -> Job:
    job_id, kind, state, progress, request, *outcome, created, updated = row
    result, error = (None if text is None else json.loads(text) for text in outcome)
    state, request = JobState(state), json.loads(request)
    return Job(job_id, kind, state, progress, request, result, error, created, updated)


_TABLES_OF_KEYS: Final = (
    """CREATE TABLE IF NOT EXISTS idempotency (
        key TEXT PRIMARY KEY, fingerprint TEXT NOT NULL, status INTEGER, response TEXT,
        created TEXT NOT NULL
    ) WITHOUT ROWID""",
    "CREATE INDEX IF NOT EXISTS idempotency_by_time ON idempotency (created)",
    "CREATE INDEX IF NOT EXISTS idempotency_under_way ON idempotency (key) WHERE status IS NULL",
    (
        "CREATE INDEX IF NOT EXISTS idempotency_by_place "
        "ON idempotency (json_extract(response, '$.headers.location'))"
    ),
)


_PLACE: Final = "json_extract(response, '$.headers.location')"


@dataclass(frozen=True)
class IdempotentRequest:
    """What is known of a request by its idempotency key.

    Parameters
    ----------
    fingerprint : str
        Digest of the request; another one under the same key is a mistake of the client.
    status : int or None
        Of the answer; None while the request is under way.
    response : JSON value
        The answer.
    """

    fingerprint: str
    status: int | None
    response: Any


class IdempotencyKeys:
    """The table of idempotency keys.

    Parameters
    ----------
    database : Database
        Of the store; the table is made in it where it is missing.
    """

    def __init__(self, database: Database) -> None:
        self._database = database
        self._lock = threading.Lock()
        # What could not be written: an answer, or None for a key that is free again.
        self._late: dict[str, tuple[int, str] | None] = {}
        database.extend(_TABLES_OF_KEYS)

    def claim(self, key: str, fingerprint: str) -> IdempotentRequest | None:
        """Take a key for a request that is about to be done.

        Returns
        -------
        IdempotentRequest or None
            None if the key was free and is taken now; else the request that took it.
        """
        name = _digest(key)
        self.write_late()
        with self._database.write() as connection:
            done = connection.execute(
                "INSERT OR IGNORE INTO idempotency VALUES (?, ?, NULL, NULL, ?)",
                (name, fingerprint, now()),
            )
            if done.rowcount == 1:
                return None
            fingerprint, status, response = connection.execute(
                "SELECT fingerprint, status, response FROM idempotency WHERE key = ?", (name,)
            ).fetchone()
        response = None if response is None else json.loads(response)
        return IdempotentRequest(fingerprint, status, response)

    def complete(self, key: str, status: int, response: Any) -> None:
        """Store the answer, to be repeated.

        Raises
        ------
        StoreError
            If it cannot be written now: it will be before anybody claims a key again.
        """
        with self._lock:
            self._late[_digest(key)] = (status, json.dumps(response))
        self.write_late()

    def release(self, key: str) -> None:
        """Free a key whose request had no effect; StoreError as `complete`."""
        with self._lock:
            self._late[_digest(key)] = None
        self.write_late()

    def write_late(self) -> None:
        """Write what could not be written before; StoreError if it cannot be now."""
        with self._lock:
            if not self._late:
                return
            with self._database.write() as connection:
                for name, answer in self._late.items():
                    if answer is None:
                        connection.execute("DELETE FROM idempotency WHERE key = ?", (name,))
                    else:
                        connection.execute(
                            "UPDATE idempotency SET status = ?, response = ? WHERE key = ?",
                            (*answer, name),
                        )
            self._late.clear()

    def release_unfinished(self) -> int:
        """Free the keys of requests that ended with the process; returns how many."""
        with self._database.write() as connection:
            return connection.execute("DELETE FROM idempotency WHERE status IS NULL").rowcount

    def forget_before(self, created: str) -> int:
        """Free the keys taken before a time (UTC, ISO 8601); returns how many."""
        with self._database.write(erases=True) as connection:
            return connection.execute(
                "DELETE FROM idempotency WHERE created < ?", (created,)
            ).rowcount

    def replace_answers(self, place: str, status: int, response: Any) -> int:
        """Replace the answers of requests whose result is at or below a place.

        Parameters
        ----------
        place : str
            The `location` among the headers of the stored answers.
        status : int
        response : JSON value

        Returns
        -------
        int
            Answers replaced. Their keys stay taken: what was deleted is not to come back by a
            request that is sent again.
        """
        self.write_late()
        # Below a place is what comes between "-" or "/" and the character after them.
        below = (f"{place}-", f"{place}0")
        with self._database.write(erases=True) as connection:
            return connection.execute(
                f"UPDATE idempotency SET status = ?, response = ? "  # noqa: S608 (of constants)
                f"WHERE {_PLACE} = ? OR ({_PLACE} >= ? AND {_PLACE} < ?)",
                (status, json.dumps(response), place, *below),
            ).rowcount

    def restate(self, values: Mapping[str, Any], *places: str) -> None:
        """Have the answers of requests whose result is at these places state what is known now.

        Parameters
        ----------
        values : mapping of str to JSON value
            Of name, subject, label and facts.
        *places : str
        """
        self.write_late()
        members = "".join(
            f", '$.{of}{name}', json(?)" for of in ("", "sequence.") for name in values
        )
        # As text again, for a value of SQLite's functions would be put in as an object.
        statement = (
            "UPDATE idempotency SET response = json_replace(response, '$.body', "  # noqa: S608
            f"json_replace(json_extract(response, '$.body'){members}) || '') WHERE {_PLACE} = ?"
        )
        texts = [*map(json.dumps, values.values())] * 2
        with self._database.write(erases=True) as connection:
            connection.executemany(statement, [(*texts, place) for place in places])


def _digest(key: str) -> str:
    # What the client chose may name a person.
    return hashlib.sha256(key.encode()).hexdigest()


def gone() -> tuple[int, dict[str, object]]:
    """Give status and stored answer."""
    body = problem_body(
        NotFoundError(
            "The result of this request has been deleted since.",
            remedy="Send it with a new Idempotency-Key to have it again.",
        )
    )
    headers = {"content-type": "application/problem+json"}
    return 404, {"body": json.dumps(body), "headers": headers}
