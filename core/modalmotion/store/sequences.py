"""The part of the store that keeps sequences, and what is stated about them."""

import contextlib
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import MappingProxyType

from modalmotion import errors, mesh
from modalmotion.hdf5.sealed import digest_of, is_sound, load_sealed
from modalmotion.mesh.sequence import MeshSequence, sequence_from_hdf5, sequence_to_hdf5
from modalmotion.store import deletion, disk, opening
from modalmotion.store.folders import (
    ResultName,
    SequenceRecord,
    is_id,
    record_of,
    record_to_json,
    require_name,
    track_name,
)
from modalmotion.store.index import now


class SequenceStore(opening.SequenceRecords):
    """Sequences in a folder."""

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
        image: bytes | Path,
        record: SequenceRecord,
        *,
        subject: str | None = None,
        label: str | None = None,
    ) -> tuple[SequenceRecord, bool]:
        """Keep a sequence that another process has written with `upload_image`.

        Parameters
        ----------
        image : bytes or Path
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
        """Keep a sequence, and results of it, wholly or not at all; return whether any is new."""
        require_name("subject", record.subject)
        require_name("label", record.label)
        if not is_id(record.id):
            raise opening.unknown_sequence(record.id)
        index = self._open_index()
        with self._changing(record.id):
            known = index.find(record.id)
            is_new = known is None or any(index.digest(name) is None for name in results)
            files, digests = self._missing(record.id, image, results, is_known=known is not None)
            if known is None:
                # The time is taken here, where no deletion can come between.
                record = replace(record, has_upload=self.keep_uploads, created=now())
            elif files:
                record = replace(known, has_upload=known.has_upload or self.keep_uploads)
            else:
                return known, False
            # The record first: vertices alone would come back from a crash without a subject.
            if record != known:
                files.insert(0, (self._folder.path("records", record.id), record_to_json(record)))
            self._write(files, lambda: index.change([record], digests))
            return record, is_new

    def _missing(
        self,
        sequence_id: str,
        image: Callable[[], bytes],
        results: Mapping[ResultName, Callable[[], bytes]],
        *,
        is_known: bool,
    ) -> tuple[list[tuple[Path, bytes]], dict[ResultName, str]]:
        """Make the files that are missing or damaged; gives the digests of the results too."""
        index, upload = self._open_index(), self._folder.path("uploads", sequence_id)
        made = {
            name: make()
            for name, make in results.items()
            if index.digest(name) is None or not is_sound(self._folder.path("results", name))
        }
        files = [(self._folder.path("results", name), data) for name, data in made.items()]
        if self.keep_uploads and not (is_known and is_sound(upload)):
            files.insert(0, (upload, image()))
        return files, {name: digest_of(data) for name, data in made.items()}

    def replace_sequence(
        self,
        sequence_id: str,
        image: Path,
        record: SequenceRecord,
        change: Callable[[SequenceRecord], SequenceRecord],
        track: Path | None = None,
    ) -> SequenceRecord:
        """Keep a sequence in the place of another: after a crash there is one of the two, whole.

        Where the new one was known before, it is changed first and the old one deleted then.

        Parameters
        ----------
        sequence_id : str
            Of the old one, which is deleted with all that derives from it.
        image : Path
            Sealed HDF5 file of the new one, another than the old one.
        record : SequenceRecord
            Of the new one, as for `put_sequence_image`.
        change : callable
            Changes the record of the old one; name, subject, label and facts are the new one's. No
            other change comes between.
        track : Path, optional
            Sealed HDF5 file of the new one's track.

        Returns
        -------
        SequenceRecord
            The stored one.

        Raises
        ------
        NotFoundError
            If there is no such sequence.
        ParameterError
            If name, subject or label cannot be kept, or facts contradict the vertices or times.
        StoreError
            If it cannot be written; the store is as it was.
        """
        index, folder = self._open_index(), self._folder
        self.sequence_record(sequence_id)
        with self._changing(sequence_id, record.id):
            wanted, known = change(self.sequence_record(sequence_id)), index.find(record.id)
            stated = {name: getattr(wanted, name) for name in ("name", "subject", "label")}
            for what, text in stated.items():
                require_name(what, text)
            wanted.facts.require_fit(record.n_vertices, record.span)
            results = (
                {} if track is None else {track_name(record.id): lambda: load_sealed(track)[1]}
            )
            files, digests = self._missing(
                record.id, lambda: load_sealed(image)[1], results, is_known=known is not None
            )
            created = now() if known is None else known.created
            record = replace(
                record,
                **stated,
                has_upload=self.keep_uploads,
                created=created,
                facts=wanted.facts,
            )
            files.insert(0, (folder.path("records", record.id), record_to_json(record)))
            if known is not None:
                self._write(files, lambda: index.change([record], digests))
                deletion.begin_deletion(folder, sequence_id)
            else:
                self._exchange(sequence_id, record, files, digests)
            try:
                deletion.finish_deletion(folder, index, sequence_id)
            except errors.StoreError:
                # It is gone: the next `open` removes what is left of it.
                self._is_clean = False
        return record

    def _exchange(
        self,
        old_id: str,
        record: SequenceRecord,
        files: list[tuple[Path, bytes]],
        digests: Mapping[ResultName, str],
    ) -> None:
        """Write a new sequence and mark another as deleted, in one step."""
        index, folder = self._open_index(), self._folder
        mark, of_old = folder.path("deletions", record.id), folder.path("deletions", old_id)
        self._make_shards(mark.parent)
        # The new one is marked as deleted until it is whole. Then its mark becomes the old one's,
        # by one rename: whoever opens the store after a crash finds one of the two marked.
        disk.write_atomic(mark, b"")
        try:
            for path, data in files:
                self._make_shards(path.parent)
                disk.write_atomic(path, data)
            disk.rename(mark, of_old)
            try:
                index.change([record], digests, without=old_id)
            except BaseException:
                disk.rename(of_old, mark)
                raise
        except BaseException:
            if mark.exists():
                with contextlib.suppress(errors.StoreError):
                    deletion.finish_deletion(folder, index, record.id)
            raise

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
            raise errors.NotFoundError(
                f"The vertices of sequence {sequence_id[:12]} were not kept.",
                remedy="Send the sequence again, to a store that keeps uploads.",
            )
        return self._folder.path("uploads", sequence_id)

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
        sequence = self._read(sequence_from_hdf5, locate, sequence_id=sequence_id)
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
            deletion.begin_deletion(self._folder, sequence_id)
            deletion.finish_deletion(self._folder, index, sequence_id)


def upload_image(sequence: MeshSequence) -> bytes:
    """Write a sequence as its vertices are kept: without facts, which its record has."""
    return sequence_to_hdf5(sequence.with_facts(mesh.NO_FACTS))
