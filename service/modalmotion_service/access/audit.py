"""The audit log: who did what to which id, durable before the answer leaves.

It is a table of SQLite, lines to a stream or a log host, or both. Entries are committed together:
while one transaction reaches the disk, those that come wait for the next.
"""

import asyncio
import contextlib
import io
import json
import os
import secrets
import socket
import threading
from dataclasses import asdict, astuple, dataclass
from datetime import UTC, datetime, timedelta
from itertools import count, starmap
from pathlib import Path
from typing import Any, Final, Self
from urllib.parse import urlsplit

from modalmotion.errors import StoreError
from modalmotion.store.database import Database
from modalmotion.store.index import now, to_text
from modalmotion_service.access.keys import Key, KeyRing, open_database

BEGUN: Final = 102
"""Status of an entry that is written before something is changed; another one follows it."""

AUDIT: Final = "access/audit.sqlite"
"""Where the log is in a data folder."""

_VERSION: Final = 4
_TABLES: Final = (
    """CREATE TABLE audit (
        request_id TEXT NOT NULL, owner TEXT, key_id TEXT, client TEXT NOT NULL,
        method TEXT NOT NULL, route TEXT NOT NULL, ids TEXT NOT NULL, status INTEGER NOT NULL,
        time TEXT NOT NULL, number INTEGER PRIMARY KEY AUTOINCREMENT
    )""",
)
_INSERT: Final = "INSERT INTO audit VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, NULL)"


@dataclass(frozen=True)
class Event:
    """Who requested what.

    Parameters
    ----------
    request_id : str
    owner, key_id : str or None
        None if nobody was recognised; the key is None for this machine without keys.
    client : str
        Address.
    method, route : str
        The route by its template.
    ids : str
        Ids that it concerned, separated by blanks.
    status : int
        Of the answer, or `BEGUN`.
    """

    request_id: str
    owner: str | None
    key_id: str | None
    client: str
    method: str
    route: str
    ids: str
    status: int


@dataclass(frozen=True)
class AuditEntry(Event):
    """An event as it is in the log.

    Parameters
    ----------
    time : str
        UTC, ISO 8601 with microseconds.
    number : int
        Counted from 1, without gaps.
    """

    time: str
    number: int

    def fhir(self, log: str) -> dict[str, Any]:
        """Write it as an AuditEvent of FHIR R4, of the log of that name."""
        outcome = "0" if self.status < 400 else "4" if self.status < 500 else "8"
        agent = {"requestor": True, "network": {"address": self.client, "type": "2"}}
        if self.owner is not None:
            agent["who"] = {"identifier": {"value": self.owner}}
        if self.key_id is not None:
            agent["altId"] = self.key_id
        return {
            "resourceType": "AuditEvent",
            # The time, for a log host may have lines of several services.
            "id": f"{log}-{self.number}-{self.time.replace(':', '')}",
            "type": {
                "system": "http://terminology.hl7.org/CodeSystem/audit-event-type",
                "code": "rest",
            },
            "subtype": [{"display": f"{self.method} {self.route}"}],
            "action": _ACTIONS.get(self.method, "E"),
            "recorded": self.time,
            "outcome": outcome,
            "outcomeDesc": str(self.status),
            "agent": [agent],
            "source": {"observer": {"display": "modalmotion"}},
            "entity": [
                *({"what": {"identifier": {"value": one}}} for one in self.ids.split()),
                {"what": {"identifier": {"value": self.request_id}}, "name": "request"},
            ],
        }


_ACTIONS: Final = {"GET": "R", "HEAD": "R", "POST": "C", "PATCH": "U", "PUT": "U", "DELETE": "D"}
_DESCRIPTORS: Final = {"stdout": 1, "stderr": 2}
# Facility "log audit" (13), severity "informational" (6), RFC 5424.
_PRIORITY: Final = f"<{13 * 8 + 6}>"
_SECONDS: Final = 5.0


