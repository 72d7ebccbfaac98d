"""One file of the audit log: appended to until it is closed for good."""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any, Final

from modalmotion.store.index.cursor import now
from modalmotion_service.access.database import explained, open_database
from modalmotion_service.audit.entry import AuditEntry, Event, Place, chained

_VERSION: Final = 2
_TABLES: Final = (
    """CREATE TABLE audit (
        number INTEGER PRIMARY KEY, time TEXT NOT NULL, request_id TEXT NOT NULL, owner TEXT,
        key_id TEXT, client TEXT NOT NULL, method TEXT NOT NULL, route TEXT NOT NULL,
        ids TEXT NOT NULL, status INTEGER NOT NULL, sha256 TEXT NOT NULL
    )""",
    "CREATE TABLE start (number INTEGER NOT NULL, sha256 TEXT NOT NULL)",
    # Against a slip of the hand; against intent there is the chain.
    """CREATE TRIGGER audit_is_not_changed BEFORE UPDATE ON audit
    BEGIN SELECT raise(ABORT, 'the audit log is not changed'); END""",
    """CREATE TRIGGER audit_is_not_shortened BEFORE DELETE ON audit
    BEGIN SELECT raise(ABORT, 'the audit log is not changed'); END""",
)
_CLOSE: Final = """CREATE TRIGGER audit_is_closed BEFORE INSERT ON audit
    BEGIN SELECT raise(ABORT, 'this file of the audit log is closed'); END"""
_PIECE: Final = 10_000


class PartClosedError(Exception):
    """Another process has closed this file: the log goes on in the next one."""


@dataclass(frozen=True)
class AuditPart:
    """A file of the log, read while others may write it.

    Parameters
    ----------
    path : Path
    """

    path: Path

    def is_prepared(self) -> bool:
        """Tell whether it has its tables: a crash may leave one without."""
        with self._reading() as file:
            (version,) = file.execute("PRAGMA user_version").fetchone()
            return bool(version)

    def is_closed(self) -> bool:
        """Tell whether nothing more is appended to it."""
        with self._reading() as file:
            return _is_closed(file)

    def start(self) -> Place:
        """Place of the entry before its first one."""
        with self._reading() as file:
            return _start(file)

    def end(self) -> Place:
        """Place of its last entry."""
        with self._reading() as file:
            return _end(file)

    def last_time(self) -> str | None:
        """When its last entry was written, ISO 8601 in UTC; None where it has none."""
        with self._reading() as file:
            (time,) = file.execute(
                "SELECT (SELECT time FROM audit ORDER BY number DESC LIMIT 1)"
            ).fetchone()
            return None if time is None else str(time)

    def settle(self) -> None:
        """Have all of a closed file in that one file, and not partly in SQLite's log beside it.

        Raises
        ------
        StoreError
            If somebody is reading it.
        """
        with explained(self.path.name), closing(sqlite3.connect(self.path)) as file:
            file.execute("PRAGMA journal_mode = DELETE")

    def page(self, *, limit: int, before: int | None, owner: str | None) -> list[AuditEntry]:
        """Entries from the newest to the oldest, as `AuditLog.page` asks for them."""
        with self._reading() as file:
            rows = file.execute(
                "SELECT * FROM audit WHERE number < ? AND (? IS NULL OR owner = ?) "
                "ORDER BY number DESC LIMIT ?",
                (before if before is not None else 1 << 62, owner, owner, limit),
            ).fetchall()
        return [_entry(row) for row in rows]

    def entries(self) -> Iterator[AuditEntry]:
        """All entries in order; what is appended meanwhile comes too."""
        last = 0
        with self._reading() as file:
            # Piece by piece: a file may be larger than memory.
            while rows := file.execute(
                f"SELECT * FROM audit WHERE number > ? ORDER BY number LIMIT {_PIECE}",  # noqa: S608
                (last,),
            ).fetchall():
                yield from map(_entry, rows)
                last = rows[-1][0]

    @contextmanager
    def _reading(self) -> Iterator[sqlite3.Connection]:
        with explained(self.path.name):
            uri = f"{self.path.absolute().as_uri()}?mode=ro"
            with closing(sqlite3.connect(uri, uri=True)) as file:
                yield file


class AuditWriter:
    """A file of the log, open for appending; several processes may have it open at once.

    Parameters
    ----------
    path : Path
        Made where it is missing.
    start : Place
        Of the entry before, for a new file.
    """

    def __init__(self, path: Path, start: Place) -> None:
        self._name = path.name
        first = f"INSERT INTO start VALUES ({start.number:d}, '{start.sha256}')"  # noqa: S608
        self._connection = open_database(path, (*_TABLES, first), _VERSION)
        with explained(self._name):
            self._start = _start(self._connection)
            self._last = _end(self._connection)

    @property
    def n_entries(self) -> int:
        """How many were in it when it was last written to."""
        return self._last.number - self._start.number

    def append(self, events: Sequence[Event]) -> None:
        """Append events in one transaction.

        Raises
        ------
        PartClosedError
            If the log goes on in another file.
        StoreError
            If they cannot be written; then none of them is.
        """
        with self._writing() as file:
            last = _end(file)
            for event in events:
                entry = chained(last, now(), event)
                file.execute(
                    "INSERT INTO audit VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
                    (entry.number, entry.time, *astuple(event), entry.sha256),
                )
                last = entry.place
        self._last = last

    def close_for_good(self) -> None:
        """Let nothing more be appended, by any process.

        Raises
        ------
        PartClosedError
            If it was closed already.
        """
        with self._writing() as file:
            file.execute(_CLOSE)
        # As `AuditPart.settle`; where somebody reads it at this moment, archiving does it.
        with contextlib.suppress(sqlite3.OperationalError):
            self._connection.execute("PRAGMA journal_mode = DELETE")

    def close(self) -> None:
        """Close the file, to be opened again."""
        self._connection.close()

    @contextmanager
    def _writing(self) -> Iterator[sqlite3.Connection]:
        file = self._connection
        with explained(self._name):
            # One that a failing disk did not let us roll back would keep out all others.
            _roll_back(file)
            file.execute("BEGIN IMMEDIATE")
            try:
                _require_open(file)
                yield file
                file.execute("COMMIT")
            except BaseException:
                with contextlib.suppress(sqlite3.Error):
                    _roll_back(file)
                raise


def _roll_back(file: sqlite3.Connection) -> None:
    if file.in_transaction:
        file.execute("ROLLBACK")


def _is_closed(file: sqlite3.Connection) -> bool:
    rows = file.execute("SELECT 1 FROM sqlite_master WHERE name = 'audit_is_closed'")
    return rows.fetchone() is not None


def _require_open(file: sqlite3.Connection) -> None:
    if _is_closed(file):
        raise PartClosedError


def _start(file: sqlite3.Connection) -> Place:
    return Place(*file.execute("SELECT number, sha256 FROM start").fetchone())


def _end(file: sqlite3.Connection) -> Place:
    rows = file.execute("SELECT number, sha256 FROM audit ORDER BY number DESC LIMIT 1")
    row: tuple[int, str] | None = rows.fetchone()
    return _start(file) if row is None else Place(*row)


def _entry(row: tuple[Any, ...]) -> AuditEntry:
    number, time, *event, digest = row
    return AuditEntry(number, time, Event(*event), digest)
