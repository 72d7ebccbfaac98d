"""The table of idempotency keys, in the file of the store's index."""

from __future__ import annotations

import base64
import hmac
import json
import secrets
import threading
from dataclasses import dataclass
from typing import Any, Final

from modalmotion.errors import NotFoundError
from modalmotion.store.database import Database
from modalmotion.store.index import now
from modalmotion_service.http.problems import problem_body

_TABLES: Final = (
    "CREATE TABLE IF NOT EXISTS idempotency_secret (secret BLOB NOT NULL)",
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


@dataclass(frozen=True)
class IdempotentRequest:
    """One row of the table of idempotency keys.

    Parameters
    ----------
    key : str
        Keyed digest of what the client chose, which may name a person.
    fingerprint : str
        Digest of the request; another one under the same key is a mistake of the client.
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
        Of the store; the table is made in it where it is missing.
    """

    def __init__(self, database: Database) -> None:
        self._database = database
        self._lock = threading.Lock()
        # What could not be written: an answer, or None for a key that is free again.
        self._late: dict[str, tuple[int, str] | None] = {}
        database.extend(_TABLES)
        self._secret = self._secret_of_file()

    def claim(self, key: str, fingerprint: str) -> IdempotentRequest | None:
        """Take a key for a request that is about to be done.

        Returns
        -------
        IdempotentRequest or None
            None if the key was free and is taken now; else the request that took it.
        """
        name = self._digest(key)
        self.settle()
        with self._database.write() as connection:
            done = connection.execute(
                "INSERT OR IGNORE INTO idempotency VALUES (?, ?, NULL, NULL, ?)",
                (name, fingerprint, now()),
            )
            if done.rowcount == 1:
                return None
            row = connection.execute("SELECT * FROM idempotency WHERE key = ?", (name,)).fetchone()
        return _request(row)

    def get(self, key: str) -> IdempotentRequest | None:
        """Request that a key was taken with, None if it is free."""
        name = self._digest(key)
        rows = self._database.read("SELECT * FROM idempotency WHERE key = ?", (name,))
        return _request(rows[0]) if rows else None

    def complete(self, key: str, status: int, response: Any) -> None:
        """Store the answer, to be repeated.

        Raises
        ------
        StoreError
            If it cannot be written now: it will be before anybody claims a key again.
        """
        with self._lock:
            self._late[self._digest(key)] = (status, json.dumps(response))
        self.settle()

    def release(self, key: str) -> None:
        """Free a key whose request had no effect; StoreError as `complete`."""
        with self._lock:
            self._late[self._digest(key)] = None
        self.settle()

    def settle(self) -> None:
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
        location = "json_extract(response, '$.headers.location')"
        self.settle()
        # Below a place is what comes between "-" or "/" and the character after them.
        below = (f"{place}-", f"{place}0")
        with self._database.write(erases=True) as connection:
            return connection.execute(
                f"UPDATE idempotency SET status = ?, response = ? "  # noqa: S608 (of constants)
                f"WHERE {location} = ? OR ({location} >= ? AND {location} < ?)",
                (status, json.dumps(response), place, *below),
            ).rowcount

    def _secret_of_file(self) -> bytes:
        """Give the secret that digests are keyed with, made where it is missing."""
        rows = self._database.read("SELECT secret FROM idempotency_secret")
        if rows:
            return bytes(rows[0][0])
        secret = secrets.token_bytes(32)
        with self._database.write(erases=True) as connection:
            connection.execute("INSERT INTO idempotency_secret VALUES (?)", (secret,))
        return secret

    def _digest(self, key: str) -> str:
        return _keyed(self._secret, key)


def _keyed(secret: bytes, key: str) -> str:
    return hmac.digest(secret, key.encode(), "sha256").hex()


def _request(row: tuple[Any, ...]) -> IdempotentRequest:
    key, fingerprint, status, response, created = row
    answer = None if response is None else json.loads(response)
    return IdempotentRequest(key, fingerprint, status, answer, created)


def gone() -> tuple[int, dict[str, object]]:
    """Give status and stored answer."""
    body = problem_body(
        NotFoundError(
            "The result of this request has been deleted since.",
            remedy="Send it with a new Idempotency-Key to have it again.",
        )
    )
    text = base64.b64encode(json.dumps(body).encode()).decode("ascii")
    status = body["status"]
    assert isinstance(status, int)  # noqa: S101 (as `problem_body` makes it)
    return status, {"body": text, "headers": {"content-type": "application/problem+json"}}
