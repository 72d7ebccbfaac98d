"""A copy of a store, made while it is in use."""

from __future__ import annotations

import contextlib
import os
import shutil
import sqlite3
from dataclasses import dataclass
from pathlib import Path

from modalmotion.errors import ParameterError
from modalmotion.progress import Progress
from modalmotion.representation import shown
from modalmotion.store.care.maintenance import existing_store
from modalmotion.store.disk.atomic import cannot_write, is_temporary, temporary_beside


@shown()
@dataclass(frozen=True)
class BackupReport:
    """Report of a backup.

    Parameters
    ----------
    n_files, n_bytes : int
        In the copy.
    n_copied : int
        Of them new or changed since the last backup to the same folder.
    n_removed : int
        Deleted from the store since then, and now from the copy.
    """

    n_files: int
    n_bytes: int
    n_copied: int
    n_removed: int


def backup(root: Path, target: Path, *, progress: Progress | None = None) -> BackupReport:
    """Copy a store as it is now, or bring an earlier copy up to date.

    The databases first, each as of one moment; then the files. A result's file is there before
    the index names it and never changes, so the copy holds all that its index names, but for
    what was deleted meanwhile; `rebuild` settles that when it is restored.

    Parameters
    ----------
    root : Path
        A server may have it open.
    target : Path
        Made where it is missing; of this store alone.
    progress : callable, optional
        Called with (files looked at, files in all).

    Raises
    ------
    ParameterError
        If one folder lies in the other, or the target holds something else.
    StoreError
        If there is no store, or the copy cannot be written.
    """
    existing_store(root)
    here, there = root.resolve(), target.resolve()
    if here == there or here in there.parents or there in here.parents:
        raise ParameterError(
            "A backup lies neither in its store nor around it.", remedy="Name another folder."
        )
    if there.exists() and not (there / "index.sqlite").exists() and _holds_files(there):
        raise ParameterError(
            f"'{target.name}' holds other files, which a backup would remove.",
            remedy="Name a new folder, or that of an earlier backup.",
        )
    try:
        return _copy(here, there, progress)
    except OSError as error:
        raise cannot_write(Path(error.filename or there), error) from error


def _copy(root: Path, target: Path, progress: Progress | None) -> BackupReport:
    # Files that only one user may read stay private in the copy.
    target.mkdir(mode=0o700, parents=True, exist_ok=True)
    # Keys, audit log and the indices of other owners' stores lie further down.
    paths = (path.relative_to(root) for path in root.rglob("*.sqlite"))
    # The index first: by it a copy that was cut short is known as one.
    databases = sorted(paths, key=lambda path: (len(path.parts), path))
    n_copied = 0
    for database in databases:
        (target / database).parent.mkdir(parents=True, exist_ok=True)
        n_copied += _copy_database(root / database, target / database)
    names = [path.relative_to(root) for path in root.rglob("*") if _belongs(path)]
    for number, name in enumerate(names):
        n_copied += _copy_file(root / name, target / name)
        if progress is not None:
            progress(number + 1, len(names))
    copies = {target / name for name in names} | {target / name for name in databases}
    old = [path for path in target.rglob("*") if path.is_file() and path not in copies]
    for path in old:
        path.unlink()
    files = [path for path in copies if path.exists()]
    n_bytes = sum(path.stat().st_size for path in files)
    return BackupReport(len(files), n_bytes, n_copied, len(old))


def _holds_files(folder: Path) -> bool:
    return any(not is_temporary(path.name) for path in folder.iterdir())


def _belongs(path: Path) -> bool:
    is_database = ".sqlite" in path.name
    return not (is_database or path.name == "lock" or is_temporary(path.name)) and path.is_file()


def _copy_database(source: Path, copy: Path) -> bool:
    """Copy a database that is in use or was changed; tell whether it was."""
    # Before the look at its log: what is written after it shows in the time, or in the log.
    then = source.stat()
    if not _wal_of(source).exists() and _is_same(then, copy):
        return False
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
        temporary.replace(copy)
    except sqlite3.Error as error:
        raise OSError(5, str(error), str(copy)) from error
    finally:
        temporary.unlink(missing_ok=True)
    return True


def _wal_of(database: Path) -> Path:
    return database.with_name(f"{database.name}-wal")


def _is_same(now: os.stat_result, copy: Path) -> bool:
    if not copy.exists():
        return False
    then = copy.stat()
    return (now.st_size, now.st_mtime_ns) == (then.st_size, then.st_mtime_ns)


def _copy_file(source: Path, copy: Path) -> bool:
    """Copy a file that is new or was replaced; tell whether it was."""
    try:
        now = source.stat()
        if _is_same(now, copy):
            return False
        copy.parent.mkdir(parents=True, exist_ok=True)
        temporary = temporary_beside(copy)
        try:
            shutil.copy2(source, temporary)
            temporary.replace(copy)
        finally:
            temporary.unlink(missing_ok=True)
    except FileNotFoundError:
        if source.exists():
            raise
        # Deleted while the copy was made.
        copy.unlink(missing_ok=True)
        return False
    return True
