"""Checking a store: every file reads, and index and folder say the same."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, cast

from modalmotion.classification.answer_hdf5 import read_classification
from modalmotion.classification.card import ModelRecord, ModelReference
from modalmotion.classification.model_files import read_kept_model
from modalmotion.errors import StoreError
from modalmotion.hdf5.image import require_match
from modalmotion.hdf5.sealed import digest_of, load_sealed
from modalmotion.images.hdf5 import read_images_file
from modalmotion.mesh.hdf5 import read_sequence
from modalmotion.norm.norm import norm_from_hdf5
from modalmotion.progress import Progress
from modalmotion.representation import shown
from modalmotion.signature.hdf5 import read_signature
from modalmotion.store.database import Database
from modalmotion.store.deletion import deleted_record
from modalmotion.store.disk import FolderLock
from modalmotion.store.folder import Folder, ResultName, Scan, read_record
from modalmotion.store.images import read_images_record
from modalmotion.store.index import Index
from modalmotion.store.recovery import existing_store
from modalmotion.template.hdf5 import read_template
from modalmotion.tracking.hdf5 import read_track


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
    with FolderLock(folder.lock), ExitStack() as stack:
        scan = folder.scan()
        check = _Check(folder, scan)
        index = folder.index
        if index.is_file():
            try:
                check.read_index(stack.enter_context(closing(Database(index))))
            except StoreError as error:
                check.faults.append(Fault(index.name, error.message))
        else:
            check.faults.append(Fault(index.name, "It is missing; `modalmotion store rebuild`."))
        looks: list[tuple[Path, Callable[[], None]]] = []
        for names, place, look in (
            (scan.records, folder.record, check.record),
            (scan.uploads, folder.upload, check.upload),
            (scan.results, folder.result, check.result),
            (scan.templates, folder.template, check.template),
            (scan.image_records, folder.images_record, check.images),
            (scan.norms, folder.norm, check.norm),
            (scan.models, folder.model, check.model),
            (scan.deleted_models, folder.deleted_model, check.deleted_model),
        ):
            looks += [(place(name), partial(look, name)) for name in cast(set[Any], names)]
        for number, (path, read) in enumerate(sorted(looks, key=lambda pair: pair[0])):
            try:
                check.n_bytes += path.stat().st_size
                read()
            except StoreError as error:
                check.faults.append(Fault(folder.short(path), error.message))
            except OSError as error:
                check.faults.append(Fault(folder.short(path), str(error.strerror)))
            if progress is not None:
                progress(number + 1, len(looks))
    unfinished = [folder.short(path) for path in scan.temporaries]
    unfinished += [folder.short(folder.deletion(deleted)) for deleted in scan.deletions]
    unfinished += [folder.short(folder.images(n)) for n in scan.images - scan.image_records]
    return VerifyReport(
        n_sequences=len(scan.records),
        n_results=len(scan.results),
        n_bytes=check.n_bytes,
        faults=tuple(check.faults + check.missing),
        unfinished=tuple(sorted(unfinished + check.unfinished)),
        orphans=tuple(sorted([folder.short(path) for path in scan.foreign] + check.orphans)),
        n_models=len(scan.models),
    )


@dataclass
class _Check:
    """A check under way."""

    folder: Folder
    scan: Scan
    index: Index | None = None
    missing: list[Fault] = field(default_factory=list)
    models: dict[ModelReference, ModelRecord] = field(default_factory=dict)
    is_clean: bool = False
    n_bytes: int = 0
    faults: list[Fault] = field(default_factory=list)
    unfinished: list[str] = field(default_factory=list)
    orphans: list[str] = field(default_factory=list)

    def read_index(self, database: Database) -> None:
        """Let SQLite check its own file, and keep it to compare rows with."""
        folder, scan, index = self.folder, self.scan, Index(database)
        self.faults += [Fault(folder.index.name, text) for text in database.faults()]
        self.models = {record.reference: record for record in index.models()}
        paths = [
            *(folder.record(name) for name in index.ids() if name not in scan.records),
            *(folder.result(name) for name in index.results() if name not in scan.results),
            *map(folder.model, self.models.keys() - scan.models - scan.deleted_models),
        ]
        self.missing = [
            Fault(folder.short(path), "It is missing, though the index knows it.")
            for path in sorted(paths)
            if path.name[:64] not in scan.deletions
        ]
        if index.count() != index.recount():
            problem = "It miscounts its rows; `modalmotion store rebuild`."
            self.faults.append(Fault(folder.index.name, problem))
        self.is_clean = index.is_clean
        self.index = index

    def record(self, sequence_id: str) -> None:
        path = self.folder.record(sequence_id)
        record = read_record(path)
        if record.id != sequence_id:
            raise StoreError("It is the record of another sequence.")
        if record.has_upload and sequence_id not in self.scan.uploads:
            self._differs(path, "The vertices that it says are kept are missing.")
        elif self.index is not None and self.index.find(sequence_id) != record:
            self._differs(path)

    def upload(self, sequence_id: str) -> None:
        path = self.folder.upload(sequence_id)
        sequence, contents = read_sequence(path)
        require_match(path, contents, sequence_id=sequence_id)
        if sequence.id != sequence_id:
            raise StoreError("Its vertices are not those that its id represents.")
        if sequence_id not in self.scan.records | self.scan.deletions:
            raise StoreError("Its record is missing.")

    def result(self, name: ResultName) -> None:
        path = self.folder.result(name)
        ids = {"sequence_id": name.sequence_id, "parameters_key": name.key}
        if name.kind == "signature":
            require_match(path, read_signature(path)[1], **ids)
        elif name.kind == "classification":
            require_match(path, read_classification(path)[1], **ids, model_id=name.model_id)
        else:
            track, contents = read_track(path)
            require_match(path, contents, sequence_id=name.sequence_id)
            if track.sequence.id != name.sequence_id:
                raise StoreError("Its vertices are not those that its id represents.")
        if name.sequence_id in self.scan.deletions:
            return
        if name.sequence_id not in self.scan.records:
            self.orphans.append(self.folder.short(path))
        elif self.index is not None and self.index.digest(name) != digest_of(load_sealed(path)[1]):
            self._differs(path)

    def template(self, template_id: str) -> None:
        path = self.folder.template(template_id)
        require_match(path, read_template(path)[1], template_id=template_id)

    def images(self, images_id: str) -> None:
        path = self.folder.images(images_id)
        record = read_images_record(self.folder.images_record(images_id))
        if images_id not in self.scan.images:
            raise StoreError("The samples that it describes are missing.")
        self.n_bytes += path.stat().st_size
        if read_images_file(path).id != images_id or record.id != images_id:
            raise StoreError("The samples are not those that their id represents.")

    def norm(self, name: str) -> None:
        if norm_from_hdf5(self.folder.norm(name)).name != name:
            raise StoreError("It is the norm of another name.")

    def model(self, reference: ModelReference) -> None:
        path = self.folder.model(reference)
        stored_model, contents = read_kept_model(path)
        require_match(path, contents, model=reference.name, version=reference.version)
        if reference in self.scan.deleted_models:
            # What is noted as deleted and still there is removed by the next `open`.
            self.unfinished.append(self.folder.short(path))
        elif self.index is not None and self.models.get(reference) != stored_model.record:
            self._differs(path)

    def deleted_model(self, reference: ModelReference) -> None:
        path = self.folder.deleted_model(reference)
        record = deleted_record(path, reference)
        if self.index is not None and self.models.get(reference) != record:
            self._differs(path)

    def _differs(
        self, path: Path, problem: str = "The index does not know it, or knows it otherwise."
    ) -> None:
        if self.is_clean:
            raise StoreError(problem)
        # A crash between two files, or file and index: the write was never confirmed.
        self.unfinished.append(self.folder.short(path))
