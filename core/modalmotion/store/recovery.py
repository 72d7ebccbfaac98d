"""The index compared with the folder: verified, rebuilt, and repaired after a crash."""

import contextlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from modalmotion.classification import answer, card, model_files
from modalmotion.errors import CorruptFileError, NotFoundError, StoreError
from modalmotion.hdf5 import sealed
from modalmotion.images.hdf5 import read_images_file
from modalmotion.mesh.sequence import sequence_from_hdf5
from modalmotion.norm.norm import norm_from_hdf5
from modalmotion.progress import Reporter, reported
from modalmotion.representation import shown
from modalmotion.signature.hdf5 import signature_from_hdf5
from modalmotion.store import deletion, disk, folders
from modalmotion.store.database import Database, ServiceTable
from modalmotion.store.index import Index, put_models, put_records, put_results, to_text
from modalmotion.template.template import template_from_hdf5
from modalmotion.tracking.hdf5 import track_from_hdf5

_STRANGE_VERTICES: Final = "Its vertices do not match its id."

# Readers of whole files: each gives what the index has of one, if that has a row of it.


def _record(path: Path, sequence_id: str) -> folders.SequenceRecord:
    record = folders.read_record(path)
    if record.id != sequence_id:
        raise CorruptFileError("It is the record of another sequence.")
    return record


def _upload(path: Path, sequence_id: str) -> folders.SequenceRecord:
    """Record made of the vertices, which know neither subject nor label, nor when they came."""
    sequence = sequence_from_hdf5(path, ids={"sequence_id": sequence_id})
    if sequence.id != sequence_id:
        raise StoreError(_STRANGE_VERTICES)
    return folders.record_of(sequence, created=to_text(path.stat().st_mtime), has_upload=True)


def _result(path: Path, name: folders.ResultName) -> str:
    ids = {"sequence_id": name.sequence_id, "parameters_key": name.key}
    if name.kind == "signature":
        signature_from_hdf5(path, ids)
    elif name.kind == "classification":
        answer.classification_from_hdf5(path, {**ids, "model_id": name.model_id})
    else:
        track = track_from_hdf5(path, {"sequence_id": name.sequence_id})
        if track.sequence.id != name.sequence_id:
            raise StoreError(_STRANGE_VERTICES)
    return sealed.digest_of(path.read_bytes())


def _template(path: Path, template_id: str) -> None:
    template_from_hdf5(path, {"template_id": template_id})


def _images_record(path: Path, images_id: str) -> None:
    if folders.IMAGES_FORM.read(path).get("id") != images_id:
        raise StoreError("It is the record of other images.")
    if not path.with_suffix(".h5").exists():
        raise StoreError("Its samples are missing.")


def _images(path: Path, images_id: str) -> None:
    if read_images_file(path).id != images_id:
        raise StoreError("The samples do not match their id.")


def _norm(path: Path, name: str) -> None:
    if norm_from_hdf5(path).name != name:
        raise StoreError("It is a norm with another name.")


def _model(path: Path, reference: card.ModelReference) -> card.ModelRecord:
    ids = {"model": reference.name, "version": reference.version}
    return model_files.read_kept_model(path, ids).record


_READERS: Final[dict[str, Callable[[Path, Any], Any]]] = {
    "records": _record,
    "uploads": _upload,
    "results": _result,
    "templates": _template,
    "image_records": _images_record,
    "images": _images,
    "norms": _norm,
    "models": _model,
    "deleted_models": deletion.deleted_record,
}
"""By place."""


def _rows(
    folder: folders.Folder, files: Iterable[tuple[str, Any]], progress: Reporter | None
) -> Iterator[tuple[Path, str, Any, Any]]:
    """Read files of places and names: gives path, place, name, and the row or what is wrong."""
    chosen = sorted(((folder.path(*file), *file) for file in files), key=lambda file: file[0])
    for path, place, name in reported(chosen, progress):
        try:
            row = _READERS[place](path, name)
        except StoreError as error:
            row = error
        except OSError as error:
            row = StoreError(str(error.strerror))
        yield path, place, name, row


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


