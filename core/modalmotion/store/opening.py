"""Opening a store, closing it, changing it under its locks, and the records of its sequences."""

import contextlib
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, Self, TypeVar

from modalmotion import errors, mesh
from modalmotion.store import deletion, folders, recovery
from modalmotion.store.database import Database
from modalmotion.store.disk import (
    FolderLock,
    cannot_write,
    content_of,
    make_folder,
    put_back,
    sync_paths,
    write_atomic,
)
from modalmotion.store.index import Index, SequencePage

_N_STRIPES: Final = 64

T = TypeVar("T")


class Opening:
    """A folder that this process has to itself from `open` to `close`.

    Making one touches no file.

    Parameters
    ----------
    root : Path
        The folder; made where it is missing.
    keep_uploads : bool
        Whether the vertices of new sequences are kept, or only their records.
    """

    def __init__(self, root: Path, *, keep_uploads: bool = True) -> None:
        self.root = root
        self.keep_uploads = keep_uploads
        self._folder = folders.Folder(root)
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
            raise errors.StoreError("The store is open already.", remedy="Open it once.")
        if not self.root.is_dir():
            make_folder(self.root)
        with contextlib.ExitStack() as undo:
            lock = undo.enter_context(FolderLock(self._folder.lock))
            index = Index(undo.enter_context(contextlib.closing(Database(self._folder.index))))
            if not index.is_clean:
                recovery.reconcile(self._folder, index, thorough=False)
            deletion.forget_tombstones(self.root)
            index.set_clean(False)
            undo.pop_all()
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
            raise errors.StoreError(
                "The store is not open in this process.",
                remedy="Use it inside `with ResultStore(...)`; a forked process opens its own.",
            )
        return index

    @contextmanager
    def _changing(self, *names: str) -> Iterator[bool]:
        """Keep other changes to things out; after a failure the next `open` looks closely.

        Parameters
        ----------
        *names : str
            Ids of sequences, or anything that names something else.

        Yields
        ------
        bool
            Whether the deletion of a sequence that had failed was finished first.
        """
        with contextlib.ExitStack() as stack:
            # All who take several take them in this order, so there is no deadlock.
            for number in sorted({hash(name) % _N_STRIPES for name in names}):
                stack.enter_context(self._stripes[number])
            index = self._open_index()
            try:
                ids = set(filter(folders.is_id, names))
                deleted = {one for one in ids if self._folder.path("deletions", one).exists()}
                for name in deleted:
                    deletion.finish_deletion(self._folder, index, name)
                yield bool(deleted)
            except errors.NotFoundError:
                raise
            except BaseException:
                self._is_clean = False
                raise

    def _write(self, files: list[tuple[Path, bytes]], note: Callable[[], None]) -> None:
        """Write files, then note them in the index: what the index knows is there."""
        # What was there before is a record, or damaged; either way it is put back on failure.
        before = [(path, content_of(path)) for path, _ in files]
        try:
            for path, data in files:
                self._make_shards(path.parent)
                write_atomic(path, data)
            note()
        except BaseException:
            for path, content in reversed(before):
                put_back(path, content)
            raise

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
        reader: Callable[..., T],
        locate: Callable[[], Path],
        *,
        sequence_id: str,
        **ids: str,
    ) -> T:
        """Read what `locate` finds in the index, and check its ids."""
        ids["sequence_id"] = sequence_id
        return reader(self._present(locate, sequence_id), ids=ids)

    def _present(
        self,
        locate: Callable[[], Path],
        sequence_id: str,
        what: str = "",
        way: str = "Make it again",
    ) -> Path:
        """Give what `locate` finds in the index, if it is there.

        Parameters
        ----------
        locate : callable
        sequence_id : str
            By which changes are kept out.
        what, way : str, optional
            Its name, and the beginning of a remedy, where it is gone.

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
        if path == self._folder.path("uploads", sequence_id):
            what = f"The file of sequence {sequence_id[:12]} with its vertices"
            way = "Send the sequence again, which stores them under the same id"
        what = what or f"The file of a {path.parents[1].name[:-1]} of sequence {sequence_id[:12]}"
        raise errors.LostFileError(
            f"{what} is lost: it was not deleted, but its file is missing.",
            remedy=f"{way}; or restore it from a backup (`modalmotion store restore`).",
        )


def unknown_sequence(sequence_id: object) -> errors.NotFoundError:
    """Error for an id that the store does not know."""
    return errors.NotFoundError(
        f"There is no sequence {str(sequence_id)[:12]!r}.",
        remedy="Use the id returned when it was sent, or send it.",
    )


class SequenceRecords(Opening):
    """Records of the sequences in a folder."""

    def count(self) -> dict[str, int]:
        """Numbers of sequences and of results, by kind."""
        return self._open_index().count()

    def has_sequence(self, sequence_id: str) -> bool:
        """Whether a sequence is known."""
        return folders.is_id(sequence_id) and self._open_index().find(sequence_id) is not None

    def sequence_record(self, sequence_id: str) -> folders.SequenceRecord:
        """Look up the record of a sequence.

        Raises
        ------
        NotFoundError
            If there is no such sequence.
        """
        index = self._open_index()
        record = index.find(sequence_id) if folders.is_id(sequence_id) else None
        if record is None:
            raise unknown_sequence(sequence_id)
        return record

    def sequence_records(self, sequence_ids: Iterable[str]) -> dict[str, folders.SequenceRecord]:
        """Look up the records of many sequences at once, by their ids; of those that there are."""
        return self._open_index().find_all(filter(folders.is_id, sequence_ids))

    def list_sequences(
        self,
        *,
        subject: str | None = None,
        label: str | None = None,
        tracked: bool = False,
        limit: int = 100,
        cursor: str | None = None,
    ) -> SequencePage:
        """Sequences from the newest to the oldest.

        A sequence that is present from the first page to the last is listed once, even if
        others are put or deleted meanwhile.

        Parameters
        ----------
        subject, label : str, optional
            Only those with exactly this subject, this label.
        tracked : bool
            Only those that were tracked.
        limit : int
            Of one page, 1 to 1000.
        cursor : str, optional
            Of the page before.

        Raises
        ------
        ParameterError
            If the limit is out of range or the cursor is not one of a list.
        """
        return self._open_index().page(subject, label, limit, cursor, tracked=tracked)

    def update_sequence(
        self,
        sequence_id: str,
        *,
        name: str | folders.Unset | None = folders.UNSET,
        subject: str | folders.Unset | None = folders.UNSET,
        label: str | folders.Unset | None = folders.UNSET,
        change: Callable[[mesh.Facts], mesh.Facts] = lambda facts: facts,
    ) -> folders.SequenceRecord:
        """Change the name, the subject, the label, the facts or all; omitted values stay.

        Results with other landmarks stay under their own keys; later results have new ones.

        Parameters
        ----------
        sequence_id : str
        name, subject, label : str or None, optional
        change : callable
            New facts from the stored ones; no other change comes between.

        Raises
        ------
        NotFoundError
            If there is no such sequence.
        ParameterError
            If name, subject or label cannot be kept, or facts contradict the vertices or times.
        StoreError
            If it cannot be written; the store is as it was.
        """
        texts = {"name": name, "subject": subject, "label": label}
        stated: dict[str, Any] = {
            what: text for what, text in texts.items() if not isinstance(text, folders.Unset)
        }
        for what, text in stated.items():
            folders.require_name(what, text)
        self.sequence_record(sequence_id)
        with self._changing(sequence_id):
            known = self.sequence_record(sequence_id)
            facts = change(known.facts)
            if facts != known.facts:
                facts.require_fit(known.n_vertices, known.span)
            return self._restate(known, replace(known, facts=facts, **stated), erases=True)

    def _restate(
        self, known: folders.SequenceRecord, record: folders.SequenceRecord, *, erases: bool = False
    ) -> folders.SequenceRecord:
        """Write a record over the known one, inside `_changing`."""
        if record != known:
            index = self._open_index()
            file = (self._folder.path("records", record.id), folders.record_to_json(record))
            self._write([file], lambda: index.change([record], erases=erases))
        return record

    def complete_sequence(
        self,
        sequence_id: str,
        *,
        subject: str | None = None,
        label: str | None = None,
        facts: mesh.Facts = mesh.NO_FACTS,
        offered: mesh.Facts = mesh.NO_FACTS,
    ) -> tuple[folders.SequenceRecord, tuple[str, ...]]:
        """Fill in what is not known of a sequence yet; what is known must agree.

        Parameters
        ----------
        sequence_id : str
        subject, label : str, optional
        facts : Facts
            Landmarks and covariates each by its name.
        offered : Facts
            Passed over where they differ from what is known.

        Returns
        -------
        record : SequenceRecord
        names : tuple of str
            Of what was filled in: `subject`, `label`, and facts.

        Raises
        ------
        NotFoundError
            If there is no such sequence.
        ParameterError
            If a value is known to be another, or cannot be kept; nothing is changed. The
            details name those that differ.
        StoreError
            If it cannot be written; the store is as it was.
        """
        folders.require_name("subject", subject)
        folders.require_name("label", label)
        with self._changing(sequence_id):
            known = self.sequence_record(sequence_id)
            stated: dict[str, Any] = {"subject": subject, "label": label}
            new = {name: text for name, text in stated.items() if text is not None}
            differ = [
                name for name, text in new.items() if getattr(known, name) not in (None, text)
            ]
            completed = known.facts.over(facts)
            differ += completed.changed(facts.over(known.facts))
            with contextlib.suppress(errors.ParameterError):
                completed = completed.over(offered)
            if differ:
                raise errors.ParameterError(
                    f"The sequence is already stored with a different {' and '.join(differ)}; "
                    "nothing was changed.",
                    remedy="Change it with `update_sequence`.",
                    details={"differ": differ},
                )
            if completed != known.facts:
                completed.require_fit(known.n_vertices, known.span)
            record = replace(known, facts=completed, **new)
            self._restate(known, record)
        filled = [name for name in new if getattr(known, name) is None]
        return record, (*filled, *completed.changed(known.facts))
