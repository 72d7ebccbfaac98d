"""What jobs and idempotency keys tell of a sequence: found, so that a deletion reaches it."""

from __future__ import annotations

import json
from typing import Any, Final

from modalmotion.store.index.database import Database
from modalmotion.store.index.jobs import Job, job_of

# Made where they are missing; programs of before pass them by. Neither a deletion nor the hourly
# look after files is to read every job of a quarter, millions perhaps.
_INDEXES: Final = (
    "CREATE INDEX IF NOT EXISTS jobs_by_sequence ON jobs (json_extract(request, '$.sequence_id'))",
    "CREATE INDEX IF NOT EXISTS jobs_by_link ON jobs (json_extract(result, '$.link'))",
    (
        "CREATE INDEX IF NOT EXISTS jobs_of_several ON jobs (id) "
        "WHERE json_extract(request, '$.ids') IS NOT NULL"
    ),
    (
        "CREATE INDEX IF NOT EXISTS jobs_with_files ON jobs (id) "
        "WHERE json_extract(result, '$.file') IS NOT NULL"
    ),
    (
        "CREATE INDEX IF NOT EXISTS idempotency_by_place "
        "ON idempotency (json_extract(response, '$.headers.location'))"
    ),
)


class Traces:
    """Jobs and idempotency keys by what they are about.

    Parameters
    ----------
    database : Database
    """

    def __init__(self, database: Database) -> None:
        self._database = database

    def prepare(self) -> None:
        """Make the indexes where they are missing."""
        with self._database.write() as connection:
            for statement in _INDEXES:
                connection.execute(statement)

    def jobs_about(self, sequence_id: str, link: str) -> tuple[Job, ...]:
        """Jobs whose request names a sequence, alone or among others, or whose result is one.

        Parameters
        ----------
        sequence_id : str
            As `sequence_id` or in `ids` of the request.
        link : str
            As `link` of the result.
        """
        rows = self._database.read(
            "SELECT * FROM jobs WHERE json_extract(request, '$.sequence_id') = ? "
            "UNION SELECT * FROM jobs WHERE json_extract(result, '$.link') = ? "
            "UNION SELECT * FROM jobs WHERE json_extract(request, '$.ids') IS NOT NULL "
            "AND EXISTS (SELECT 1 FROM json_each(request, '$.ids') WHERE value = ?)",
            (sequence_id, link, sequence_id),
        )
        return tuple(job_of(row) for row in rows)

    def jobs_with_files(self) -> tuple[Job, ...]:
        """Jobs whose result names a `file`."""
        rows = self._database.read(
            "SELECT * FROM jobs WHERE json_extract(result, '$.file') IS NOT NULL"
        )
        return tuple(job_of(row) for row in rows)

    def forget_jobs(self, *job_ids: str) -> None:
        """Remove finished jobs; one that is not stays."""
        with self._database.write() as connection:
            connection.executemany(
                "DELETE FROM jobs WHERE id = ? AND state NOT IN ('queued', 'running')",
                [(job_id,) for job_id in job_ids],
            )

    def replace_answers(self, place: str, status: int, response: Any) -> int:
        """Have requests that made what lies at or below a place be answered otherwise.

        Parameters
        ----------
        place : str
            The `location` among the headers of the answers that are kept.
        status : int
        response : JSON value

        Returns
        -------
        int
            Answers replaced. Their keys stay taken: what was deleted is not to come back by a
            request that is sent again.
        """
        location = "json_extract(response, '$.headers.location')"
        # Below a place lies what comes between "/" and the character after it.
        below = (f"{place}/", f"{place}0")
        with self._database.write() as connection:
            return connection.execute(
                f"UPDATE idempotency SET status = ?, response = ? "  # noqa: S608 (of constants)
                f"WHERE {location} = ? OR ({location} >= ? AND {location} < ?)",
                (status, json.dumps(response), place, *below),
            ).rowcount
