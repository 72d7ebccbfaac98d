"""Whether there is room on the disk of the data folder, and whether it can be written to."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Final

from modalmotion.errors import StoreError
from modalmotion.store.disk.atomic import cannot_write

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
