"""The audit log: who did what to which id; appended to, never changed, and durable.

Entries are committed together: while one transaction reaches the disk, those that come wait for
the next. An answer leaves after its entry is on the disk.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from dataclasses import astuple, dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

from modalmotion.store.cursor import now
from modalmotion_service.access.audit_entry import GENESIS, AuditEntry, Event, chained
from modalmotion_service.access.database import explained, open_database

_VERSION: Final = 1
_TABLES: Final = (
    """CREATE TABLE audit (
        number INTEGER PRIMARY KEY, time TEXT NOT NULL, request_id TEXT NOT NULL, owner TEXT,
        key_id TEXT, client TEXT NOT NULL, method TEXT NOT NULL, route TEXT NOT NULL,
        ids TEXT NOT NULL, status INTEGER NOT NULL, sha256 TEXT NOT NULL
    )""",
    # Against a slip of the hand; against intent there is the chain.
    """CREATE TRIGGER audit_is_not_changed BEFORE UPDATE ON audit
    BEGIN SELECT raise(ABORT, 'the audit log is not changed'); END""",
    """CREATE TRIGGER audit_is_not_shortened BEFORE DELETE ON audit
    BEGIN SELECT raise(ABORT, 'the audit log is not changed'); END""",
)


@dataclass(frozen=True)
class AuditReport:
    """What a check of the log found.

    Parameters
    ----------
    n_entries : int
    head : str
        Digest of the last entry: noted elsewhere, it shows later that nothing before is gone.
    faults : tuple of str
    """

    n_entries: int
    head: str
    faults: tuple[str, ...]


class AuditLog:
    """The audit log of a data folder; server and command line may have it open at once.

    Parameters
    ----------
    data_dir : Path
    """

    def __init__(self, data_dir: Path) -> None:
        self._path = data_dir / "access" / "audit.sqlite"
        self._lock = threading.Lock()
        self._connection = open_database(self._path, _TABLES, _VERSION)
        self._pending: list[tuple[Event, asyncio.Future[None]]] = []
        self._writing: asyncio.Task[None] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            self._connection.close()

    async def note(self, event: Event) -> None:
        """Append an event; it is durable when this returns.

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

    def append(self, events: list[Event]) -> None:
        """Append events in one transaction.

        Raises
        ------
        StoreError
            If they cannot be written; then none of them is.
        """
        with self._lock, explained(self._path.name):
            self._connection.execute("BEGIN IMMEDIATE")
            try:
                number, head = self._last()
                for event in events:
                    number += 1
                    entry = chained(head, number, now(), event)
                    head = entry.sha256
                    self._connection.execute(
                        "INSERT INTO audit VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
                        (number, entry.time, *astuple(event), head),
                    )
                self._connection.execute("COMMIT")
            except BaseException:
                if self._connection.in_transaction:
                    self._connection.execute("ROLLBACK")
                raise

    def page(
        self, *, limit: int, before: int | None = None, owner: str | None = None
    ) -> list[AuditEntry]:
        """Entries from the newest to the oldest.

        Parameters
        ----------
        limit : int
        before : int, optional
            Only those with a smaller number.
        owner : str, optional
            Only those of this owner.
        """
        with self._lock, explained(self._path.name):
            rows = self._connection.execute(
                "SELECT * FROM audit WHERE number < ? AND (? IS NULL OR owner = ?) "
                "ORDER BY number DESC LIMIT ?",
                (before if before is not None else 1 << 62, owner, owner, limit),
            ).fetchall()
        return [_entry(row) for row in rows]

    def verify(self, anchor: tuple[int, str] | None = None) -> AuditReport:
        """Check the whole chain.

        Parameters
        ----------
        anchor : tuple of int and str, optional
            Number and digest of an entry, as an earlier check gave them.
        """
        faults: list[str] = []
        number, head = 0, GENESIS
        anchored = anchor is None or anchor == (0, GENESIS)
        for entry in self._in_order():
            if entry.number != number + 1:
                faults.append(f"entries {number + 1} to {entry.number - 1} are missing")
            expected = chained(head, entry.number, entry.time, entry.event).sha256
            if entry.sha256 != expected:
                faults.append(f"entry {entry.number} is not what was written, or follows another")
            number, head = entry.number, entry.sha256
            anchored = anchored or (number, head) == anchor
        if anchor is not None and not anchored:
            faults.append(f"entry {anchor[0]} with the digest that was noted is not there")
        return AuditReport(number, head, tuple(faults))

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

    def _last(self) -> tuple[int, str]:
        rows = self._connection.execute(
            "SELECT number, sha256 FROM audit ORDER BY number DESC LIMIT 1"
        )
        found: tuple[int, str] | None = rows.fetchone()
        return (0, GENESIS) if found is None else found

    def _in_order(self) -> Iterator[AuditEntry]:
        last = 0
        while True:
            # Piece by piece: the log may be larger than memory, and a server may be writing.
            with self._lock, explained(self._path.name):
                rows = self._connection.execute(
                    "SELECT * FROM audit WHERE number > ? ORDER BY number LIMIT 10000", (last,)
                ).fetchall()
            if not rows:
                return
            yield from map(_entry, rows)
            last = rows[-1][0]


def _entry(row: tuple[Any, ...]) -> AuditEntry:
    number, time, *event, digest = row
    return AuditEntry(number, time, Event(*event), digest)
