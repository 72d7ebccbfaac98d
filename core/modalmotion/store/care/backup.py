"""A copy of a store, made while it is in use: without what was deleted, with what was lost."""

from __future__ import annotations

import contextlib
import shutil
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path, PurePath
from typing import Final

from modalmotion.errors import ParameterError, StoreError
from modalmotion.progress import Progress
from modalmotion.representation import shown
from modalmotion.store.care.copying import (
    copy_file,
    is_begun_by,
    is_same,
    stage_database,
    stage_file,
)
from modalmotion.store.care.losses import Source
from modalmotion.store.care.maintenance import existing_store
from modalmotion.store.disk.atomic import cannot_write, is_temporary, sync_paths, write_atomic
from modalmotion.store.disk.lock import folder_lock
from modalmotion.store.disk.sealed_json import JsonForm
from modalmotion.store.index.cursor import now

KEEP_DAYS: Final = 30
"""How long a copy keeps files that its source has no more, by default."""

FORM: Final = JsonForm("backup", 1, "Make a backup to the same folder once more.")

_NOTE: Final = "backup.json"
_ASIDE: Final = "removed"


@shown()
@dataclass(frozen=True)
class BackupReport:
    """Report of a backup.

    Parameters
    ----------
    n_files, n_bytes : int
        In the copy, without files set aside.
    n_copied : int
        Of them new or changed since the last backup to the same folder.
    n_removed : int
        Deleted by their owner, or done with, since then, and now gone from the copy.
    n_set_aside : int
        Gone from the source in another way, and now in the copy's folder `removed`.
    missing : tuple of str
        Files that the source has lost: nobody deleted them. What the copy has of them stays.
    """

    n_files: int
    n_bytes: int
    n_copied: int
    n_removed: int
    n_set_aside: int = 0
    missing: tuple[str, ...] = ()


def backup(
    root: Path,
    target: Path,
    *,
    accept_missing: bool = False,
    keep_days: float = KEEP_DAYS,
    progress: Progress | None = None,
) -> BackupReport:
    """Copy a store as it is now, or bring an earlier copy up to date.

    The databases are read first, each as of one moment, and take their places in the copy after
    the files are there, durably. A result's file is there before the index names it and never
    changes, so the copy holds all that its index names, whenever this is cut short.

    A file that the copy or the index knows and the source has no more was deleted, which its
    tombstone says, or lost. What was deleted goes from the copy at once. If anything was lost,
    nothing else goes, and a database that has forgotten it too is not replaced.

    Parameters
    ----------
    root : Path
        A server may have it open.
    target : Path
        Made where it is missing; of this store alone.
    accept_missing : bool
        Set what was lost aside, in the copy's folder `removed`, and go on without it.
    keep_days : float
        How long the copy keeps what was set aside.
    progress : callable, optional
        Called with (files looked at, files in all).

    Raises
    ------
    ParameterError
        If one folder lies in the other, or the target holds something else.
    StoreError
        If there is no store, the copy is in use, or cannot be written.
    """
    existing_store(root)
    here, there = root.resolve(), target.resolve()
    if here == there or here in there.parents or there in here.parents:
        raise ParameterError(
            "A backup lies neither in its store nor around it.", remedy="Name another folder."
        )
    if there.exists() and not _is_backup(there) and _holds_files(there):
        raise ParameterError(
            f"'{target.name}' holds other files, which a backup would remove.",
            remedy="Name a new folder, or that of an earlier backup.",
        )
    try:
        # Files that only one user may read stay private in the copy.
        there.mkdir(mode=0o700, parents=True, exist_ok=True)
        with folder_lock(there / "lock"), _Copy(here, there) as copy:
            copy.fill(progress)
            copy.finish(accept_missing=accept_missing)
            copy.forget(keep_days)
            return copy.report()
    except OSError as error:
        raise cannot_write(Path(error.filename or there), error) from error


def backup_time(root: Path) -> str | None:
    """When the state was, as `now` writes it, of which a folder is a backup; None for others."""
    if not (root / _NOTE).is_file():
        return None
    with contextlib.suppress(StoreError):
        return str(FORM.read(root / _NOTE)["as_of"] or "unfinished")
    return "unknown"


def files_of_copy(copy: Path) -> list[PurePath]:
    """List the files that a backup holds of its source, sorted."""
    return sorted(
        PurePath(path.relative_to(copy))
        for path in copy.rglob("*")
        if path.is_file() and not _is_own(path.relative_to(copy))
    )


def _is_own(name: PurePath) -> bool:
    """Whether a file is the copy's own, and not one of the source."""
    is_own = str(name) == _NOTE or name.parts[0] == _ASIDE
    return is_own or name.name == "lock" or ".sqlite-" in name.name or is_temporary(name.name)


def _is_backup(folder: Path) -> bool:
    return any((folder / name).exists() for name in ("index.sqlite", _NOTE))


def _holds_files(folder: Path) -> bool:
    return any(not is_temporary(path.name) and path.name != "lock" for path in folder.iterdir())


