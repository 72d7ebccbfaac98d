"""The keys of a data folder that is only read, such as a backup."""

from __future__ import annotations

import contextlib
import sqlite3
import threading
from pathlib import Path
from typing import Any
from urllib.parse import quote

from modalmotion_service.access.database import explained
from modalmotion_service.access.keys import Authenticator


class KeySnapshot(Authenticator):
    """Keys as they stand in a file, which is read anew when another one takes its place.

    Nothing is written, not even beside it: the folder may be one that nobody can write to. While
    the file is away or damaged every key is refused with an error of the store.

    Parameters
    ----------
    data_dir : Path or None
        None knows no key.
    """

    def __init__(self, data_dir: Path | None) -> None:
        self._path = None if data_dir is None else data_dir / "access" / "keys.sqlite"
        self._lock = threading.Lock()
        self._seen: tuple[int, ...] = ()
        self._rows: dict[str, tuple[Any, ...]] = {}
        if self._path is not None and self._path.exists():
            self._row("")

    def __len__(self) -> int:
        """Give how many keys are known, whether they are active or not."""
        return len(self._rows)

    def _row(self, key_id: str) -> tuple[Any, ...] | None:
        if self._path is None:
            return None
        with self._lock, explained(self._path.name):
            log = self._path.with_name(f"{self._path.name}-wal")
            try:
                status = self._path.stat()
            except OSError as error:
                raise sqlite3.OperationalError(error.strerror) from error
            seen = [status]
            with contextlib.suppress(OSError):
                seen.append(log.stat())
            marks = tuple(
                mark for one in seen for mark in (one.st_ino, one.st_mtime_ns, one.st_size)
            )
            if marks != self._seen:
                is_live = len(seen) > 1 and seen[1].st_size > 0
                self._rows, self._seen = _rows_of(self._path, is_live=is_live), marks
        return self._rows.get(key_id)


def _rows_of(path: Path, *, is_live: bool) -> dict[str, tuple[Any, ...]]:
    # Immutable, unless a service has it open whose newest rows lie beside it: else SQLite would
    # make files there, to share it with writers.
    address = f"file:{quote(str(path.absolute()))}?mode=ro{'' if is_live else '&immutable=1'}"
    connection = sqlite3.connect(address, uri=True)
    try:
        return {row[0]: row for row in connection.execute("SELECT * FROM keys")}
    finally:
        connection.close()
