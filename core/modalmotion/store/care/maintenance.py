"""Building the index anew from the files."""

from __future__ import annotations

import contextlib
from dataclasses import replace
from pathlib import Path

from modalmotion.errors import CorruptFileError, NotFoundError, StoreError
from modalmotion.progress import Progress
from modalmotion.store.care.recovery import Reconciliation, reconcile
from modalmotion.store.disk.atomic import remove_durably
from modalmotion.store.disk.lock import folder_lock
from modalmotion.store.folder import Folder
from modalmotion.store.index.database import Database, GuestTable
from modalmotion.store.index.index import Index


def rebuild(root: Path, *, progress: Progress | None = None) -> Reconciliation:
    """Build the index of a store anew from its files, whose seals are all checked.

    Sequences with subject, label and time, and all results, come from the files. Tables of
    others, such as a service's jobs, are in the index alone: they are kept if it can be read.

    Parameters
    ----------
    root : Path
    progress : callable, optional

    Raises
    ------
    NotFoundError
        If there is no store.
    StoreError
        If another process has it open, or it cannot be written.
    """
    folder = existing_store(root)
    with folder_lock(folder.lock):
        database, guests_lost = _usable(folder)
        try:
            index = Index(database)
            reconciliation = reconcile(folder, index, thorough=True, progress=progress)
            index.set_clean(True)
        finally:
            database.close()
        # From here on it is a store, if it was a backup.
        remove_durably(root / "backup.json")
    return replace(reconciliation, guests_lost=guests_lost)


def existing_store(root: Path) -> Folder:
    """Folder of a store that is there.

    Raises
    ------
    NotFoundError
        If there is none.
    """
    folder = Folder(root)
    if not folder.exists:
        raise NotFoundError(
            f"'{root.name}' holds no store.",
            remedy="Name the folder that has 'index.sqlite' and 'sequences' in it.",
        )
    return folder


def _usable(folder: Folder) -> tuple[Database, bool]:
    """Index to write to, and whether tables of others were lost with a damaged one."""
    guests: list[GuestTable] | None = None
    with contextlib.suppress(CorruptFileError):
        database = Database(folder.index)
        if not database.faults():
            return database, False
        with contextlib.suppress(StoreError):
            guests = database.guests()
        with contextlib.suppress(StoreError):
            database.close()
    # The log goes first: beside a new index an old one would be a danger.
    remove_durably(*reversed(folder.index_files))
    database = Database(folder.index)
    database.receive(guests or ())
    return database, guests is None
