"""The audit log: who did what to which id, durable before the answer leaves.

Entries are committed together: while one transaction reaches the disk, those that come wait for
the next.
"""

from __future__ import annotations

import abc
import asyncio
import contextlib
import os
import secrets
import sqlite3
import threading
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import astuple
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Final, Self

from modalmotion.store.index import now, to_text
from modalmotion_service.access.keys import Key, KeyRing, explained, open_database
from modalmotion_service.access.scopes import Scope
from modalmotion_service.audit.entry import BEGUN, GENESIS, AuditEntry, Event, Lines, chained

_VERSION: Final = 3
_TABLES: Final = (
    """CREATE TABLE audit (
        number INTEGER PRIMARY KEY, time TEXT NOT NULL, request_id TEXT NOT NULL, owner TEXT,
        key_id TEXT, client TEXT NOT NULL, method TEXT NOT NULL, route TEXT NOT NULL,
        ids TEXT NOT NULL, status INTEGER NOT NULL, sha256 TEXT NOT NULL
    )""",
)
_LAST: Final = "SELECT number, sha256 FROM audit ORDER BY number DESC LIMIT 1"
_PIECE: Final = 10_000


class Notes(abc.ABC):
    """Where events are noted; while some are written, those that come wait for the next time."""

    def __init__(self) -> None:
        self._pending: list[tuple[Event, asyncio.Future[None]]] = []
        self._writing: asyncio.Task[None] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @abc.abstractmethod
    def close(self) -> None:
        """Let go of what is open."""

    @abc.abstractmethod
    def append(self, events: list[Event]) -> None:
        """Append events.

        Raises
        ------
        StoreError
            If they cannot be written.
        """

    async def note(self, event: Event) -> None:
        """Append an event; it is written when this returns.

        Raises
        ------
        StoreError
            If it cannot be written.
        """
        done: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._pending.append((event, done))
        if self._writing is None:
            self._writing = asyncio.create_task(self._write_pending())
        await done

    async def drain(self) -> None:
        """Wait until everything that was noted is written."""
        if self._writing is not None:
            await asyncio.wait([self._writing])

    async def _write_pending(self) -> None:
        try:
            while self._pending:
                batch, self._pending = self._pending, []
                try:
                    await asyncio.to_thread(self.append, [event for event, _ in batch])
                except BaseException as error:
                    for _, done in batch:
                        if not done.done():
                            done.set_exception(error)
                    if not isinstance(error, Exception):
                        raise
                else:
                    for _, done in batch:
                        if not done.done():
                            done.set_result(None)
        finally:
            self._writing = None


class AuditLog(Notes):
    """The audit log of a data folder; server and command line may have it open at once.

    Parameters
    ----------
    data_dir : Path
    lines : Lines, optional
        Where each entry goes too: whoever can write to the folder cannot change it there.
    """

    def __init__(self, data_dir: Path, lines: Lines | None = None) -> None:
        super().__init__()
        self._path = audit_path(data_dir)
        self._lines = lines
        self._lock = threading.Lock()
        self._file = open_database(self._path, _TABLES, _VERSION)

    def close(self) -> None:
        """Close the file, and let go of the lines."""
        with self._lock:
            self._file.close()
            if self._lines is not None:
                self._lines.close()

    def append(self, events: list[Event]) -> None:
        """Append events in one transaction, then hand them on.

        Raises
        ------
        StoreError
            If they cannot be written: then none of them is; or not handed on.
        """
        with self._lock:
            entries = []
            with self._transaction() as file:
                number, before = file.execute(_LAST).fetchone() or (0, GENESIS)
                for event in events:
                    entry = chained(number + 1, before, now(), event)
                    file.execute(
                        "INSERT INTO audit VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
                        (entry.number, entry.time, *astuple(event), entry.sha256),
                    )
                    entries.append(entry)
                    number, before = entry.number, entry.sha256
            if self._lines is not None:
                for entry in entries:
                    self._lines.write(entry, "table")

    def forget_before(self, days: float) -> None:
        """Remove entries that are older; the last one stays, for the chain goes on from it."""
        past = to_text((datetime.now(UTC) - timedelta(days=days)).timestamp())
        with self._lock, self._transaction() as file:
            file.execute(
                "DELETE FROM audit WHERE time < ? AND number < (SELECT max(number) FROM audit)",
                (past,),
            )

    def page(
        self, *, limit: int, before: int | None = None, owner: str | None = None
    ) -> list[AuditEntry]:
        """Read entries from the newest to the oldest.

        Parameters
        ----------
        limit : int
        before : int, optional
            Only those with a smaller number.
        owner : str, optional
            Only those of this owner.
        """
        with self._lock, explained(self._path.name):
            rows = self._file.execute(
                "SELECT * FROM audit WHERE number < ? AND (? IS NULL OR owner = ?) "
                "ORDER BY number DESC LIMIT ?",
                (before if before is not None else 1 << 62, owner, owner, limit),
            ).fetchall()
        return [_entry(row) for row in rows]

    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        file = self._file
        with explained(self._path.name):
            # One that a failing disk did not let us roll back would keep out all others.
            if file.in_transaction:
                file.execute("ROLLBACK")
            file.execute("BEGIN IMMEDIATE")
            try:
                yield file
                file.execute("COMMIT")
            except BaseException:
                with contextlib.suppress(sqlite3.Error):
                    file.execute("ROLLBACK")
                raise