class _Copy:
    """A copy that is being made: files are added first, the databases follow, and then some go."""

    def __init__(self, root: Path, target: Path) -> None:
        self._root = root
        self._target = target
        self._as_of = now()
        self._staged: dict[PurePath, Path] = {}
        self._changed: set[Path] = set()
        self._source = Source(root)
        self._n_copied = self._n_removed = self._n_set_aside = 0
        self._missing: list[PurePath] = []

    def __enter__(self) -> _Copy:
        for path in list(self._target.rglob(".modalmotion-*.tmp")):
            path.unlink()
        if not (self._target / _NOTE).exists():
            # By it a first copy that was cut short is known as one.
            write_atomic(self._target / _NOTE, FORM.write({"as_of": None}))
            sync_paths([self._target.parent])
        return self

    def __exit__(self, *_: object) -> None:
        for temporary in self._staged.values():
            temporary.unlink(missing_ok=True)

    def fill(self, progress: Progress | None) -> None:
        """Read the databases, then add all files that are new or were replaced."""
        # Before the log whose heads they are: a copy of the log reaches at least as far.
        for name in self._source.list_notes():
            if not is_begun_by(self._root / name, self._target / name):
                self._missing.append(name)
            elif not is_same((self._root / name).stat(), self._target / name):
                self._staged[name] = stage_file(self._root / name, self._target / name)
        for name in self._source.list_databases():
            staged = stage_database(self._root / name, self._target / name)
            if staged is not None:
                self._staged[name] = staged
        names = self._source.list_files()
        for number, name in enumerate(names):
            self._n_copied += self._add(name)
            if progress is not None:
                progress(number + 1, len(names))
        self._sync()

    def finish(self, *, accept_missing: bool) -> None:
        """Put the databases in their places, and part with what the source has no more."""
        missing = set(self._source.missing_of_index(self._index_of))
        gone: list[PurePath] = []
        done: list[PurePath] = []
        rest: list[PurePath] = []
        for name in files_of_copy(self._target):
            if name in self._source:
                continue
            fate = self._source.fate(name, (self._target / name).stat().st_mtime)
            {"deleted": gone, "done": done, "kept": rest}.get(fate, self._missing).append(name)
        self._missing = sorted(missing.union(self._missing))
        if accept_missing or not self._source.forgotten(self._missing, self._index_of):
            self._replace_databases()
        if accept_missing:
            rest += [name for name in self._missing if (self._target / name).exists()]
            self._missing = []
        if not self._missing:
            gone += done
            for name in rest:
                self._set_aside(name)
        self._remove(self._target, gone)
        self._sync()

    def forget(self, keep_days: float) -> None:
        """Remove from what was set aside the old, and what was deleted since."""
        past = (datetime.now(UTC) - timedelta(days=keep_days)).strftime("%Y-%m-%d")
        for day in sorted((self._target / _ASIDE).glob("*-*-*")):
            if day.name < past:
                shutil.rmtree(day)
                continue
            names = [PurePath(path.relative_to(day)) for path in day.rglob("*") if path.is_file()]
            self._remove(
                day,
                [
                    name
                    for name in names
                    if self._source.fate(name, (day / name).stat().st_mtime) == "deleted"
                ],
            )
        self._sync()

    def report(self) -> BackupReport:
        sizes = [(self._target / name).stat().st_size for name in files_of_copy(self._target)]
        return BackupReport(
            *(len(sizes), sum(sizes), self._n_copied, self._n_removed, self._n_set_aside),
            tuple(map(str, self._missing)),
        )

    def _add(self, name: PurePath) -> bool:
        source, copy = self._root / name, self._target / name
        try:
            if is_same(source.stat(), copy):
                return False
            copy_file(source, copy)
        except FileNotFoundError:
            if source.exists():
                raise
            # Deleted while the copy was made, or done with.
            self._source.discard(name)
            return False
        self._note_change(copy)
        return True

    def _index_of(self, name: PurePath) -> Path:
        """Where a database lies as it was read from the source."""
        return self._staged.get(name, self._target / name)

    def _replace_databases(self) -> None:
        self._n_copied += len(self._staged)
        for name, staged in self._staged.items():
            # What a look into the copy has left: beside a new database it would be a danger.
            for path in (self._target / name).parent.glob(f"{name.name}-*"):
                path.unlink()
            staged.replace(self._target / name)
            self._note_change(self._target / name)
        self._staged = {}
        self._sync()
        write_atomic(self._target / _NOTE, FORM.write({"as_of": self._as_of}))

    def _set_aside(self, name: PurePath) -> None:
        path, aside = self._target / name, self._target / _ASIDE / self._as_of[:10] / name
        aside.parent.mkdir(parents=True, exist_ok=True)
        path.replace(aside)
        self._note_change(path)
        self._note_change(aside)
        self._n_set_aside += 1

    def _remove(self, folder: Path, names: list[PurePath]) -> None:
        for name in names:
            (folder / name).unlink()
            self._note_change(folder / name)
        self._n_removed += len(names)

    def _note_change(self, path: Path) -> None:
        while path != self._target:
            path = path.parent
            if path in self._changed:
                return
            self._changed.add(path)

    def _sync(self) -> None:
        """Make all names that changed durable."""
        sync_paths(folder for folder in self._changed if folder.is_dir())
        self._changed = set()
