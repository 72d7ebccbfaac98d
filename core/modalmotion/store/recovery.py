"""Index and folder brought together: after a crash, and when the index is built anew."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from modalmotion.classification import answer_hdf5 as classification_hdf5
from modalmotion.classification.card import ModelRecord
from modalmotion.classification.model_files import read_kept_model
from modalmotion.errors import CorruptFileError, NotFoundError, OlderFileError, StoreError
from modalmotion.hdf5.form import Form
from modalmotion.hdf5.image import require_match
from modalmotion.hdf5.sealed import is_sound
from modalmotion.mesh.hdf5 import read_sequence
from modalmotion.progress import Progress
from modalmotion.representation import shown
from modalmotion.signature import hdf5 as signature_hdf5
from modalmotion.store.database import Database, Guest, recount
from modalmotion.store.deletion import (
    buried,
    deleted_record,
    digest_of_norm,
    finish_deletion,
    is_older,
)
from modalmotion.store.disk import FolderLock, remove_durably, write_atomic
from modalmotion.store.folder import (
    RENDERED,
    Folder,
    ResultKind,
    ResultName,
    Scan,
    SequenceRecord,
    read_record,
    record_of,
    record_to_json,
)
from modalmotion.store.index import Index, put_models, put_records, put_results, to_text
from modalmotion.tracking import hdf5 as track_hdf5

_FORMS: Final[dict[ResultKind, Form]] = {
    "signature": signature_hdf5.FORM,
    "classification": classification_hdf5.FORM,
    "track": track_hdf5.FORM,
}


@shown()
@dataclass(frozen=True)
class Reconciliation:
    """Result of bringing index and folder together.

    Parameters
    ----------
    n_sequences, n_results : int
        In the index now.
    n_deletions : int
        Deletions that a crash had interrupted, and those of sequences that came back with older
        files: both were finished.
    n_temporaries : int
        Unfinished files that were removed.
    restored : tuple of str
        Records that were missing or damaged and were written anew.
    damaged : tuple of str
        Files that do not read, left where they are; such results are not in the index.
    orphans : tuple of str
        Results of no sequence, and files that are not the store's.
    guests_lost : bool
        Whether the index was so damaged that tables of others in it, a service's jobs and
        idempotency keys, are lost.
    n_models : int
        Versions of models in the index now, without deleted ones.
    """

    n_sequences: int
    n_results: int
    n_deletions: int
    n_temporaries: int
    restored: tuple[str, ...]
    damaged: tuple[str, ...]
    orphans: tuple[str, ...]
    guests_lost: bool = False
    n_models: int = 0


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
    with FolderLock(folder.lock):
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
            f"'{root.name}' contains no store.",
            remedy="Name the folder that has 'index.sqlite' and 'sequences' in it.",
        )
    return folder


def _usable(folder: Folder) -> tuple[Database, bool]:
    """Index to write to, and whether tables of others were lost with a damaged one."""
    guests: list[Guest] | None = None
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


def reconcile(
    folder: Folder, index: Index, *, thorough: bool, progress: Progress | None = None
) -> Reconciliation:
    """Make the index say what the files say.

    Parameters
    ----------
    folder : Folder
        Held by this process alone.
    index : Index
    thorough : bool
        Read every file; else only records, and results that the index does not know.
    progress : callable, optional

    Raises
    ------
    OlderFileError
        If it is not thorough, and a file was written by an older version.
    StoreError
        If a file cannot be removed or written; the index is as it was.
    """
    scan = folder.scan()
    remove_durably(*scan.temporaries)
    scan.deletions.update(_returned(folder, scan))
    for sequence_id in sorted(scan.deletions):
        finish_deletion(folder, index, sequence_id)
    for reference in sorted(scan.models & scan.deleted_models):
        remove_durably(folder.model(reference))
    sequence_ids = sorted((scan.records | scan.uploads) - scan.deletions)
    results = sorted(name for name in scan.results if name.sequence_id not in scan.deletions)
    records: list[SequenceRecord] = []
    damaged: list[str] = []
    restored: list[str] = []
    total = len(sequence_ids) + len(results)
    for number, sequence_id in enumerate(sequence_ids, 1):
        path, upload = folder.record(sequence_id), folder.upload(sequence_id)
        try:
            record, is_new = _record(folder, index, scan, sequence_id)
        except StoreError as error:
            _pass_over(error, thorough=thorough)
            damaged.append(folder.short(path if path.exists() else upload))
            continue
        records.append(record)
        if thorough and record.has_upload and not is_sound(upload):
            damaged.append(folder.short(upload))
        if is_new:
            restored.append(folder.short(path))
        if progress is not None:
            progress(number, total)
    owners = {record.id for record in records}
    orphans = [folder.short(path) for path in scan.foreign]
    rows: list[tuple[ResultName, str]] = []
    for number, name in enumerate(results, len(sequence_ids) + 1):
        path = folder.result(name)
        if name.sequence_id not in owners:
            orphans.append(folder.short(path))
            continue
        try:
            digest = None if thorough else index.digest(name)
            rows.append((name, digest or _FORMS[name.kind].digest(path)))
        except StoreError as error:
            _pass_over(error, thorough=thorough)
            damaged.append(folder.short(path))
        if progress is not None:
            progress(number, total)
    models = _models(folder, index, scan, damaged, thorough=thorough)
    with index.database.write(erases=True) as connection:
        connection.execute("DELETE FROM sequences")
        # As they came: a page of a list then reads neighbours.
        put_records(connection, sorted(records, key=lambda record: (record.created, record.id)))
        put_results(connection, rows)
        recount(connection)
        connection.execute("DELETE FROM models")
        put_models(connection, models)
    return Reconciliation(
        n_sequences=len(records),
        n_results=len(rows),
        n_deletions=len(scan.deletions),
        n_temporaries=len(scan.temporaries),
        restored=tuple(restored),
        damaged=tuple(damaged),
        orphans=tuple(sorted(orphans)),
        n_models=sum(record.deleted is None for record in models),
    )


def _returned(folder: Folder, scan: Scan) -> Iterator[str]:
    """List sequences that are there though they were deleted; remove what else came back so.

    A copy of older files that was laid over the folder brings them; what was put after the
    deletion is newer than its tombstone.
    """
    for sequence_id in scan.records - scan.deletions:
        with contextlib.suppress(StoreError):
            time = buried(folder.root, sequence_id)
            if time is not None and read_record(folder.record(sequence_id)).created <= time:
                yield sequence_id
    by_time: list[tuple[set[Any], Any, str, tuple[Path, ...]]] = [
        *((scan.templates, one, one, (folder.template(one),)) for one in scan.templates),
        *((scan.norms, one, digest_of_norm(one), (folder.norm(one),)) for one in scan.norms),
    ]
    for name in scan.results:
        if name.kind == "signature":
            path = folder.result(name)
            by_time.append((scan.results, name, path.stem, (path, path.with_suffix(RENDERED))))
    for images_id in scan.images | scan.image_records:
        files = (folder.images_record(images_id), folder.images(images_id))
        by_time.append((scan.images, images_id, images_id, files))
    for names, thing, digest, paths in by_time:
        time = buried(folder.root, digest)
        # Of a signature its file decides, for what was rendered of the old one may lie beside it.
        judged = paths if names is scan.images else paths[:1]
        is_back = time is not None and any(
            path.exists() and is_older(path.stat().st_mtime, time) for path in judged
        )
        # Samples without a record: putting them was cut short, and never confirmed.
        if is_back or (names is scan.images and thing not in scan.image_records):
            remove_durably(*paths)
            names.discard(thing)


def _models(
    folder: Folder, index: Index, scan: Scan, damaged: list[str], *, thorough: bool
) -> list[ModelRecord]:
    """Read the records of all versions of models, which are few, from their files."""
    known = {record.reference: record for record in index.models()}
    records = []
    for reference in sorted(scan.models - scan.deleted_models):
        path = folder.model(reference)
        try:
            stored_model, contents = read_kept_model(path)
            require_match(path, contents, model=reference.name, version=reference.version)
        except StoreError as error:
            _pass_over(error, thorough=thorough)
            damaged.append(folder.short(path))
        else:
            records.append(stored_model.record)
    for reference in sorted(scan.deleted_models):
        path = folder.deleted_model(reference)
        try:
            records.append(deleted_record(path, reference))
        except StoreError:
            # The number is taken all the same; what the model was, the index may know.
            damaged.append(folder.short(path))
            if reference in known and known[reference].deleted is not None:
                records.append(known[reference])
    return records


def _record(
    folder: Folder, index: Index, scan: Scan, sequence_id: str
) -> tuple[SequenceRecord, bool]:
    """Record of a sequence, and whether it had to be written anew."""
    path, has_upload = folder.record(sequence_id), sequence_id in scan.uploads
    record: SequenceRecord | None = None
    with contextlib.suppress(NotFoundError, CorruptFileError):
        record = read_record(path)
    if record is not None and record.id == sequence_id and record.has_upload == has_upload:
        return record, False
    if record is None or record.id != sequence_id:
        # The index may know what the file does not.
        record = index.find(sequence_id)
    if record is None:
        # Vertices know neither subject nor label, and the file only when it was written.
        upload = folder.upload(sequence_id)
        sequence, contents = read_sequence(upload)
        require_match(upload, contents, sequence_id=sequence_id)
        record = record_of(sequence, created=to_text(upload.stat().st_mtime), has_upload=True)
    record = replace(record, has_upload=has_upload)
    write_atomic(path, record_to_json(record))
    return record, True


def _pass_over(error: StoreError, *, thorough: bool) -> None:
    """Go on after a file that does not read, unless another version reads it and may yet come."""
    if isinstance(error, OlderFileError) and not thorough:
        raise error
