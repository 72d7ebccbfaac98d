"""What has become of files that a copy has and its source has no more."""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path, PurePath
from typing import Final, Literal

from modalmotion.classification.record import ModelReference
from modalmotion.store.disk.atomic import is_temporary
from modalmotion.store.folder import Folder, ResultName
from modalmotion.store.tombstones import TOMBSTONES, Deletions

Fate = Literal["deleted", "done", "lost", "kept"]
"""Deleted by its owner; of no more use; lost; or neither, such as a table of a cohort."""

_OF_STORES: Final = (
    *("sequences", "signatures", "classifications", "tracks"),
    *("templates", "images", "models", "norms"),
)
# A store's own, never copied: its lock, a deletion that is under way, what an older copy set aside.
_HEADS: Final = "access/audit/heads"
_NOT_COPIED: Final = ("lock", "backup.json")


class Source:
    """The files that a backup is made of, as they were listed.

    Parameters
    ----------
    root : Path
        Folder of a store, or of a service with the stores of its owners.
    """

    def __init__(self, root: Path) -> None:
        self._root = root
        self._deletions = Deletions(root)
        self._names: set[PurePath] = set()
        self._databases: list[PurePath] = []

    def __contains__(self, name: PurePath) -> bool:
        return name in self._names

    def list_databases(self) -> list[PurePath]:
        """List the databases: keys, audit log and owners' indices lie further down."""
        paths = (PurePath(path.relative_to(self._root)) for path in self._root.rglob("*.sqlite"))
        # What a backup has set aside, and was restored with it, is nobody's.
        self._databases = sorted(name for name in paths if name.parts[0] != "removed")
        self._names.update(self._databases)
        return self._databases

    def list_notes(self) -> list[PurePath]:
        """List the heads that were noted of an audit log: files that only grow."""
        paths = (PurePath(path.relative_to(self._root)) for path in self._root.glob(_HEADS))
        notes = sorted(paths)
        self._names.update(notes)
        return notes

    def list_files(self) -> list[PurePath]:
        """List all other files, sorted."""
        names = sorted(
            PurePath(path.relative_to(self._root))
            for path in self._root.rglob("*")
            if _is_copied(path) and path.relative_to(self._root).parts[0] != "removed"
        )
        names = [name for name in names if not name.match(_HEADS)]
        self._names.update(names)
        return names

    def discard(self, name: PurePath) -> None:
        """Take out a file that has gone since it was listed."""
        self._names.discard(name)

    def fate(self, name: PurePath, written: float) -> Fate:
        """Tell what has become of a file that is not among these.

        Parameters
        ----------
        name : PurePath
            Within the folder.
        written : float, s
            When it was written, since 1970.
        """
        if self._deletions.cover(name, written):
            return "deleted"
        _, local = _store_of(name)
        top = local.parts[0]
        if top in (TOMBSTONES, "spool", "cluster") or _is_mark(name):
            return "done"
        if name.suffix == ".sqlite":
            return "kept" if self._is_archived(name) else "lost"
        return "lost" if top in _OF_STORES or name.match(_HEADS) else "kept"

    def missing_of_index(self, locate: Callable[[PurePath], Path]) -> Iterator[PurePath]:
        """List files that an index names, and that were neither there nor deleted.

        Parameters
        ----------
        locate : callable
            Gives the path of a database as it was read.
        """
        for database in self._databases:
            if database.name == "index.sqlite":
                for name in _named_by(locate(database), database.parent):
                    if name not in self._names and not self._deletions.cover(name, 0.0):
                        yield name

    def forgotten(self, lost: Iterable[PurePath], locate: Callable[[PurePath], Path]) -> bool:
        """Whether an index has forgotten lost files too: it is not the one that knew them."""
        of_stores: dict[PurePath, set[PurePath]] = {}
        for name in lost:
            store, local = _store_of(name)
            # These have no row.
            if local.parts[0] not in ("templates", "images", "norms"):
                of_stores.setdefault(store, set()).add(name)
        return any(
            store / "index.sqlite" not in self._names
            or not names <= set(_named_by(locate(store / "index.sqlite"), store))
            for store, names in of_stores.items()
        )

    def _is_archived(self, name: PurePath) -> bool:
        """Whether a later file of the same log is there: its owner moves closed ones away."""
        return name.stem.isdigit() and any(
            other.parent == name.parent and other.stem.isdigit() and other.stem > name.stem
            for other in self._databases
        )


def _is_copied(path: Path) -> bool:
    is_own = path.name in _NOT_COPIED or is_temporary(path.name) or _is_mark(path)
    return not (is_own or ".sqlite" in path.name) and path.is_file()


def _is_mark(name: PurePath) -> bool:
    """Whether it is the mark of a sequence's deletion, which holds its record."""
    return name.suffix == ".deleted" and name.parent.parent.name == "sequences"


def _store_of(name: PurePath) -> tuple[PurePath, PurePath]:
    """Part a name into the store and the place within it."""
    n = 2 if name.parts[0] == "owners" and len(name.parts) > 2 else 0
    return PurePath(*name.parts[:n]), PurePath(*name.parts[n:])


def _named_by(index: Path, store: PurePath) -> Iterator[PurePath]:
    """List the files that an index has rows of; none if it does not read."""
    folder = Folder(Path(store))
    with (
        contextlib.suppress(sqlite3.Error),
        contextlib.closing(sqlite3.connect(f"{index.absolute().as_uri()}?mode=ro", uri=True)) as db,
    ):
        for sequence_id, has_upload in db.execute("SELECT id, has_upload FROM sequences"):
            yield folder.record(sequence_id)
            if has_upload:
                yield folder.upload(sequence_id)
        for row in db.execute("SELECT kind, sequence_id, model_id, key FROM results"):
            yield folder.result(ResultName(*row))
        for *reference, deleted in db.execute("SELECT name, version, deleted FROM models"):
            place = ModelReference(*reference)
            yield folder.deleted_model(place) if deleted else folder.model(place)