def verify(root: Path, *, progress: Reporter | None = None) -> VerifyReport:
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
    faults: list[Fault] = []
    missing: list[str] = []
    unfinished: list[Path] = []
    known: dict[str, Callable[[Any], Any]] = {}
    is_clean, n_bytes = False, 0
    with disk.FolderLock(folder.lock), contextlib.ExitStack() as stack:
        scan = folder.scan()
        if not folder.index.is_file():
            faults = [Fault(folder.index.name, "It is missing; run `modalmotion store rebuild`.")]
        else:
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
        files = ((place, name) for place in _READERS for name in scan[place])
        for path, place, name, row in _rows(folder, files, progress):
            is_read = not isinstance(row, StoreError)
            n_bytes += path.stat().st_size if path.exists() else 0
            problem = _problem(scan, known, place, name, row) if is_read else row.message
            if problem and (is_clean or place == "uploads" or not is_read):
                faults.append(Fault(folder.short(path), problem))
            elif problem:
                # A crash between two files, or file and index: it was never confirmed.
                unfinished.append(path)
    unfinished += [
        *scan["temporaries"],
        *(folder.path("deletions", name) for name in scan["deletions"]),
        *(folder.path("images", name) for name in scan["images"] - scan["image_records"]),
        *(folder.path("models", name) for name in scan["models"] & scan["deleted_models"]),
    ]
    known_ids = scan["records"] | scan["deletions"]
    orphans = {name for name in scan["results"] if name.sequence_id not in known_ids}
    strays = [*scan["foreign"], *(folder.path("results", name) for name in orphans)]
    lost = "It is in the index, but its file is missing."
    return VerifyReport(
        n_sequences=len(scan["records"]),
        n_results=len(scan["results"]),
        n_bytes=n_bytes,
        faults=(*faults, *(Fault(file, lost) for file in missing)),
        unfinished=tuple(sorted(map(folder.short, unfinished))),
        orphans=tuple(sorted(map(folder.short, strays))),
        n_models=len(scan["models"]),
    )


def _problem(
    scan: folders.Scan, known: dict[str, Callable[[Any], Any]], place: str, name: Any, row: Any
) -> str:
    """Return what is wrong with a file that can be read, among the others and in the index."""
    if place == "uploads" and not (name in scan["records"] or name in scan["deletions"]):
        return "Its record is missing."
    if place == "records" and row.has_upload and name not in scan["uploads"]:
        return "Its vertices were kept according to its record, but are missing."
    is_listed = not (
        (place == "results" and name.sequence_id not in scan["records"])
        or (place == "models" and name in scan["deleted_models"])
    )
    if place in known and is_listed and known[place](name) != row:
        return "It is not in the index, or differs from its entry."
    return ""


def _index_faults(
    folder: folders.Folder, index: Index, scan: folders.Scan
) -> tuple[list[str], list[str]]:
    """List what is wrong with an index by itself, and files that it knows and that are missing."""
    problems = index.database.faults()
    models = {record.reference for record in index.models()}
    paths = [
        *(folder.path("records", name) for name in index.ids() if name not in scan["records"]),
        *(folder.path("results", name) for name in index.results() if name not in scan["results"]),
        *(folder.path("models", one) for one in models - scan["models"] - scan["deleted_models"]),
    ]
    missing = [folder.short(p) for p in sorted(paths) if p.name[:64] not in scan["deletions"]]
    if index.count() != index.recount():
        problems.append("Its row counts are wrong; run `modalmotion store rebuild`.")
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


def rebuild(root: Path, *, progress: Reporter | None = None) -> Reconciliation:
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
    with disk.FolderLock(folder.lock):
        database, service_tables_lost = _usable(folder)
        try:
            index = Index(database)
            reconciliation = reconcile(folder, index, thorough=True, progress=progress)
            index.set_clean(True)
        finally:
            database.close()
        # From here on it is a store, if it was a backup.
        disk.remove_durably(root / "backup.json")
    return replace(reconciliation, service_tables_lost=service_tables_lost)


def existing_store(root: Path) -> folders.Folder:
    """Folder of a store that is there.

    Raises
    ------
    NotFoundError
        If there is none.
    """
    folder = folders.Folder(root)
    if not folder.exists:
        raise NotFoundError(
            f"'{root.name}' contains no store.",
            remedy="Name the folder that contains 'index.sqlite' and 'sequences'.",
        )
    return folder


def _usable(folder: folders.Folder) -> tuple[Database, bool]:
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
    disk.remove_durably(*reversed(folder.index_files))
    database = Database(folder.index)
    database.receive(tables or ())
    return database, tables is None


