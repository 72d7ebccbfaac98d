"""A copy of a store, made while it is in use: without what was deleted, with what was lost."""

import contextlib
import filecmp
import shutil
import sqlite3
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Final

from modalmotion.errors import ParameterError, StoreError
from modalmotion.progress import Reporter, reported
from modalmotion.representation import shown
from modalmotion.store.deletion import TOMBSTONES, was_deleted
from modalmotion.store.disk import (
    FolderLock,
    JsonForm,
    cannot_write,
    is_temporary,
    replacing,
    sync_paths,
    temporary_beside,
    write_atomic,
)
from modalmotion.store.folders import FOLDERS, RENDERED, Folder
from modalmotion.store.index import now
from modalmotion.store.recovery import existing_store

FORM: Final = JsonForm("backup", 1, "Repeat the backup to the same folder.")

_NOTE: Final = "backup.json"
_NOT_COPIED: Final = (("sequences", ".deleted"), ("signatures", RENDERED))
# Bytes at the end of a file among which its own digest is: the seal of HDF5, or of a record.
_END: Final = 100


@shown()
@dataclass(frozen=True)
class BackupReport:
    """Report of a backup.

    Parameters
    ----------
    n_files, n_bytes : int
        In the copy.
    n_copied : int
        Of them new or changed since the last backup to the same folder; databases always are.
    n_removed : int
        Deleted by their owner, or done with, since then, and now gone from the copy.
    missing : tuple of str
        Files that the source has lost: nobody deleted them. What the copy has of them stays.
    """

    n_files: int
    n_bytes: int
    n_copied: int
    n_removed: int
    missing: tuple[str, ...] = ()


@shown()
@dataclass(frozen=True)
class RestoreReport:
    """Report of a restoration.

    Parameters
    ----------
    n_files, n_bytes : int
        Put back.
    n_deleted : int
        Files of the copy that stay away, for they were deleted since.
    as_of : str
        When the state was that the copy holds; "unknown" where it does not say.
    knows_deletions : bool
        Whether there was anything to tell what was deleted since; else it is all back.
    """

    n_files: int
    n_bytes: int
    n_deleted: int
    as_of: str
    knows_deletions: bool


def backup(
    root: Path, target: Path, *, accept_missing: bool = False, progress: Reporter | None = None
) -> BackupReport:
    """Copy a store as it is now, or bring an earlier copy up to date.

    The databases are read first, each as of one moment (`VACUUM INTO`), and take their places in
    the copy after the files are there, durably. A result's file is there before the index names it
    and never changes, so the copy contains all that its index names, whenever this is cut short.

    A file that the copy has and the source has no more was deleted, which its tombstone says, or
    lost. What was deleted goes from the copy at once. If anything was lost, nothing else goes.
    Unchanged files are known by the sha256 that they end with.

    Parameters
    ----------
    root : Path
        A server may have it open.
    target : Path
        Made where it is missing; of this store alone.
    accept_missing : bool
        Remove what was lost from the copy too, and go on without it.
    progress : callable, optional
        Called with (files looked at, files in all).

    Raises
    ------
    ParameterError
        If one folder is in the other, or the target holds something else.
    StoreError
        If there is no store, the copy is in use, or cannot be written.
    """
    existing_store(root)
    here, there = _apart(root, target)
    is_backup = (there / _NOTE).exists()
    if there.exists() and not is_backup and any(_is_copied(path.name) for path in there.iterdir()):
        raise ParameterError(
            f"'{target.name}' contains other files, which a backup would remove.",
            remedy="Name a new folder or the folder of an earlier backup.",
        )
    with _writing_to(there):
        return _bring_up_to_date(here, there, accept_missing, progress)


def backup_time(root: Path) -> str | None:
    """When the state was, as `now` writes it, of which a folder is a backup; None for others."""
    if not (root / _NOTE).is_file():
        return None
    with contextlib.suppress(StoreError):
        return str(FORM.read(root / _NOTE)["as_of"] or "unfinished")
    return "unknown"


