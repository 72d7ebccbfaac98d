"""Signatures that another process has written for a store, ready to be moved into it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from modalmotion.errors import StoreError
from modalmotion.hdf5.sealed import digest_of, is_sound, load_sealed
from modalmotion.representation import shown
from modalmotion.store.disk.atomic import write_atomic
from modalmotion.store.folder import Folder, ResultName, is_id, is_key
from modalmotion.store.index.cursor import now
from modalmotion.store.index.index import Index
from modalmotion.store.record import SequenceRecord, record_to_json, require_name
from modalmotion.store.tombstones import buried


@shown()
@dataclass(frozen=True)
class StagedSignature:
    """A signature and its sequence, durable in files that lie on the store's own disk.

    Parameters
    ----------
    record : SequenceRecord
        Of the sequence, for a store that does not know it yet.
    record_file : Path
        The same record, as `record_to_json` writes it.
    key : str
        Of the signature's parameters.
    signature : Path
        As `signature_image` writes it.
    vertices : Path or None
        As `upload_image` writes it; None if they are not to be kept.
    """

    record: SequenceRecord
    record_file: Path
    key: str
    signature: Path
    vertices: Path | None

    def require_names(self) -> None:
        """Raise StoreError or ParameterError if something could not be kept under its name."""
        require_name("subject", self.record.subject)
        require_name("label", self.record.label)
        if not is_id(self.record.id) or not is_key(self.key):
            raise StoreError(
                f"A signature of {self.record.id[:12]!r} with the key {self.key[:16]!r} cannot be "
                "kept: these are not digests.",
                remedy="Use the sequence's own id and the key of the signature's parameters.",
            )


class Transfer:
    """Transfer of staged signatures to a store: files to move, and rows for its index.

    Parameters
    ----------
    folder : Folder
    index : Index
        As they are; no other changes to these sequences are possible.
    """

    def __init__(self, folder: Folder, index: Index) -> None:
        self._folder = folder
        self._index = index
        self._records: dict[str, SequenceRecord] = {}
        self.results: dict[ResultName, str] = {}
        self.moves: list[tuple[Path, Path]] = []

    @property
    def records(self) -> Iterable[SequenceRecord]:
        """Records that are new or changed."""
        return self._records.values()

    def add(self, one: StagedSignature) -> bool:
        """Take the files of a signature that the store lacks; tell whether its sequence is new.

        Raises
        ------
        StoreError
            If a file cannot be read or written, or has no sound seal.
        """
        is_new = self._add_sequence(one)
        name = ResultName("signature", one.record.id, "", one.key)
        path = self._folder.result(name)
        if name not in self.results and (self._index.digest(name) is None or not is_sound(path)):
            self.results[name] = digest_of(load_sealed(one.signature)[1])
            self.moves.append((one.signature, path))
        return is_new

    def _add_sequence(self, one: StagedSignature) -> bool:
        sequence_id = one.record.id
        if sequence_id in self._records:
            return False
        known, upload = self._index.find(sequence_id), self._folder.upload(sequence_id)
        adds_upload = one.vertices is not None and (known is None or not is_sound(upload))
        if known is not None:
            record = replace(known, has_upload=known.has_upload or adds_upload)
        elif (buried(self._folder.root, sequence_id) or "") >= one.record.created:
            # Staged before it was deleted, and put after it.
            record = replace(one.record, created=now())
        else:
            record = one.record
        if record not in (known, one.record):
            write_atomic(one.record_file, record_to_json(record))
        # The record first: vertices alone would come back from a crash without a subject.
        if record != known:
            self._records[sequence_id] = record
            self.moves.append((one.record_file, self._folder.record(sequence_id)))
        if one.vertices is not None and adds_upload:
            load_sealed(one.vertices)
            self.moves.append((one.vertices, upload))
        return known is None