def reconcile(
    folder: folders.Folder, index: Index, *, thorough: bool, progress: Reporter | None = None
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
    disk.remove_durably(*scan["temporaries"])
    scan["deletions"].update(_returned(folder, scan))
    for sequence_id in sorted(scan["deletions"]):
        deletion.finish_deletion(folder, index, sequence_id)
    for reference in scan["models"] & scan["deleted_models"]:
        disk.remove_durably(folder.path("models", reference))
    ids = (scan["records"] | scan["uploads"]) - scan["deletions"]
    results = {name for name in scan["results"] if name.sequence_id not in scan["deletions"]}
    known: dict[Any, Any] = {}
    if not thorough:
        known = {name: digest for name in results if (digest := index.digest(name)) is not None}
    wanted = {
        "records": ids & scan["records"],
        "uploads": ids & scan["uploads"] if thorough else (),
        "results": {one for one in results - known.keys() if one.sequence_id in ids},
        "models": scan["models"] - scan["deleted_models"],
        "deleted_models": scan["deleted_models"],
    }
    damaged: dict[Path, StoreError] = {}
    read: dict[str, dict[Any, Any]] = {place: {} for place in wanted}
    files = ((place, name) for place, names in wanted.items() for name in names)
    for path, place, name, row in _rows(folder, files, progress):
        if isinstance(row, StoreError):
            damaged[path] = row
        else:
            read[place][name] = row
    read["results"] |= known
    restored: list[str] = []
    records: dict[str, folders.SequenceRecord] = read["records"]
    for sequence_id in sorted(ids):
        path, has_upload = folder.path("records", sequence_id), sequence_id in scan["uploads"]
        record, error = records.get(sequence_id), damaged.get(path)
        is_newer = error is not None and not isinstance(error, NotFoundError | CorruptFileError)
        if is_newer or (record is not None and record.has_upload == has_upload):
            continue
        upload = folder.path("uploads", sequence_id)
        try:
            # The index may know what the file does not.
            record = record or index.find(sequence_id) or _upload(upload, sequence_id)
        except StoreError as unknown:
            damaged[path if path.exists() else upload] = unknown
            continue
        records[sequence_id] = replace(record, has_upload=has_upload)
        disk.write_atomic(path, folders.record_to_json(records[sequence_id]))
        restored.append(folder.short(path))
        damaged.pop(path, None)
    known_models = {record.reference: record for record in index.models()}
    models: dict[card.ModelReference, card.ModelRecord] = read["models"] | read["deleted_models"]
    for reference in scan["deleted_models"] - models.keys():
        # The number is taken all the same; what the model was, the index may know.
        gone = known_models.get(reference)
        if gone is not None and gone.deleted is not None:
            models[reference] = gone
    rows = {name: row for name, row in read["results"].items() if name.sequence_id in records}
    with index.database.write(erases=True) as connection:
        connection.execute("DELETE FROM sequences")
        # A damaged index may have miscounted its rows.
        connection.execute("UPDATE counts SET number = 0")
        # As they came: a page of a list then reads neighbours.
        put_records(connection, sorted(records.values(), key=lambda one: (one.created, one.id)))
        put_results(connection, rows.items())
        connection.execute("DELETE FROM models")
        put_models(connection, models.values())
    strays = [folder.path("results", one) for one in results if one.sequence_id not in records]
    return Reconciliation(
        n_sequences=len(records),
        n_results=len(rows),
        n_deletions=len(scan["deletions"]),
        n_temporaries=len(scan["temporaries"]),
        restored=tuple(restored),
        damaged=tuple(sorted(map(folder.short, damaged))),
        orphans=tuple(sorted(map(folder.short, [*scan["foreign"], *strays]))),
        n_models=sum(record.deleted is None for record in models.values()),
    )


def _returned(folder: folders.Folder, scan: folders.Scan) -> Iterator[str]:
    """List sequences that are there though they were deleted; remove what else came back so.

    A copy of older files that was laid over the folder brings them; what was put after the
    deletion is newer than its tombstone.
    """
    for sequence_id in scan["records"] - scan["deletions"]:
        with contextlib.suppress(StoreError):
            time = deletion.buried(folder.root, sequence_id)
            path = folder.path("records", sequence_id)
            if time is not None and folders.read_record(path).created <= time:
                yield sequence_id
    signatures = [name for name in scan["results"] if name.kind == "signature"]
    things = [
        *(("templates", one, one) for one in scan["templates"]),
        *(("norms", one, deletion.digest_of_norm(one)) for one in scan["norms"]),
        *(("results", one, folder.path("results", one).stem) for one in signatures),
        *(("images", one, one) for one in scan["images"] | scan["image_records"]),
    ]
    for place, name, digest in things:
        time, path = deletion.buried(folder.root, digest), folder.path(place, name)
        is_image = place == "images"
        # A record of images, or what was rendered of a signature.
        beside = [path.with_suffix(folders.RENDERED)] if is_image or place == "results" else []
        # Of a signature its file decides, for what was rendered of the old one may lie beside it.
        is_back = time is not None and any(
            one.exists() and deletion.is_older(one.stat().st_mtime, time)
            for one in (path, *(beside if is_image else []))
        )
        # Samples without a record: putting them was cut short, and never confirmed.
        if is_back or (is_image and name not in scan["image_records"]):
            disk.remove_durably(path, *beside)
            scan[place].discard(name)
