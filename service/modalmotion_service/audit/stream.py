"""The audit log as lines: on a stream, in a file, or to a log host by syslog."""

from __future__ import annotations

import contextlib
import io
import json
import os
import socket
from typing import Final
from urllib.parse import urlsplit

from modalmotion.errors import StoreError
from modalmotion_service.audit.entry import AuditEntry

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
