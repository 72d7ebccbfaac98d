"""Opening a store, closing it, and changing it under its locks."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, Self, TypeVar

from modalmotion.errors import LostFileError, NotFoundError, StoreError
from modalmotion.hdf5.contents import Contents, require_match
from modalmotion.store.deletion import finish_deletion, forget_tombstones
from modalmotion.store.disk.atomic import (
    cannot_write,
    content_of,
    make_folder,
    move_files,
    put_back,
    sync_paths,
    write_atomic,
)
from modalmotion.store.disk.lock import FolderLock
from modalmotion.store.folder import Folder
from modalmotion.store.index.database import Database
from modalmotion.store.index.index import Index
from modalmotion.store.recovery import reconcile

_N_STRIPES: Final = 64

T = TypeVar("T")


class Opening:
    """A folder that this process has to itself from `open` to `close`.

    Making one touches no file.

    Parameters
    ----------
    root : Path
        The folder; made where it is missing.
    """

    def __init__(self, root: Path) -> None:
        self.root = root
        self._folder = Folder(root)
        self._lock: FolderLock | None = None
        self._index: Index | None = None
        self._is_clean = True
        # One lock for a few sequences each: writes to different ones wait for the disk together.
        self._stripes = [threading.Lock() for _ in range(_N_STRIPES)]
        self._shards: set[Path] = set()
        self._shards_lock = threading.Lock()

    def open(self) -> Self:
        """Take the folder's lock and open the index; after a crash, finish interrupted changes.

        Raises
        ------
        StoreError
            If another process has the folder, or the index cannot be used.
        """
        if self._index is not None:
            raise StoreError("The store is open already.", remedy="Open it once.")
        if not self.root.is_dir():
            make_folder(self.root)
        lock = FolderLock(self._folder.lock)
        try:
            database = Database(self._folder.index)
            try:
                index = Index(database)
                if not index.is_clean:
                    reconcile(self._folder, index, thorough=False)
                forget_tombstones(self.root)
                index.set_clean(False)
            except BaseException:
                database.close()
                raise
        except BaseException:
            lock.release()
            raise
        self._is_clean = True
        self._lock, self._index = lock, index
        return self

    def close(self) -> None:
        """Wait for changes under way, close the index, give the lock back."""
        if self._index is None or self._lock is None or not self._lock.is_held:
            return
        with contextlib.ExitStack() as stack:
            for stripe in self._stripes:
                stack.enter_context(stripe)
            index, lock = self._index, self._lock
            self._index = self._lock = None
            try:
                if self._is_clean:
                    index.set_clean(True)
            finally:
                index.database.close()
                lock.release()

    def __enter__(self) -> Self:
        return self.open()

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def database(self) -> Database:
        """The index's file, for callers with tables of their own: see `Database.extend`."""
        return self._open_index().database

    def _open_index(self) -> Index:
        index, lock = self._index, self._lock
        if index is None or lock is None or not lock.is_held:
            raise StoreError(
                "The store is not open in this process.",
                remedy="Use it inside `with ResultStore(...)`; a forked process opens its own.",
            )
        return index

    @contextmanager
    def _changing(self, *sequence_ids: str) -> Iterator[bool]:
        """Keep other changes to sequences out; after a failure the next `open` looks closely.

        Yields whether a deletion that had failed was finished first.
        """
        with contextlib.ExitStack() as stack:
            # All who take several take them in this order, so there is no deadlock.
            for number in sorted({int(name[:8], 16) % _N_STRIPES for name in sequence_ids}):
                stack.enter_context(self._stripes[number])
            index = self._open_index()
            try:
                deleted = {name for name in sequence_ids if self._folder.deletion(name).exists()}
                for name in deleted:
                    finish_deletion(self._folder, index, name)
                yield bool(deleted)
            except NotFoundError:
                raise
            except BaseException:
                self._is_clean = False
                raise

    def _write(self, files: list[tuple[Path, bytes]], note: Callable[[], None]) -> None:
        """Write files, then note them in the index: what the index knows is there."""
        # What was there before is a record, or damaged; either way it is put back on failure.
        before = [(path, content_of(path)) for path, _ in files]
        with _put_back_on_failure(before):
            for path, data in files:
                self._make_shards(path.parent)
                write_atomic(path, data)
            note()

    def _move(self, moves: list[tuple[Path, Path]], note: Callable[[], None]) -> None:
        """Move durable files to their paths, then note them in the index, as `_write` does."""
        before = [(target, content_of(target)) for _, target in moves]
        with _put_back_on_failure(before):
            self._make_shards(*(target.parent for _, target in moves))
            try:
                move_files(moves)
            except OSError as error:
                raise cannot_write(moves[0][1], error) from error
            note()

    def _make_shards(self, *shards: Path) -> None:
        # Once for each: that a folder can be seen does not say that it is durable, for it may
        # have been made by another thread just now, or by a process that was killed.
        with self._shards_lock:
            new = set(shards) - self._shards
            for parent in {shard.parent for shard in new} - self._shards:
                make_folder(parent)
                self._shards.add(parent)
            try:
                for shard in new:
                    shard.mkdir(exist_ok=True)
                sync_paths({shard.parent for shard in new})
            except OSError as error:
                raise cannot_write(next(iter(new)), error) from error
            self._shards |= new

    def _read(
        self,
        reader: Callable[[Path], tuple[T, Contents]],
        locate: Callable[[], Path],
        *,
        sequence_id: str,
        **ids: str,
    ) -> T:
        """Read what `locate` finds in the index, and check its ids."""
        path = locate()
        try:
            value, contents = reader(path)
        except NotFoundError:
            path = self._present(locate, sequence_id)
            value, contents = reader(path)
        require_match(path, contents, sequence_id=sequence_id, **ids)
        return value

    def _present(self, locate: Callable[[], Path], sequence_id: str) -> Path:
        """Give what `locate` finds in the index, if it is there.

        Raises
        ------
        LostFileError
            If the index knows it and it is gone.
        """
        path = locate()
        if path.is_file():
            return path
        # Deleted (and perhaps put again) since the index was read, or gone.
        with self._changing(sequence_id):
            path = locate()
            is_there = path.is_file()
        if is_there:
            return path
        if path == self._folder.upload(sequence_id):
            raise lost_file(
                f"The file of sequence {sequence_id[:12]} with its vertices",
                "Send the sequence again, which stores them under the same id",
            )
        what = f"The file of a {path.parents[1].name[:-1]} of sequence {sequence_id[:12]}"
        raise lost_file(what, "Make it again")


@contextmanager
def _put_back_on_failure(before: list[tuple[Path, bytes | None]]) -> Iterator[None]:
    try:
        yield
    except BaseException:
        for path, content in reversed(before):
            put_back(path, content)
        raise


def lost_file(what: str, way: str) -> LostFileError:
    """Error for a file that the index knows and that is gone.

    Parameters
    ----------
    what : str
        With its name.
    way : str
        Beginning of a remedy.
    """
    return LostFileError(
        f"{what} is lost: it was stored and not deleted, and its file is missing.",
        remedy=f"{way}; or restore it from a backup (`modalmotion store restore`).",
    )


def unknown_sequence(sequence_id: object) -> NotFoundError:
    """Error for an id that the store does not know."""
    return NotFoundError(
        f"There is no sequence {str(sequence_id)[:12]!r}.",
        remedy="Use the id returned when it was sent, or send it.",
    )
