"""The index compared with the folder: verified, rebuilt, and repaired after a crash."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final, TypeVar

from modalmotion.classification.answer_hdf5 import read_classification
from modalmotion.classification.card import ModelRecord, ModelReference
from modalmotion.classification.model_files import read_kept_model
from modalmotion.errors import CorruptFileError, NotFoundError, StoreError
from modalmotion.hdf5.image import require_match
from modalmotion.hdf5.sealed import digest_of, is_sound
from modalmotion.images.hdf5 import read_images_file
from modalmotion.mesh.sequence import MeshSequence, read_sequence
from modalmotion.norm.norm import norm_from_hdf5
from modalmotion.progress import Progress
from modalmotion.representation import shown
from modalmotion.signature.hdf5 import read_signature
from modalmotion.store.database import Database, ServiceTable
from modalmotion.store.deletion import (
    buried,
    deleted_record,
    digest_of_norm,
    finish_deletion,
    is_older,
)
from modalmotion.store.disk import FolderLock, remove_durably, write_atomic
from modalmotion.store.folder import (
    IMAGES_FORM,
    RENDERED,
    Folder,
    ResultName,
    Scan,
    SequenceRecord,
    read_record,
    record_of,
    record_to_json,
)
from modalmotion.store.index import Index, put_models, put_records, put_results, to_text
from modalmotion.template.template import read_template
from modalmotion.tracking.hdf5 import read_track

T = TypeVar("T")
_STRANGE_VERTICES: Final = "Its vertices are not those that its id represents."

# Readers of whole files: each gives what the index has of one, if that has a row of it.


def _record(path: Path, sequence_id: str) -> SequenceRecord:
    record = read_record(path)
    if record.id != sequence_id:
        raise StoreError("It is the record of another sequence.")
    return record


def _upload(path: Path, sequence_id: str) -> MeshSequence:
    sequence, contents = read_sequence(path)
    require_match(path, contents, sequence_id=sequence_id)
    if sequence.id != sequence_id:
        raise StoreError(_STRANGE_VERTICES)
    return sequence


def _result(path: Path, name: ResultName) -> str:
    ids = {"sequence_id": name.sequence_id, "parameters_key": name.key}
    if name.kind == "signature":
        require_match(path, read_signature(path)[1], **ids)
    elif name.kind == "classification":
        require_match(path, read_classification(path)[1], **ids, model_id=name.model_id)
    else:
        track, contents = read_track(path)
        require_match(path, contents, sequence_id=name.sequence_id)
        if track.sequence.id != name.sequence_id:
            raise StoreError(_STRANGE_VERTICES)
    return digest_of(path.read_bytes())


def _template(path: Path, template_id: str) -> None:
    require_match(path, read_template(path)[1], template_id=template_id)


def _images_record(path: Path, images_id: str) -> None:
    if IMAGES_FORM.read(path).get("id") != images_id:
        raise StoreError("It is the record of other images.")
    if not path.with_suffix(".h5").exists():
        raise StoreError("The samples that it describes are missing.")


def _images(path: Path, images_id: str) -> None:
    if read_images_file(path).id != images_id:
        raise StoreError("The samples are not those that their id represents.")


def _norm(path: Path, name: str) -> None:
    if norm_from_hdf5(path).name != name:
        raise StoreError("It is the norm of another name.")


def _model(path: Path, reference: ModelReference) -> ModelRecord:
    model, contents = read_kept_model(path)
    require_match(path, contents, model=reference.name, version=reference.version)
    return model.record


_FILES: Final[dict[str, tuple[Callable[[Folder, Any], Path], Callable[[Path, Any], Any]]]] = {
    "records": (Folder.record, _record),
    "uploads": (Folder.upload, _upload),
    "results": (Folder.result, _result),
    "templates": (Folder.template, _template),
    "image_records": (Folder.images_record, _images_record),
    "images": (Folder.images, _images),
    "norms": (Folder.norm, _norm),
    "models": (Folder.model, _model),
    "deleted_models": (Folder.deleted_model, deleted_record),
}
"""Path and reader of the files of each field of `Scan`."""


@shown()
@dataclass(frozen=True)
class Fault:
    """One thing that is wrong.

    Parameters
    ----------
    file : str
        Path within the store.
    problem : str
    """

    file: str
    problem: str


@shown("n_sequences", "n_results", "n_models", "n_bytes", "faults")
@dataclass(frozen=True)
class VerifyReport:
    """Report of a check of a store.

    Parameters
    ----------
    n_sequences, n_results : int
        Files of records and of results.
    n_bytes : int
        Size of all files that were read.
    faults : tuple of Fault
    unfinished : tuple of str
        Leftovers of a crash, which the next `open` finishes or removes.
    orphans : tuple of str
        Results of no sequence, and files that are not the store's.
    n_models : int
        Files of models.
    """

    n_sequences: int
    n_results: int
    n_bytes: int
    faults: tuple[Fault, ...]
    unfinished: tuple[str, ...]
    orphans: tuple[str, ...]
    n_models: int = 0

    @property
    def is_sound(self) -> bool:
        """Whether there are no faults; unfinished files and orphans are not faults."""
        return not self.faults


def verify(root: Path, *, progress: Progress | None = None) -> VerifyReport:
    """Read every file of a store and compare it with the index; nothing is changed.

    Parameters
    ----------
    root : Path
    progress : callable, optional

    Raises
    ------
    NotFoundError
        If there is no store.
    StoreError
        If another process has it open, or its folder cannot be read.
    """
    folder = existing_store(root)
    with FolderLock(folder.lock), contextlib.ExitStack() as stack:
        scan = folder.scan()
        faults: list[Fault] = []
        missing: list[str] = []
        known: dict[str, Callable[[Any], Any]] = {}
        is_clean = False
        if folder.index.is_file():
            try:
                index = Index(stack.enter_context(contextlib.closing(Database(folder.index))))
                problems, missing = _index_faults(folder, index, scan)
                faults = [Fault(folder.index.name, problem) for problem in problems]
                models = {record.reference: record for record in index.models()}
                is_clean = index.is_clean
                known = {"records": index.find, "results": index.digest}
                known |= dict.fromkeys(("models", "deleted_models"), models.get)
            except StoreError as error:
                faults.append(Fault(folder.index.name, error.message))
        else:
            faults.append(Fault(folder.index.name, "It is missing; `modalmotion store rebuild`."))
        files = [
            (path_of(folder, name), place, name)
            for place, (path_of, _) in _FILES.items()
            for name in getattr(scan, place)
        ]
        n_bytes = 0
        unfinished: list[Path] = []
        for number, (path, place, name) in enumerate(sorted(files, key=lambda file: file[0])):
            try:
                n_bytes += path.stat().st_size
                problem = _problem(scan, known, place, name, _FILES[place][1](path, name))
                if problem and (is_clean or place == "uploads"):
                    faults.append(Fault(folder.short(path), problem))
                elif problem:
                    # A crash between two files, or file and index: it was never confirmed.
                    unfinished.append(path)
            except StoreError as error:
                faults.append(Fault(folder.short(path), error.message))
            except OSError as error:
                faults.append(Fault(folder.short(path), str(error.strerror)))
            if progress is not None:
                progress(number + 1, len(files))
    unfinished += [
        *scan.temporaries,
        *map(folder.deletion, scan.deletions),
        *map(folder.images, scan.images - scan.image_records),
        *map(folder.model, scan.models & scan.deleted_models),
    ]
    known_ids = scan.records | scan.deletions
    orphans = [folder.result(name) for name in scan.results if name.sequence_id not in known_ids]
    lost = "It is missing, though the index knows it."
    return VerifyReport(
        n_sequences=len(scan.records),
        n_results=len(scan.results),
        n_bytes=n_bytes,
        faults=(*faults, *(Fault(file, lost) for file in missing)),
        unfinished=tuple(sorted(map(folder.short, unfinished))),
        orphans=tuple(sorted(map(folder.short, [*scan.foreign, *orphans]))),
        n_models=len(scan.models),
    )


def _problem(
    scan: Scan, known: dict[str, Callable[[Any], Any]], place: str, name: Any, row: Any
) -> str:
    """Return what is wrong with a file that can be read, among the others and in the index."""
    if place == "uploads" and not (name in scan.records or name in scan.deletions):
        return "Its record is missing."
    if place == "records" and row.has_upload and name not in scan.uploads:
        return "Its vertices are recorded as kept, but are missing."
    is_listed = not (
        (place == "results" and name.sequence_id not in scan.records)
        or (place == "models" and name in scan.deleted_models)
    )
    if place in known and is_listed and known[place](name) != row:
        return "The index does not know it, or knows it otherwise."
    return ""


def _index_faults(folder: Folder, index: Index, scan: Scan) -> tuple[list[str], list[str]]:
    """List what is wrong with an index by itself, and files that it knows and that are missing."""
    problems = index.database.faults()
    paths = [
        *(folder.record(name) for name in index.ids() if name not in scan.records),
        *(folder.result(name) for name in index.results() if name not in scan.results),
        *(
            folder.model(one)
            for one in {record.reference for record in index.models()}
            - scan.models
            - scan.deleted_models
        ),
    ]
    missing = [folder.short(p) for p in sorted(paths) if p.name[:64] not in scan.deletions]
    if index.count() != index.recount():
        problems.append("It miscounts its rows; `modalmotion store rebuild`.")
    return problems, missing


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
    service_tables_lost : bool
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
    service_tables_lost: bool = False
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
        database, service_tables_lost = _usable(folder)
        try:
            index = Index(database)
            reconciliation = reconcile(folder, index, thorough=True, progress=progress)
            index.set_clean(True)
        finally:
            database.close()
        # From here on it is a store, if it was a backup.
        remove_durably(root / "backup.json")
    return replace(reconciliation, service_tables_lost=service_tables_lost)


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
    tables: list[ServiceTable] | None = None
    with contextlib.suppress(CorruptFileError):
        database = Database(folder.index)
        if not database.faults():
            return database, False
        with contextlib.suppress(StoreError):
            tables = database.service_tables()
        with contextlib.suppress(StoreError):
            database.close()
    # The log goes first: beside a new index an old one would be a danger.
    remove_durably(*reversed(folder.index_files))
    database = Database(folder.index)
    database.receive(tables or ())
    return database, tables is None


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
    damaged: list[str] = []
    restored: list[str] = []

    def read(path: Path, reader: Callable[[], T]) -> T | None:
        try:
            return reader()
        except StoreError:
            damaged.append(folder.short(path))
            return None

    sequence_ids = sorted((scan.records | scan.uploads) - scan.deletions)
    results = sorted(name for name in scan.results if name.sequence_id not in scan.deletions)
    steps = iter(range(1, len(sequence_ids) + len(results) + 1))

    def count() -> None:
        if progress is not None:
            progress(next(steps), len(sequence_ids) + len(results))

    records: dict[str, SequenceRecord] = {}
    for sequence_id in sequence_ids:
        path, upload = folder.record(sequence_id), folder.upload(sequence_id)
        read_one = partial(_mended, folder, index, scan, sequence_id)
        found = read(path if path.exists() else upload, read_one)
        if found is not None:
            records[sequence_id], is_new = found
            if thorough and found[0].has_upload and not is_sound(upload):
                damaged.append(folder.short(upload))
            restored += [folder.short(path)] * is_new
        count()
    orphans = [folder.short(path) for path in scan.foreign]
    rows: list[tuple[ResultName, str]] = []
    for name in results:
        path = folder.result(name)
        if name.sequence_id not in records:
            orphans.append(folder.short(path))
        else:
            known = None if thorough else index.digest(name)
            digest = known or read(path, partial(_result, path, name))
            rows += [] if digest is None else [(name, digest)]
        count()
    known_models = {record.reference: record for record in index.models()}
    models = []
    for reference in sorted(scan.models | scan.deleted_models):
        is_deleted = reference in scan.deleted_models
        path = folder.deleted_model(reference) if is_deleted else folder.model(reference)
        record = read(path, partial(deleted_record if is_deleted else _model, path, reference))
        if record is None and is_deleted:
            # The number is taken all the same; what the model was, the index may know.
            record = known_models.get(reference)
            record = None if record is None or record.deleted is None else record
        models += [] if record is None else [record]
    with index.database.write(erases=True) as connection:
        connection.execute("DELETE FROM sequences")
        # A damaged index may have miscounted its rows.
        connection.execute("UPDATE counts SET number = 0")
        # As they came: a page of a list then reads neighbours.
        put_records(connection, sorted(records.values(), key=lambda one: (one.created, one.id)))
        put_results(connection, rows)
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


def _mended(
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
        created = to_text(upload.stat().st_mtime) if has_upload else ""
        record = record_of(_upload(upload, sequence_id), created=created, has_upload=True)
    record = replace(record, has_upload=has_upload)
    write_atomic(path, record_to_json(record))
    return record, True
