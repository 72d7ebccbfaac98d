"""Results of a store: signatures, classifications and tracks."""

import hashlib
from dataclasses import replace
from functools import partial
from pathlib import Path

from modalmotion import errors, mesh
from modalmotion.classification.answer import Classification, classification_from_hdf5
from modalmotion.hdf5.sealed import digest_of, is_sound, load_sealed
from modalmotion.signature.hdf5 import signature_from_hdf5, signature_to_hdf5
from modalmotion.signature.making import ModalSignature
from modalmotion.store import deletion, disk, folders, sequences
from modalmotion.store.images import ImageStore
from modalmotion.store.models import ModelStore, NormStore, TemplateStore
from modalmotion.tracking.hdf5 import track_from_hdf5, track_to_hdf5
from modalmotion.tracking.result import Track


class TrackStore(sequences.SequenceStore):
    """A store of sequences that keeps how some of them were tracked.

    Whoever deletes the sequence deletes the track, and the other way round: `delete_sequence`.
    """

    def put_track_images(
        self,
        sequence: Path,
        track: Path,
        record: folders.SequenceRecord,
        *,
        subject: str | None = None,
        label: str | None = None,
    ) -> tuple[folders.SequenceRecord, bool]:
        """Keep a track that another process has written, and its sequence: both or none.

        Parameters
        ----------
        sequence, track : Path
            Sealed HDF5 files of `upload_image` and `track_image`; they are copied.
        record : SequenceRecord
            Of the sequence, as for `put_sequence_image`.
        subject, label : str, optional

        Returns
        -------
        record : SequenceRecord
            The stored one.
        is_new : bool
            True if the track was not known before; of one sequence the first track stays.

        Raises
        ------
        ParameterError
            If subject or label cannot be kept.
        StoreError
            If it cannot be written; the store is as it was.
        CorruptFileError
            If an image has no sound seal.
        """
        named = replace(record, subject=subject, label=label)
        images = {folders.track_name(record.id): lambda: load_sealed(track)[1]}
        return self._put(named, lambda: load_sealed(sequence)[1], images)

    def track_record(self, track_id: str) -> folders.SequenceRecord:
        """Look up the record of a tracked sequence.

        Raises
        ------
        NotFoundError
            If there is no such track.
        """
        index = self._open_index()
        record = index.find(track_id, tracked=True) if folders.is_id(track_id) else None
        if record is None:
            raise errors.NotFoundError(
                f"There is no track {str(track_id)[:12]!r}.",
                remedy="Use the id returned when it was made, or make it.",
            )
        return record

    def track_path(self, track_id: str) -> Path:
        """HDF5 file of a track.

        Raises
        ------
        NotFoundError
            If there is none.
        LostFileError
            If it is gone.
        """
        return self._present(partial(self._track_file, track_id), track_id)

    def track(self, track_id: str) -> Track:
        """Track with the facts of its sequence.

        Raises
        ------
        NotFoundError
            If there is none.
        CorruptFileError
            If its file is damaged; LostFileError if it is gone.
        """
        track = self._read(
            track_from_hdf5, partial(self._track_file, track_id), sequence_id=track_id
        )
        facts = self.track_record(track_id).facts
        return replace(track, sequence=track.sequence.with_facts(facts))

    def _track_file(self, track_id: str) -> Path:
        self.track_record(track_id)
        return self._folder.path("results", folders.track_name(track_id))


def track_image(track: Track) -> bytes:
    """Write a track as it is kept: without facts, which the record of its sequence has."""
    return track_to_hdf5(replace(track, sequence=track.sequence.with_facts(mesh.NO_FACTS)))


