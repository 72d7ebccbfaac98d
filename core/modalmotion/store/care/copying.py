"""Files and databases copied durably: whole, and with their times, or not at all."""

from __future__ import annotations

import contextlib
import os
import shutil
import sqlite3
from pathlib import Path

from modalmotion.store.disk.atomic import sync_paths, temporary_beside


def copy_file(source: Path, copy: Path) -> None:
    """Copy a file, whose name is durable when its folder is synchronised; may raise OSError."""
    temporary = stage_file(source, copy)
    try:
        temporary.replace(copy)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def stage_file(source: Path, copy: Path) -> Path:
    """Copy a file durably to one beside its copy, to be renamed; may raise OSError."""
    copy.parent.mkdir(parents=True, exist_ok=True)
    temporary = temporary_beside(copy)
    try:
        shutil.copy2(source, temporary)
        sync_paths([temporary])
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    return temporary


def is_begun_by(file: Path, copy: Path) -> bool:
    """Whether a file that only grows still begins with all that its copy holds."""
    if not copy.exists():
        return True
    with file.open("rb") as now, copy.open("rb") as then:
        while piece := then.read(1 << 20):
            if now.read(len(piece)) != piece:
                return False
    return True


def stage_database(source: Path, copy: Path) -> Path | None:
    """Copy a database that is in use or was changed to a file beside its copy.

    Returns
    -------
    Path or None
        To be renamed to `copy`; None where that is up to date.

    Raises
    ------
    OSError
        If it cannot be copied.
    """
    # Before the look at its log: what is written after it shows in the time, or in the log.
    then = source.stat()
    if not source.with_name(f"{source.name}-wal").exists() and is_same(then, copy):
        return None
    copy.parent.mkdir(parents=True, exist_ok=True)
    # The library copies the committed state, even during writes.
    temporary = temporary_beside(copy)
    try:
        with (
            contextlib.closing(sqlite3.connect(source)) as here,
            contextlib.closing(sqlite3.connect(temporary)) as there,
        ):
            here.backup(there)
            there.execute("PRAGMA journal_mode = DELETE")
        os.utime(temporary, ns=(then.st_atime_ns, then.st_mtime_ns))
        shutil.copymode(source, temporary)
        sync_paths([temporary])
    except sqlite3.Error as error:
        temporary.unlink(missing_ok=True)
        raise OSError(5, str(error), str(copy)) from error
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    return temporary


def is_same(now: os.stat_result, copy: Path) -> bool:
    """Whether a copy has the size and the time of a file."""
    if not copy.exists():
        return False
    then = copy.stat()
    return (now.st_size, now.st_mtime_ns) == (then.st_size, then.st_mtime_ns)