def restore(
    copy: Path, root: Path, *, deletions: Path | None = None, progress: Reporter | None = None
) -> RestoreReport:
    """Put back what a folder lacks of its backup; `rebuild` its stores afterwards.

    Parameters
    ----------
    copy : Path
    root : Path
        Made where it is missing; its own files and databases stay as they are.
    deletions : Path, optional
        Remains of the folder that the backup was made of, which know what was deleted.
    progress : callable, optional
        Called with (files looked at, files in all).

    Raises
    ------
    NotFoundError
        If the copy contains no store.
    ParameterError
        If one folder is in the other.
    StoreError
        If a process has either open, or the folder cannot be written.
    """
    existing_store(copy)
    here, there = _apart(copy, root)
    knowing = [there] if deletions is None else [there, deletions.resolve()]
    # A folder that is new, or was emptied, tells nothing.
    knows_deletions = any(Folder(one).exists or (one / TOMBSTONES).is_dir() for one in knowing)
    n_files = n_bytes = n_deleted = 0
    with _writing_to(there), FolderLock(here / "lock"):
        # Databases last: what they name is there before them.
        names = sorted(_files_of(here), key=lambda name: (name.suffix == ".sqlite", name))
        for name in reported(names, progress):
            status = (here / name).stat()
            if not (there / name).exists():
                if any(was_deleted(one, name, status.st_mtime) for one in knowing):
                    n_deleted += 1
                else:
                    _remove_logs(there / name)
                    _copy(here / name, there / name)
                    n_files, n_bytes = n_files + 1, n_bytes + status.st_size
        _sync_folders(there, names)
    as_of = backup_time(copy) or "unknown"
    return RestoreReport(n_files, n_bytes, n_deleted, as_of, knows_deletions)


@contextlib.contextmanager
def _writing_to(folder: Path) -> Iterator[None]:
    """Make a folder and hold its lock."""
    try:
        # Files that only one user may read stay private in the copy.
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with FolderLock(folder / "lock"):
            yield
    except OSError as error:
        raise cannot_write(Path(error.filename or folder), error) from error


def _apart(source: Path, target: Path) -> tuple[Path, Path]:
    here, there = source.resolve(), target.resolve()
    if here == there or here in there.parents or there in here.parents:
        raise ParameterError(
            "A backup cannot be inside its store, nor contain it.", remedy="Name another folder."
        )
    return here, there


def _bring_up_to_date(
    root: Path, copy: Path, accept_missing: bool, progress: Reporter | None
) -> BackupReport:
    as_of = now()
    for path in list(copy.rglob(".modalmotion-*.tmp")):
        path.unlink()
    if not (copy / _NOTE).exists():
        # By it a first copy that was cut short is known as one.
        write_atomic(copy / _NOTE, FORM.write({"as_of": None}))
        sync_paths([copy.parent])
    databases = [name for name in _files_of(root) if name.suffix == ".sqlite"]
    staged: dict[PurePath, Path] = {}
    try:
        for name in databases:
            (copy / name).parent.mkdir(parents=True, exist_ok=True)
            staged[name] = temporary_beside(copy / name)
            _stage_database(root / name, staged[name])
        # Again: what the databases name by now is there.
        present = {name for name in _files_of(root) if name.suffix != ".sqlite"}
        looked_at = reported(sorted(present), progress)
        new = [name for name in looked_at if _copied(root / name, copy / name)]
        _sync_folders(copy, new)
        gone, done, lost = _parted(
            root, copy, [n for n in _files_of(copy) if n not in present and n not in databases]
        )
        if accept_missing:
            gone, lost = gone + lost, []
        for name in databases:
            # What a look into the copy has left: beside a new database it would be a danger.
            _remove_logs(copy / name)
            staged.pop(name).replace(copy / name)
        _sync_folders(copy, databases)
        write_atomic(copy / _NOTE, FORM.write({"as_of": as_of}))
        gone += [] if lost else done
        for name in gone:
            (copy / name).unlink()
        _sync_folders(copy, gone)
    finally:
        for temporary in staged.values():
            temporary.unlink(missing_ok=True)
    sizes = [(copy / name).stat().st_size for name in _files_of(copy)]
    n_copied = len(new) + len(databases)
    return BackupReport(len(sizes), sum(sizes), n_copied, len(gone), tuple(map(str, lost)))


