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
    """A file that a worker adds lines to, and that the server reads on from where it was.

    Parameters
    ----------
    path : Path
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._written = -_LEAST_SECONDS
        self._text = ""
        self._share = 0.0
        self._n_read = 0

    def write(self, share: float, text: str = "") -> None:
        """Return the share that is done, 0 to 1, and what is done now."""
        now = time.monotonic()
        # What is done now is always told: it may last. So is that something is done at all, or
        # quick work would go from nothing to its end.
        is_news = text != self._text or (self._share == 0.0 and share > 0.0)
        if not is_news and now - self._written < _LEAST_SECONDS:
            return
        self._written, self._text, self._share = now, text, share
        # No work fails because nobody can be told how far it is.
        with contextlib.suppress(OSError), self._path.open("a") as file:
            file.write(json.dumps([share, text]) + "\n")

    def news(self) -> list[tuple[float, str]]:
        """Give what was told since the last call, in its order."""
        try:
            with self._path.open("rb") as file:
                file.seek(self._n_read)
                # The last line may be half-written.
                whole = file.read().rpartition(b"\n")[0]
        except OSError:
            return []
        self._n_read += len(whole) + bool(whole)
        told: list[tuple[float, str]] = []
        for line in whole.splitlines():
            # A worker that was killed may have left half a line.
            with contextlib.suppress(ValueError):
                share, text = json.loads(line)
                told.append((min(max(float(share), 0.0), 1.0), str(text)))
        return told


async def followed(work: Awaitable[T], path: Path, report: Callable[[float, str], None]) -> T:
    """Wait for work, and report what its worker tells: all of it, however fast the work is.

    Parameters
    ----------
    work : awaitable
        Cancelled with what waits for it.
    path : Path
        Of the `ProgressFile` that the worker writes; what others wrote to it is removed.
    report : callable
        Called now and again with what `ProgressFile.news` gives.
    """
    path.unlink(missing_ok=True)
    task, file = asyncio.ensure_future(work), ProgressFile(path)
    try:
        is_done = False
        while not is_done:
            is_done = bool((await asyncio.wait([task], timeout=_POLL_SECONDS))[0])
            for share, text in file.news():
                report(share, text)
        return await task
    except asyncio.CancelledError:
        task.cancel()
        raise
