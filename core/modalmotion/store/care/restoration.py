"""A backup put back: what a folder lacks of it, and nothing that was deleted since."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path, PurePath

from modalmotion.errors import ParameterError
from modalmotion.progress import Progress
from modalmotion.representation import shown
from modalmotion.store.care.backup import backup_time, files_of_copy
from modalmotion.store.care.copying import copy_file
from modalmotion.store.care.maintenance import existing_store
from modalmotion.store.disk.atomic import cannot_write, sync_paths
from modalmotion.store.disk.lock import folder_lock
from modalmotion.store.folder import Folder
from modalmotion.store.tombstones import TOMBSTONES, Deletions


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


def restore(
    copy: Path, root: Path, *, deletions: Path | None = None, progress: Progress | None = None
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
        If the copy holds no store.
    ParameterError
        If one folder lies in the other.
    StoreError
        If a process has either open, or the folder cannot be written.
    """
    existing_store(copy)
    here, there = copy.resolve(), root.resolve()
    if here == there or here in there.parents or there in here.parents:
        raise ParameterError(
            "A backup is restored neither into itself nor around itself.",
            remedy="Name another folder.",
        )
    knowing = [there] if deletions is None else [there, deletions.resolve()]
    # A folder that is new, or was emptied, tells nothing.
    knows_deletions = any(
        Folder(folder).exists or (folder / TOMBSTONES).is_dir() for folder in knowing
    )
    try:
        there.mkdir(mode=0o700, parents=True, exist_ok=True)
        with folder_lock(there / "lock"), folder_lock(here / "lock"):
            n_files, n_bytes, n_deleted = _put_back(
                here, there, [Deletions(folder) for folder in knowing], progress
            )
    except OSError as error:
        raise cannot_write(Path(error.filename or there), error) from error
    return RestoreReport(
        n_files, n_bytes, n_deleted, backup_time(copy) or "unknown", knows_deletions
    )


def _put_back(
    copy: Path, root: Path, deletions: list[Deletions], progress: Progress | None
) -> tuple[int, int, int]:
    # Databases last: what they name is there before them.
    names = sorted(files_of_copy(copy), key=lambda name: (name.suffix == ".sqlite", name))
    n_files = n_bytes = n_deleted = 0
    folders: set[Path] = set()
    for number, name in enumerate(names):
        status = (copy / name).stat()
        if not (root / name).exists():
            if any(known.cover(name, status.st_mtime) for known in deletions):
                n_deleted += 1
            else:
                _put(copy / name, root / name)
                n_files, n_bytes = n_files + 1, n_bytes + status.st_size
                folders.update(root / parent for parent in (PurePath(name), *name.parents)[1:])
        if progress is not None:
            progress(number + 1, len(names))
    sync_paths(sorted(folders))
    return n_files, n_bytes, n_deleted


def _put(source: Path, place: Path) -> None:
    if place.suffix == ".sqlite":
        # The log of a database that is gone belongs to no other.
        for rest in place.parent.glob(f"{place.name}-*"):
            rest.unlink()
    copy_file(source, place)