def _files_of(folder: Path) -> list[PurePath]:
    """List what a backup has of a folder, sorted: its databases, and all files but a store's own.

    Its own are locks, logs of databases, temporary files, marks of deletions under way, which
    contain records, and texts that are made of signatures again when they are missing.
    """
    return sorted(
        PurePath(path.relative_to(folder))
        for path in folder.rglob("*")
        if _is_copied(path.name)
        and (path.parent.parent.name, path.suffix) not in _NOT_COPIED
        and path.is_file()
    )


def _is_copied(name: str) -> bool:
    return not (name in ("lock", _NOTE) or ".sqlite-" in name or is_temporary(name))


def _parted(
    root: Path, copy: Path, names: Iterable[PurePath]
) -> tuple[list[PurePath], list[PurePath], list[PurePath]]:
    """Part files that the copy alone has: deleted, done with, and lost; others, as tables, stay."""
    deleted, done, lost = list[PurePath](), list[PurePath](), list[PurePath]()
    for name in names:
        top = name.parts[2 * (name.parts[0] == "owners" and len(name.parts) > 2)]
        if was_deleted(root, name, (copy / name).stat().st_mtime):
            deleted.append(name)
        elif top in ("spool", "cluster", TOMBSTONES):
            done.append(name)
        elif top in FOLDERS or name.suffix == ".sqlite":
            lost.append(name)
    return deleted, done, lost


def _copied(source: Path, copy: Path) -> bool:
    """Copy a file that is new or was replaced; return whether it was."""
    try:
        if not _is_same(source, copy):
            _copy(source, copy)
            return True
        if source.stat().st_mtime_ns != copy.stat().st_mtime_ns:
            # Deleted, perhaps, and put again since: only its time says so.
            shutil.copystat(source, copy)
    except FileNotFoundError:
        # Deleted while the copy was made, or done with.
        if source.exists():
            raise
    return False


def _is_same(source: Path, copy: Path) -> bool:
    """Compare the digests that files of a store end with; other files byte by byte."""
    if not copy.exists() or (size := source.stat().st_size) != copy.stat().st_size:
        return False
    ends = []
    for path in (source, copy):
        with path.open("rb") as file:
            file.seek(max(0, size - _END))
            ends.append(file.read())
    if ends[0] != ends[1]:
        return False
    return b"sha256" in ends[0] or filecmp.cmp(source, copy, shallow=False)


def _copy(source: Path, copy: Path) -> None:
    """Copy a file durably, with its times, wholly or not at all."""
    copy.parent.mkdir(parents=True, exist_ok=True)
    with replacing(copy) as temporary:
        shutil.copy2(source, temporary)
        sync_paths([temporary])


def _stage_database(source: Path, temporary: Path) -> None:
    """Copy a database as of one moment, even during writes."""
    try:
        with contextlib.closing(sqlite3.connect(source)) as database:
            database.execute("VACUUM INTO ?", [str(temporary)])
    except sqlite3.Error as error:
        raise OSError(5, str(error), str(temporary)) from error
    shutil.copymode(source, temporary)
    sync_paths([temporary])


def _remove_logs(database: Path) -> None:
    if database.suffix == ".sqlite":
        for path in database.parent.glob(f"{database.name}-*"):
            path.unlink()


def _sync_folders(root: Path, names: Iterable[PurePath]) -> None:
    """Make the names of files durable."""
    folders = {root / parent for name in names for parent in name.parents}
    sync_paths(sorted(folder for folder in folders if folder.is_dir()))
