"""Tracks in a store: each belongs to the sequence that it has made, and is named by its id."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

from modalmotion.errors import NotFoundError
from modalmotion.hdf5.sealed import load_sealed
from modalmotion.mesh import NO_FACTS
from modalmotion.store.folder import is_id, track_name
from modalmotion.store.index.index import SequencePage
from modalmotion.store.record import SequenceRecord, record_of
from modalmotion.store.sequences import SequenceStore, upload_image
from modalmotion.tracking.hdf5 import read_track, track_to_hdf5
from modalmotion.tracking.result import Track


class TrackStore(SequenceStore):
    """A store of sequences that keeps how some of them were tracked.

    Whoever deletes the sequence deletes the track, and the other way round: `delete_sequence`.
    """

    def put_track(
        self, track: Track, *, subject: str | None = None, label: str | None = None
    ) -> bool:
        """Keep a track and its sequence; of one sequence the first track stays.

        Parameters
        ----------
        track : Track
            With the facts of its sequence.
        subject, label : str, optional
            As for `put_sequence`.

        Returns
        -------
        bool
            True if the track was not known before.

        Raises
        ------
        ParameterError
            If subject or label cannot be kept.
        StoreError
            If it cannot be written; the store is as it was.
        """
        record = record_of(
            track.sequence, created="", has_upload=True, subject=subject, label=label
        )
        images = {track_name(record.id): lambda: track_image(track)}
        return self._put(record, lambda: upload_image(track.sequence), images)[1]

    def put_track_images(
        self,
        sequence: Path,
        track: Path,
        record: SequenceRecord,
        *,
        subject: str | None = None,
        label: str | None = None,
    ) -> tuple[SequenceRecord, bool]:
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
            As `put_track` returns.

        Raises
        ------
        ParameterError, StoreError
            As `put_track` does.
        CorruptFileError
            If an image has no sound seal.
        """
        named = replace(record, subject=subject, label=label)
        images = {track_name(record.id): lambda: load_sealed(track)[1]}
        return self._put(named, lambda: load_sealed(sequence)[1], images)

    def track_record(self, track_id: str) -> SequenceRecord:
        """Look up the record of a tracked sequence.

        Raises
        ------
        NotFoundError
            If there is no such track.
        """
        index = self._open_index()
        record = index.find(track_id, tracked=True) if is_id(track_id) else None
        if record is None:
            raise NotFoundError(
                f"There is no track {str(track_id)[:12]!r}.",
                remedy="Use the id returned when it was made, or make it.",
            )
        return record

    def is_tracked(self, sequence_id: str) -> bool:
        """Whether a sequence that is kept was tracked."""
        return self._open_index().digest(track_name(sequence_id)) is not None

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
        track = self._read(read_track, partial(self._track_file, track_id), sequence_id=track_id)
        facts = self.track_record(track_id).facts
        return replace(track, sequence=track.sequence.with_facts(facts))

    def list_tracks(
        self,
        *,
        subject: str | None = None,
        label: str | None = None,
        limit: int = 100,
        cursor: str | None = None,
    ) -> SequencePage:
        """Tracked sequences from the newest to the oldest, as `list_sequences` lists all."""
        return self._open_index().page(subject, label, limit, cursor, tracked=True)

    def _track_file(self, track_id: str) -> Path:
        self.track_record(track_id)
        return self._folder.result(track_name(track_id))


def track_image(track: Track) -> bytes:
    """Write a track as it is kept: without facts, which the record of its sequence has."""
    return track_to_hdf5(replace(track, sequence=track.sequence.with_facts(NO_FACTS)))