class ResultStore(TemplateStore, ImageStore, TrackStore, ModelStore, NormStore):
    """Immutable results in files, found through an index; nothing acknowledged is lost.

    Safe for any number of threads of one process, which holds the folder's lock from `open`
    to `close`. Making one touches no file.

    Parameters
    ----------
    root : Path
        The folder; made where it is missing.
    keep_uploads : bool
        Whether the vertices of new sequences are kept, or only their records.
    """

    def put_signature(self, signature: ModalSignature) -> Path:
        """Keep a signature; a stored one is not written again.

        Returns
        -------
        Path
            Of its HDF5 file.

        Raises
        ------
        NotFoundError
            If its sequence is not known.
        StoreError
            If it cannot be written; the store is as it was.
        """
        name = folders.ResultName("signature", signature.sequence_id, "", signature.parameters.key)
        return self._put_result(name, signature_image(signature))

    def put_signature_image(self, image: Path, sequence_id: str, key: str) -> Path:
        """Keep a signature that another process has written with `signature_image`.

        Parameters
        ----------
        image : Path
            Sealed HDF5 file; it is copied.
        sequence_id, key : str
            Of the sequence and of the parameters.

        Raises
        ------
        NotFoundError, StoreError
            As `put_signature` does.
        CorruptFileError
            If the image has no sound seal.
        """
        name = folders.ResultName("signature", sequence_id, "", key)
        return self._put_result(name, load_sealed(image)[1])

    def signature(self, sequence_id: str, key: str) -> ModalSignature:
        """Signature of a sequence with the parameters of that key, and the sequence's facts.

        Raises
        ------
        NotFoundError
            If there is none.
        CorruptFileError
            If its file is damaged; LostFileError if it is gone.
        """
        locate = partial(self.signature_path, sequence_id, key)
        signature = self._read(
            signature_from_hdf5, locate, sequence_id=sequence_id, parameters_key=key
        )
        return replace(signature, facts=self.sequence_record(sequence_id).facts)

    def signature_path(self, sequence_id: str, key: str) -> Path:
        """HDF5 file of a signature.

        Raises
        ------
        NotFoundError
            If there is none.
        """
        return self._result_path(folders.ResultName("signature", sequence_id, "", key))

    def sound_signature_path(self, sequence_id: str, key: str) -> Path | None:
        """HDF5 file of a signature, if there is one and it is as it was written.

        Raises
        ------
        NotFoundError
            If there is no such sequence.
        """
        self.sequence_record(sequence_id)
        try:
            path = self.signature_path(sequence_id, key)
        except errors.NotFoundError:
            return None
        return path if is_sound(path) else None

    def rendered_signature(self, sequence_id: str, key: str) -> bytes | None:
        """Text that `keep_rendered` has kept of a signature; None if there is none, or it is stale.

        Raises
        ------
        NotFoundError
            If there is no such signature.
        """
        path, digest = self._rendered(sequence_id, key)
        try:
            head, _, text = path.read_bytes().partition(b"\n")
        except OSError:
            return None
        return text if head.decode("ascii", "replace") == f"{digest} {_sha256(text)}" else None

    def keep_rendered(self, sequence_id: str, key: str, text: bytes) -> None:
        """Keep a text that was made of a signature beside it, as long as its file is the same.

        Raises
        ------
        NotFoundError
            If there is no such signature.
        StoreError
            If it cannot be written.
        """
        with self._changing(sequence_id):
            path, digest = self._rendered(sequence_id, key)
            disk.write_atomic(path, f"{digest} {_sha256(text)}\n".encode() + text)

    def delete_signature(self, sequence_id: str, key: str) -> None:
        """Delete a signature; classes that were named of it stay.

        Raises
        ------
        NotFoundError
            If there is none.
        StoreError
            If it cannot be deleted, or not wholly: the next call, or the next `open` after a
            crash, finishes it.
        """
        name = folders.ResultName("signature", sequence_id, "", key)
        with self._changing(sequence_id):
            path = self._result_path(name)
            deletion.bury(self.root, path.stem)
            disk.remove_durably(path, path.with_suffix(folders.RENDERED))
            self._open_index().remove_result(name)

    def _rendered(self, sequence_id: str, key: str) -> tuple[Path, str]:
        """File of a signature's text, and the digest of the signature's file."""
        path = self.signature_path(sequence_id, key)
        digest = self._open_index().digest(folders.ResultName("signature", sequence_id, "", key))
        return path.with_suffix(folders.RENDERED), digest or ""

    def signatures(self, sequence_id: str) -> tuple[str, ...]:
        """Keys of the parameters of a sequence's signatures.

        Raises
        ------
        NotFoundError
            If there is no such sequence.
        """
        return tuple(name.key for name in self._results(sequence_id, "signature"))

    def all_signatures(self) -> list[tuple[str, str]]:
        """Sequence id and key of every signature, in that order."""
        names = self._open_index().results()
        return [(one.sequence_id, one.key) for one in names if one.kind == "signature"]

    def put_classification_image(
        self, image: bytes, sequence_id: str, model_id: str, key: str
    ) -> Path:
        """Keep a classification as `classification_to_hdf5` writes it; a stored one stays.

        Parameters
        ----------
        image : bytes
        sequence_id, model_id : str
        key : str
            Of the parameters of the signature that was classified.

        Raises
        ------
        NotFoundError
            If its sequence is not known.
        StoreError
            If it cannot be written; the store is as it was.
        """
        return self._put_result(
            folders.ResultName("classification", sequence_id, model_id, key), image
        )

    def classification(self, sequence_id: str, model_id: str, key: str) -> Classification:
        """Classification of a sequence by a model, from the signature with that key.

        Raises
        ------
        NotFoundError
            If there is none.
        CorruptFileError
            If its file is damaged; LostFileError if it is gone.
        """
        return self._read(
            classification_from_hdf5,
            partial(self.classification_path, sequence_id, model_id, key),
            sequence_id=sequence_id,
            model_id=model_id,
            parameters_key=key,
        )

    def classification_path(self, sequence_id: str, model_id: str, key: str) -> Path:
        """HDF5 file of a classification.

        Raises
        ------
        NotFoundError
            If there is none.
        """
        return self._result_path(folders.ResultName("classification", sequence_id, model_id, key))

    def classifications(self, sequence_id: str) -> tuple[tuple[str, str], ...]:
        """Model ids and keys of a sequence's classifications.

        Raises
        ------
        NotFoundError
            If there is no such sequence.
        """
        names = self._results(sequence_id, "classification")
        return tuple((name.model_id, name.key) for name in names)

    def _put_result(self, name: folders.ResultName, data: bytes) -> Path:
        self.sequence_record(name.sequence_id)
        if not _is_name(name):
            raise errors.StoreError(
                f"A {name.kind} with the key {str(name.key)[:16]!r} and the model id "
                f"{str(name.model_id)[:12]!r} cannot be stored: these are not digests.",
                remedy="Use the key of the signature's parameters and the model's sha256.",
            )
        index, path = self._open_index(), self._folder.path("results", name)
        with self._changing(name.sequence_id):
            self.sequence_record(name.sequence_id)
            if index.digest(name) is None or not is_sound(path):
                self._write([(path, data)], lambda: index.change((), {name: digest_of(data)}))
        return path

    def _result_path(self, name: folders.ResultName) -> Path:
        if not _is_name(name) or self._open_index().digest(name) is None:
            record = self.sequence_record(name.sequence_id)
            raise errors.NotFoundError(
                f"Sequence {record.id[:12]} has no {name.kind} of that name.",
                remedy=f"Ask for one that is listed, or make the {name.kind} first.",
            )
        return self._folder.path("results", name)

    def _results(self, sequence_id: str, kind: folders.ResultKind) -> list[folders.ResultName]:
        self.sequence_record(sequence_id)
        return self._open_index().results_of(sequence_id, kind)


def signature_image(signature: ModalSignature) -> bytes:
    """Write a signature as it is kept: without facts, which the record of its sequence has."""
    return signature_to_hdf5(replace(signature, facts=mesh.NO_FACTS))


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _is_name(name: folders.ResultName) -> bool:
    return folders.is_key(name.key) and (
        name.kind != "classification" or folders.is_id(name.model_id)
    )
