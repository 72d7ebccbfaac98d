"""One entry of the audit log, the chain that ties it to those before, and its lines."""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import os
import socket
from dataclasses import asdict, dataclass
from typing import Any, Final
from urllib.parse import urlsplit

from modalmotion.errors import StoreError

BEGUN: Final = 102
"""Status of an entry that is written before something is changed; another one follows it."""

GENESIS: Final = "0" * 64
"""In place of the digest of the entry before the first one."""


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
class AuditEntry:
    """An event as it is in the log.

    Parameters
    ----------
    number : int
        Counted from 1, without gaps.
    time : str
        UTC, ISO 8601 with microseconds.
    event : Event
    sha256 : str
        Of this entry and of the digest of the one before.
    """

    number: int
    time: str
    event: Event
    sha256: str

    @property
    def line(self) -> dict[str, Any]:
        """All of it as JSON."""
        return {
            "number": self.number,
            "time": self.time,
            **asdict(self.event),
            "sha256": self.sha256,
        }

    @property
    def fhir(self) -> dict[str, Any]:
        """The same as an AuditEvent of FHIR R4."""
        event = self.event
        outcome = "0" if event.status < 400 else "4" if event.status < 500 else "8"
        agent = {"requestor": True, "network": {"address": event.client, "type": "2"}}
        if event.owner is not None:
            agent["who"] = {"identifier": {"value": event.owner}}
        if event.key_id is not None:
            agent["altId"] = event.key_id
        return {
            "resourceType": "AuditEvent",
            "id": self.sha256,
            "type": {
                "system": "http://terminology.hl7.org/CodeSystem/audit-event-type",
                "code": "rest",
            },
            "subtype": [{"display": f"{event.method} {event.route}"}],
            "action": _ACTIONS.get(event.method, "E"),
            "recorded": self.time,
            "outcome": outcome,
            "outcomeDesc": str(event.status),
            "agent": [agent],
            "source": {"observer": {"display": "modalmotion"}},
            "entity": [
                *({"what": {"identifier": {"value": one}}} for one in event.ids.split()),
                {"what": {"identifier": {"value": event.request_id}}, "name": "request"},
            ],
        }


_ACTIONS: Final = {"GET": "R", "HEAD": "R", "POST": "C", "PATCH": "U", "PUT": "U", "DELETE": "D"}


def chained(number: int, before: str, time: str, event: Event) -> AuditEntry:
    """Tie an event to the entry before.

    Parameters
    ----------
    number : int
    before : str
        Digest of the entry before.
    time : str
    event : Event
    """
    # JSON, and not the values one after another: no two events are written alike.
    text = json.dumps([before, number, time, asdict(event)], sort_keys=True)
    return AuditEntry(number, time, event, hashlib.sha256(text.encode()).hexdigest())


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
        content = entry.fhir if self._form == "fhir" else {"audit": log, **entry.line}
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