class Lines:
    """Where lines go; each is handed over before `write` returns.

    Parameters
    ----------
    target : str
        "stdout"; "stderr"; "syslog", the one of this machine; "syslog://host:port", one that takes
        lines over TCP; or the path of a file, a pipe or a device, which is appended to.
    form : "json" or "fhir"

    Raises
    ------
    StoreError
        If it cannot be opened.
    """

    def __init__(self, target: str, form: str = "json") -> None:
        self._target = target
        self._form = form
        self._sink = self._opened()

    def write(self, entry: AuditEntry, log: str) -> None:
        """Write an entry, of the log of that name.

        Raises
        ------
        StoreError
            If it cannot be written.
        """
        content = entry.fhir(log) if self._form == "fhir" else {"audit": log, **asdict(entry)}
        line = json.dumps(content).encode()
        try:
            try:
                self._send(line)
            except OSError:
                # A log host that was begun anew has closed the connection.
                if not self._target.startswith("syslog"):
                    raise
                self.close()
                self._sink = self._opened()
                self._send(line)
        except OSError as error:
            raise self._unwritten(error) from error

    def close(self) -> None:
        """Let go of what was opened."""
        self._sink.close()

    def _opened(self) -> socket.socket | io.FileIO:
        try:
            if self._target in _DESCRIPTORS:
                return io.FileIO(os.dup(_DESCRIPTORS[self._target]), "wb")
            if not self._target.startswith("syslog"):
                flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC
                return io.FileIO(os.open(self._target, flags, 0o600), "wb")
            address = urlsplit(self._target)
            if address.hostname is not None:
                return socket.create_connection((address.hostname, address.port or 514), _SECONDS)
            with contextlib.ExitStack() as stack:
                here = stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM))
                here.connect(address.path or "/dev/log")
                stack.pop_all()
                return here
        except (OSError, ValueError) as error:
            raise self._unwritten(error) from error

    def _send(self, line: bytes) -> None:
        if isinstance(self._sink, io.FileIO):
            left = memoryview(line + b"\n")
            while left:
                left = left[self._sink.write(left) :]
        elif self._sink.family == socket.AF_UNIX:
            self._sink.sendall(f"{_PRIORITY}modalmotion: ".encode() + line)
        else:
            head = f"{_PRIORITY}1 - {socket.gethostname()} modalmotion {os.getpid()} audit - "
            self._sink.sendall(head.encode() + line + b"\n")

    def _unwritten(self, error: Exception) -> StoreError:
        return StoreError(
            f"The audit log cannot be written to {self._target[:80]!r}: "
            f"{getattr(error, 'strerror', None) or error}.",
            remedy="Name a stream, a log host or a file that this user may write to as "
            "MODALMOTION_AUDIT_STREAM.",
        )


class AuditLog:
    """The audit log of a data folder, which several processes may have open, or lines alone.

    Parameters
    ----------
    data_dir : Path or None
        None of a service that keeps nothing. Its lines are numbered from 1 under a name that each
        start draws anew, so that a line that is lost on the way shows.
    lines : Lines, optional
        Where each entry goes too: whoever can write to the folder cannot change it there.
    """

    def __init__(self, data_dir: Path | None, lines: Lines | None = None) -> None:
        self._lines = lines
        self._lock = threading.Lock()
        self._pending: list[tuple[Event, asyncio.Future[None]]] = []
        self._writing: asyncio.Task[None] | None = None
        self._file: Database | None = None
        self._name, self._numbers = secrets.token_hex(8), count(1)
        if data_dir is not None:
            self._name, self._file = "table", open_database(data_dir / AUDIT, _TABLES, _VERSION)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with self._lock:
            if self._file is not None:
                self._file.close()
            if self._lines is not None:
                self._lines.close()

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

    def append(self, events: list[Event]) -> None:
        """Append events in one transaction, then hand them on.

        Raises
        ------
        StoreError
            If they cannot be written: then none of them is; or not handed on.
        """
        with self._lock:
            times = [now() for _ in events]
            if self._file is None:
                numbers = [next(self._numbers) for _ in events]
            else:
                with self._file.write() as table:
                    rows = [(*astuple(one), time) for one, time in zip(events, times, strict=True)]
                    numbers = [table.execute(_INSERT, row).lastrowid or 0 for row in rows]
            if self._lines is not None:
                for event, time, number in zip(events, times, numbers, strict=True):
                    self._lines.write(
                        AuditEntry(**vars(event), time=time, number=number), self._name
                    )

    def forget_before(self, days: float) -> None:
        """Remove entries that are older; numbers go on."""
        past = to_text((datetime.now(UTC) - timedelta(days=days)).timestamp())
        with self._table.write() as table:
            table.execute("DELETE FROM audit WHERE time < ?", (past,))

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
        rows = self._table.read(
            "SELECT * FROM audit WHERE number < ? AND (? IS NULL OR owner = ?) "
            "ORDER BY number DESC LIMIT ?",
            (before if before is not None else 1 << 62, owner, owner, limit),
        )
        return [*starmap(AuditEntry, rows)]

    def unfinished(self) -> list[AuditEntry]:
        """List the changes that were begun and have no end: under way, or cut off by a crash."""
        begun: dict[tuple[str | None, ...], list[AuditEntry]] = {}
        last, some = 0, "SELECT * FROM audit WHERE number > ? ORDER BY number LIMIT 10000"
        while rows := self._table.read(some, (last,)):
            for one in starmap(AuditEntry, rows):
                # A client may give one request id to several requests.
                same = begun.setdefault((one.request_id, one.key_id, one.method, one.route), [])
                if one.status == BEGUN:
                    same.append(one)
                elif same:
                    same.pop(0)
                if not same:
                    del begun[one.request_id, one.key_id, one.method, one.route]
                last = one.number
        return sorted((one for same in begun.values() for one in same), key=lambda one: one.number)

    @property
    def _table(self) -> Database:
        assert self._file is not None  # noqa: S101 (lines alone have no reader)
        return self._file


def note_key(made: tuple[Key, str], ring: KeyRing, log: AuditLog) -> tuple[Key, str]:
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
    client = f"command line, uid {os.getuid()}"
    return Event("", owner, None, client, "COMMAND", command, about, status)
