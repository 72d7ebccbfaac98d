"""Idempotency keys: a request that is sent twice is done once."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

from modalmotion.store.index.cursor import now
from modalmotion.store.index.database import Database


@dataclass(frozen=True)
class IdempotentRequest:
    """One row of the table of idempotency keys.

    Parameters
    ----------
    key : str
        As the client chose it.
    fingerprint : str
        What it was sent with; another one under the same key is a mistake of the client.
    status : int or None
        Of the answer; None while the request is under way.
    response : JSON value
        The answer.
    created : str
        UTC, ISO 8601 with microseconds.
    """

    key: str
    fingerprint: str
    status: int | None
    response: Any
    created: str


class IdempotencyKeys:
    """The table of idempotency keys.

    Parameters
    ----------
    database : Database
    """

    def __init__(self, database: Database) -> None:
        self._database = database

    def claim(self, key: str, fingerprint: str) -> IdempotentRequest | None:
        """Take a key for a request that is about to be done.

        Returns
        -------
        IdempotentRequest or None
            None where the key was free and is taken now; else what it was taken with.
        """
        with self._database.write() as connection:
            done = connection.execute(
                "INSERT OR IGNORE INTO idempotency VALUES (?, ?, NULL, NULL, ?)",
                (key, fingerprint, now()),
            )
            if done.rowcount == 1:
                return None
            row = connection.execute("SELECT * FROM idempotency WHERE key = ?", (key,)).fetchone()
        return _request(row)

    def get(self, key: str) -> IdempotentRequest | None:
        """Request that a key was taken with, None where it is free."""
        rows = self._database.read("SELECT * FROM idempotency WHERE key = ?", (key,))
        return _request(rows[0]) if rows else None

    def complete(self, key: str, status: int, response: Any) -> None:
        """Keep the answer, to be given again."""
        with self._database.write() as connection:
            connection.execute(
                "UPDATE idempotency SET status = ?, response = ? WHERE key = ?",
                (status, json.dumps(response), key),
            )

    def release(self, key: str) -> None:
        """Free a key whose request had no effect."""
        with self._database.write() as connection:
            connection.execute("DELETE FROM idempotency WHERE key = ?", (key,))

    def release_unfinished(self) -> int:
        """Free the keys of requests that ended with the process; returns how many."""
        with self._database.write() as connection:
            return connection.execute("DELETE FROM idempotency WHERE status IS NULL").rowcount

    def forget_before(self, created: str) -> int:
        """Free the keys taken before a time (UTC, ISO 8601); returns how many."""
        with self._database.write() as connection:
            return connection.execute(
                "DELETE FROM idempotency WHERE created < ?", (created,)
            ).rowcount


def _request(row: tuple[Any, ...]) -> IdempotentRequest:
    key, fingerprint, status, response, created = row
    answer = None if response is None else json.loads(response)
    return IdempotentRequest(key, fingerprint, status, answer, created)
