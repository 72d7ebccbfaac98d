"""Whether there is room on the disk of the data folder, and how much of it one owner may fill."""

from __future__ import annotations

import asyncio
import errno
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from modalmotion.errors import StoreError
from modalmotion.store.disk import cannot_write

# Some commits of SQLite, with their logs: what every answer takes, for the audit log.
LEAST_BYTES: Final = 1 << 20


def require_room(folder: Path, n_bytes: int = LEAST_BYTES) -> None:
    """Check that a folder's disk has room for something.

    Parameters
    ----------
    folder : Path
    n_bytes : int
        That must be free for this user, and one file besides.

    Raises
    ------
    StoreError
        If there is none, or the disk is gone, or mounted for reading only.
    """
    try:
        status = os.statvfs(folder)
    except OSError as error:
        raise cannot_write(folder, error) from error
    if status.f_flag & os.ST_RDONLY:
        raise _cannot_write(folder, errno.EROFS)
    # Some file systems number no files beforehand, and say 0 of 0.
    is_out_of_files = status.f_files > 0 and status.f_favail == 0
    if is_out_of_files or status.f_bavail * status.f_frsize < n_bytes:
        raise _cannot_write(folder, errno.ENOSPC)


def require_reserve(folder: Path, n_bytes: int) -> None:
    """Check that more is free than what uploads leave to everything else.

    Below it, deletions, results of stored sequences, and the audit log go on; without the log
    nothing is answered.

    Raises
    ------
    StoreError
        If not.
    """
    if n_bytes == 0:
        return
    try:
        require_room(folder, n_bytes)
    except StoreError as error:
        if error.details.get("errno") != "ENOSPC":
            raise
        raise StoreError(
            f"The disk is full but for the {n_bytes} bytes or less that uploads leave free.",
            remedy="Delete sequences, or have room made on the disk of the data folder.",
            details={"errno": "ENOSPC", "reserve_bytes": n_bytes},
        ) from error


def _cannot_write(folder: Path, number: int) -> StoreError:
    return cannot_write(folder, OSError(number, os.strerror(number)))


# Of the files that the store of `local` is beside.
NOT_OF_LOCAL: Final = ("access", "owners", "cluster")
_SECONDS: Final = 10.0
# A measurement takes at most one part in so many of the time.
_PART: Final = 50


class Quota:
    """Measures the files of one owner now and then, and refuses more where they are too many.

    Parameters
    ----------
    root : Path
        Folder of the owner's store.
    most_bytes : int
        That it may hold; 0 for as much as there is room for.
    """

    def __init__(self, root: Path, most_bytes: int = 0) -> None:
        self._root = root
        self._most_bytes = most_bytes
        self.used_bytes = 0

    def require(self) -> None:
        """Refuse to keep more.

        Raises
        ------
        StoreError
            If the owner's files took as much as they may when they were last measured.
        """
        if self._most_bytes and self.used_bytes >= self._most_bytes:
            raise StoreError(
                f"Everything that is stored here takes {self.used_bytes:,} bytes, and may take "
                f"{self._most_bytes:,}.",
                remedy="DELETE sequences, images, tracks, templates or models that are no longer "
                "needed: a sequence goes with all its results. It counts within a minute.",
                details={"errno": "EDQUOT", "max_owner_bytes": self._most_bytes},
            )

    def measure(self) -> None:
        """Add up the sizes of all files."""
        self.used_bytes = sum(sizes(self._root))

    async def measure_for_ever(self) -> None:
        """Measure again and again, unless nothing depends on it."""
        while self._most_bytes:
            begun = time.monotonic()
            await asyncio.to_thread(self.measure)
            await asyncio.sleep(max(_SECONDS, _PART * (time.monotonic() - begun)))


def sizes(root: Path) -> Iterator[int]:
    """Give the size of each file of an owner's store; others may write and delete meanwhile."""
    for path in root.iterdir():
        if path.name in NOT_OF_LOCAL:
            continue
        for file in (path, *path.rglob("*")) if path.is_dir() else (path,):
            try:
                if file.is_file():
                    yield file.stat().st_size
            except FileNotFoundError:
                # Under way, and done by now.
                continue
