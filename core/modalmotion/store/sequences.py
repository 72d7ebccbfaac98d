"""The part of the store that keeps sequences."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import MappingProxyType

from modalmotion.errors import NotFoundError
from modalmotion.facts import NO_FACTS
from modalmotion.hdf5.sealed import digest_of, is_sound, load_sealed
from modalmotion.mesh.hdf5 import read_sequence, sequence_to_hdf5
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.store.deletion import begin_deletion, finish_deletion
from modalmotion.store.folder import ResultName, is_id
from modalmotion.store.index.cursor import now
from modalmotion.store.opening import unknown_sequence
from modalmotion.store.record import SequenceRecord, record_of, record_to_json, require_name
from modalmotion.store.sequence_records import SequenceRecords


class SequenceStore(SequenceRecords):
    """Sequences in a folder.

    Parameters
    ----------
    root : Path
        The folder; made where it is missing.
    keep_uploads : bool
        Whether the vertices of new sequences are kept, or only their records.
    """

    def __init__(self, root: Path, *, keep_uploads: bool = True) -> None:
        super().__init__(root)
        self.keep_uploads = keep_uploads

    def put_sequence(
        self, sequence: MeshSequence, *, subject: str | None = None, label: str | None = None
    ) -> bool:
        """Keep a sequence.

        Parameters
        ----------
        sequence : MeshSequence
            With its facts.
        subject, label : str, optional
            For a sequence that is new, as its facts are; `update_sequence` changes those of a
            known one.

        Returns
        -------
        bool
            True if it was not known before. Vertices of a known one are written again only
            where they are missing or damaged.

        Raises
        ------
        ParameterError
            If subject or label cannot be kept.
        StoreError
            If it cannot be written; the store is as it was.
        """
        record = record_of(sequence, created="", has_upload=True, subject=subject, label=label)
        _, is_new = self._put(record, lambda: upload_image(sequence))
        return is_new

    def put_sequence_image(
        self,
        image: Path,
        record: SequenceRecord,
        *,
        subject: str | None = None,
        label: str | None = None,
    ) -> tuple[SequenceRecord, bool]:
        """Keep a sequence that another process has written with `upload_image`.

        Parameters
        ----------
        image : Path
            Sealed HDF5 file; it is copied.
        record : SequenceRecord
            Of the sequence in it; when it came, whose it is and what it shows are set here.
        subject, label : str, optional
            As for `put_sequence`.

        Returns
        -------
        record : SequenceRecord
            The stored one.
        is_new : bool
            As `put_sequence` returns.

        Raises
        ------
        ParameterError, StoreError
            As `put_sequence` does.
        CorruptFileError
            If the image has no sound seal.
        """
        named = replace(record, subject=subject, label=label)
        return self._put(named, lambda: load_sealed(image)[1])

    def _put(
        self,
        record: SequenceRecord,
        image: Callable[[], bytes],
        results: Mapping[ResultName, Callable[[], bytes]] = MappingProxyType({}),
    ) -> tuple[SequenceRecord, bool]:
        """Keep a sequence, and results of it, wholly or not at all; tell whether any is new."""
        require_name("subject", record.subject)
        require_name("label", record.label)
        if not is_id(record.id):
            raise unknown_sequence(record.id)
        index = self._open_index()
        with self._changing(record.id):
            upload = self._folder.upload(record.id)
            known = index.find(record.id)
            is_new = known is None or any(index.digest(name) is None for name in results)
            missing = [
                name
                for name in results
                if index.digest(name) is None or not is_sound(self._folder.result(name))
            ]
            is_there = known is not None and (not self.keep_uploads or is_sound(upload))
            if known is not None and is_there and not missing:
                return known, False
            if known is not None and is_there:
                record = known
            elif known is None:
                # The time is taken here, where no deletion can come between.
                record = replace(record, has_upload=self.keep_uploads, created=now())
            else:
                record = replace(known, has_upload=True)
            files = []
            # The record first: vertices alone would come back from a crash without a subject.
            if record != known:
                files.append((self._folder.record(record.id), record_to_json(record)))
            if self.keep_uploads and not is_there:
                files.append((upload, image()))
            images = {name: results[name]() for name in missing}
            files += [(self._folder.result(name), data) for name, data in images.items()]
            digests = {name: digest_of(data) for name, data in images.items()}
            self._write(files, lambda: index.put_all([record], digests))
            return record, is_new

    def sequence_path(self, sequence_id: str) -> Path:
        """HDF5 file of a sequence's vertices.

        Raises
        ------
        NotFoundError
            If there is no such sequence, or its vertices were not kept.
        LostFileError
            If they were, and are gone.
        """
        return self._present(partial(self._upload, sequence_id), sequence_id)

    def _upload(self, sequence_id: str) -> Path:
        if not self.sequence_record(sequence_id).has_upload:
            raise NotFoundError(
                f"The vertices of sequence {sequence_id[:12]} were not kept.",
                remedy="Send the sequence again, to a store that keeps uploads.",
            )
        return self._folder.upload(sequence_id)

    def sequence(self, sequence_id: str) -> MeshSequence:
        """Sequence with its vertices and its facts.

        Raises
        ------
        NotFoundError
            If there is no such sequence, or its vertices were not kept.
        CorruptFileError
            If its file is damaged; LostFileError if it is gone.
        """
        locate = partial(self._upload, sequence_id)
        sequence = self._read(read_sequence, locate, sequence_id=sequence_id)
        return sequence.with_facts(self.sequence_record(sequence_id).facts)

    def delete_sequence(self, sequence_id: str) -> None:
        """Delete a sequence with all that derives from it.

        Raises
        ------
        NotFoundError
            If there is no such sequence.
        StoreError
            If it could not be begun, and nothing is changed; or not be finished, as the
            message then says: the next call, or the next `open`, finishes it.
        """
        index = self._open_index()
        self.sequence_record(sequence_id)
        with self._changing(sequence_id) as was_deleted:
            if was_deleted:
                return
            self.sequence_record(sequence_id)
            begin_deletion(self._folder, sequence_id)
            finish_deletion(self._folder, index, sequence_id)


def upload_image(sequence: MeshSequence) -> bytes:
    """Write a sequence as its vertices are kept: without facts, which its record has."""
    return sequence_to_hdf5(sequence.with_facts(NO_FACTS))
