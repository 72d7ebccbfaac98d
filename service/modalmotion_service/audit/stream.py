"""The audit log of a service that keeps nothing: a line of JSON for each event, on a stream."""

from __future__ import annotations

import json
import os
import secrets
import threading
from dataclasses import asdict
from typing import Final, Self

from modalmotion.errors import StoreError
from modalmotion.store.index.cursor import now
from modalmotion_service.audit.entry import GENESIS, Event, chained
from modalmotion_service.audit.notes import Notes

_DESCRIPTORS: Final = {"stdout": 1, "stderr": 2}


class AuditStream(Notes):
    """Writes events as lines, which whoever runs the service collects.

    Each line ends a chain of its own replica: its digest covers the one before, so that a line
    that is lost on the way shows. A start begins another chain, of another `replica`.

    Parameters
    ----------
    target : str
        "stdout", "stderr", or the path of a file, a pipe or a device, which is appended to.

    Raises
    ------
    StoreError
        If it cannot be opened.
    """

    def __init__(self, target: str) -> None:
        super().__init__()
        self.replica = secrets.token_hex(8)
        self._target = target
        self._place = GENESIS
        self._lock = threading.Lock()
        try:
            self._file = (
                os.open(target, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o600)
                if (target not in _DESCRIPTORS)
                else os.dup(_DESCRIPTORS[target])
            )
        except OSError as error:
            raise self._unwritten(error) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._file)

    async def look_after(self) -> None:
        """Do nothing: whoever collects the lines looks after them."""

    def append(self, events: list[Event]) -> None:
        """Write a line for each event.

        Raises
        ------
        StoreError
            If they cannot be written; lines that were written stay.
        """
        with self._lock:
            for event in events:
                entry = chained(self._place, now(), event)
                line = {
                    "audit": self.replica,
                    "number": entry.number,
                    "time": entry.time,
                    **asdict(event),
                    "sha256": entry.sha256,
                }
                left = memoryview(json.dumps(line).encode() + b"\n")
                try:
                    while left:
                        left = left[os.write(self._file, left) :]
                except OSError as error:
                    raise self._unwritten(error) from error
                self._place = entry.place

    def _unwritten(self, error: OSError) -> StoreError:
        return StoreError(
            f"The audit log cannot be written to {self._target[:80]!r}: {error.strerror}.",
            remedy="Name a stream or a file that this user may write to as "
            "MODALMOTION_AUDIT_STREAM.",
        )