class AuditStream(Notes):
    """The audit log of a service that keeps nothing: lines alone, which others collect.

    Each line ends a chain of its own replica: its digest covers the one before, so that a line
    that is lost on the way shows. A start begins another chain, of another `replica`.

    Parameters
    ----------
    lines : Lines
    """

    def __init__(self, lines: Lines) -> None:
        super().__init__()
        self.replica = secrets.token_hex(8)
        self._lines = lines
        self._number, self._before = 0, GENESIS
        self._lock = threading.Lock()

    def close(self) -> None:
        """Let go of the lines."""
        self._lines.close()

    def append(self, events: list[Event]) -> None:
        """Write a line for each event; lines that were written before an error stay."""
        with self._lock:
            for event in events:
                entry = chained(self._number + 1, self._before, now(), event)
                self._lines.write(entry, self.replica)
                self._number, self._before = entry.number, entry.sha256


def audit_path(data_dir: Path) -> Path:
    """Where the audit log of a data folder is."""
    return data_dir / "access" / "audit.sqlite"


def entries_of(path: Path) -> Iterator[AuditEntry]:
    """Give all entries of a log in order, of one that a service may be writing."""
    last = 0
    uri = f"{path.absolute().as_uri()}?mode=ro"
    with explained(path.name), closing(sqlite3.connect(uri, uri=True)) as file:
        # Piece by piece: it may be larger than memory.
        while rows := file.execute(
            f"SELECT * FROM audit WHERE number > ? ORDER BY number LIMIT {_PIECE}",  # noqa: S608
            (last,),
        ).fetchall():
            yield from map(_entry, rows)
            last = rows[-1][0]


def faults_of(
    entries: Iterable[AuditEntry], lines: Mapping[int, str], *, forgets: bool = False
) -> tuple[int, list[str]]:
    """Check a chain, and compare it with lines that were handed on.

    Parameters
    ----------
    entries : iterable of AuditEntry
    lines : mapping
        Digests by number, as they were collected elsewhere.
    forgets : bool
        Whether entries are removed when their time has passed, so that it may begin later.

    Returns
    -------
    number : int
        Of entries.
    faults : list of str
    """
    faults: list[str] = []
    n_entries, number, before = 0, 0, GENESIS
    for entry in entries:
        n_entries += 1
        is_first_left = forgets and n_entries == 1 and entry.number > 1
        if entry.number != number + 1 and not is_first_left:
            faults.append(f"entries {number + 1} to {entry.number - 1} are missing")
        if entry != chained(entry.number, before, entry.time, entry.event) and not is_first_left:
            faults.append(f"entry {entry.number} is not what was written, or follows another")
        number, before = entry.number, entry.sha256
        if lines.get(entry.number, entry.sha256) != entry.sha256:
            faults.append(f"entry {entry.number} is not the one that was handed on")
    if not n_entries:
        faults.append("there is no entry: the log is new, or was emptied")
    if (most := max(lines, default=0)) > number:
        faults.append(f"entry {most} was handed on, and the log ends before it: its end is gone")
    return n_entries, faults


def unfinished(entries: Iterable[AuditEntry]) -> list[AuditEntry]:
    """List the changes that were begun and have no end: under way, or cut off by a crash."""
    begun: dict[tuple[str | None, ...], list[AuditEntry]] = {}
    for entry in entries:
        event = entry.event
        # A client may give one request id to several requests.
        same = begun.setdefault((event.request_id, event.key_id, event.method, event.route), [])
        if event.status == BEGUN:
            same.append(entry)
        elif same:
            same.pop(0)
        if not same:
            del begun[event.request_id, event.key_id, event.method, event.route]
    return sorted((one for same in begun.values() for one in same), key=lambda one: one.number)


def _entry(row: tuple[Any, ...]) -> AuditEntry:
    number, time, *event, digest = row
    return AuditEntry(number, time, Event(*event), digest)


def make_key(
    data_dir: Path,
    owner: str,
    scopes: Collection[Scope],
    *,
    note: str = "",
    expires: datetime | None = None,
) -> tuple[Key, str]:
    """Make a key as `KeyRing.create` does, and note it; one that cannot be noted is taken back."""
    with KeyRing(data_dir) as ring, AuditLog(data_dir) as log:
        return note_key(ring.create(owner, scopes, note=note, expires=expires), ring, log)


def note_key(made: tuple[Key, str], ring: KeyRing, log: Notes) -> tuple[Key, str]:
    """Note a key that was just made; one that cannot be noted is taken back."""
    key, _ = made
    try:
        log.append([of_command("keys create", key.owner, key.id)])
    except BaseException:
        ring.revoke(key.id)
        raise
    return made


def take_back_key(data_dir: Path, key_id: str) -> Key:
    """Take a key back as `KeyRing.revoke` does, and note it."""
    with KeyRing(data_dir) as ring, AuditLog(data_dir) as log:
        key = ring.revoke(key_id)
        log.append([of_command("keys revoke", key.owner, key.id)])
    return key


def of_command(command: str, owner: str | None, about: str, status: int = 200) -> Event:
    """Make the entry of a command, by the user of the system who gave it."""
    return Event(
        request_id="",
        owner=owner,
        key_id=None,
        client=f"command line, uid {os.getuid()}",
        method="COMMAND",
        route=command,
        ids=about,
        status=status,
    )
