"""How far a worker is, told to the server through a file."""

from __future__ import annotations

import asyncio
import contextlib
import json
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Final, TypeVar

T = TypeVar("T")

_POLL_SECONDS: Final = 0.25

# What is told sooner after the last time is not written.
_LEAST_SECONDS: Final = 0.1


class ProgressFile:
    """A file that a worker writes over and over.

    Parameters
    ----------
    path : Path
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._beside = path.with_name(f"{path.name}.new")
        self._written = -_LEAST_SECONDS
        self._text = ""

    def write(self, share: float, text: str = "") -> None:
        """Tell the share that is done, 0 to 1, and what is done now."""
        now = time.monotonic()
        # What is done now is always told: it may last.
        if text == self._text and now - self._written < _LEAST_SECONDS:
            return
        self._written, self._text = now, text
        # Renamed into place, so that it is never read half-written. No work fails because nobody
        # can be told how far it is.
        with contextlib.suppress(OSError):
            self._beside.write_text(json.dumps([share, text]))
            self._beside.replace(self._path)

    def read(self) -> tuple[float, str] | None:
        """Give what was told last; None before anything was."""
        try:
            share, text = json.loads(self._path.read_text())
        except (OSError, ValueError):
            return None
        return min(max(float(share), 0.0), 1.0), str(text)


async def followed(work: Awaitable[T], path: Path, report: Callable[[float, str], None]) -> T:
    """Wait for work, and report what its worker tells meanwhile.

    Parameters
    ----------
    work : awaitable
        Cancelled with what waits for it.
    path : Path
        Of the `ProgressFile` that the worker writes.
    report : callable
        Called now and again with what `ProgressFile.read` gives.
    """
    task, file = asyncio.ensure_future(work), ProgressFile(path)
    try:
        while not (await asyncio.wait([task], timeout=_POLL_SECONDS))[0]:
            told = file.read()
            if told is not None:
                report(*told)
        return await task
    except asyncio.CancelledError:
        task.cancel()
        raise
