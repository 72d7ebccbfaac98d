"""Images in a store, with records beside the samples: until they are tracked, or longer."""

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from modalmotion.errors import NotFoundError, StoreError
from modalmotion.images import ImageSequence, Plane, PlaneSet, volume
from modalmotion.notes import Note, notes_from_json
from modalmotion.representation import shown
from modalmotion.store import deletion, disk, sequences
from modalmotion.store.folders import IMAGES_FORM, SequenceRecord, is_id
from modalmotion.store.index import from_cursor, now, require_limit, to_cursor


@shown("kind", "n_frames", "shapes", "spacings", "is_kept", "id")
@dataclass(frozen=True)
class ImagesRecord:
    """All that the store knows of images without reading their samples.

    Parameters
    ----------
    id : str
        sha256 of the content, in hex.
    kind : "volumes" or "planes"
    n_frames : int
    missing : tuple of int
        Frames without an image.
    shapes : tuple of tuple of int
        Samples along each axis: of the volume, or of each plane of a frame.
    spacings : tuple of tuple of float, mm
        Between samples along each axis.
    thicknesses : tuple of float, mm
        Of planes; none of volumes.
    times : tuple of float or None, s
    period : float or None, s
    n_bytes : int
        Of the samples.
    notes : tuple of Note
        Of the reader.
    created : str
        When they were put, UTC, ISO 8601 with microseconds.
    is_kept : bool
        Whether they were kept on purpose after tracking.
    tracks : tuple of str
        Ids of the tracks that they are kept for.
    is_label_map : bool
        Whether they are a segmentation.
    apex, base : tuple of ((x, y, z) or None), mm
        Of label maps: what they propose in each frame; empty if they propose none.
    """

    id: str
    kind: str
    n_frames: int
    missing: tuple[int, ...]
    shapes: tuple[tuple[int, ...], ...]
    spacings: tuple[tuple[float, ...], ...]
    thicknesses: tuple[float, ...]
    times: tuple[float, ...] | None
    period: float | None
    n_bytes: int
    notes: tuple[Note, ...]
    created: str = ""
    is_kept: bool = False
    tracks: tuple[str, ...] = ()
    is_label_map: bool = False
    apex: tuple[tuple[float, float, float] | None, ...] = ()
    base: tuple[tuple[float, float, float] | None, ...] = ()


def images_record_of(images: ImageSequence) -> ImagesRecord:
    """Record of images that nobody has put yet."""
    seen = [frame for frame in images.frames if frame is not None]
    parts = volume.parts_of(seen[0])
    return ImagesRecord(
        id=images.id,
        kind="planes" if isinstance(seen[0], PlaneSet) else "volumes",
        n_frames=images.n_frames,
        missing=tuple(k for k, frame in enumerate(images.frames) if frame is None),
        shapes=tuple(tuple(map(int, part.values.shape)) for part in parts),
        spacings=tuple(tuple(part.spacing) for part in parts),
        thicknesses=tuple(part.thickness for part in parts if isinstance(part, Plane)),
        times=None if images.times is None else tuple(images.times.tolist()),
        period=images.period,
        n_bytes=sum(part.values.nbytes for frame in seen for part in volume.parts_of(frame)),
        notes=images.notes,
    )


def read_images_record(path: Path) -> ImagesRecord:
    """Read a record.

    Raises
    ------
    NotFoundError
        If there is no such file.
    CorruptFileError
        If it is damaged.
    """
    values = IMAGES_FORM.read(path)
    try:
        plain = {name: _tupled(value) for name, value in values.items()}
        return ImagesRecord(**{**plain, "notes": notes_from_json(values["notes"])})
    except (TypeError, KeyError) as error:
        raise IMAGES_FORM.damaged(path, str(error)) from error


def _tupled(value: Any) -> Any:
    return tuple(map(_tupled, value)) if isinstance(value, list) else value


class ImageStore(sequences.SequenceStore):
    """A store of sequences that contains images too.

    They are few and soon gone, so they need no row in the index: a record beside the samples says
    what they are.
    """

    def put_images(self, file: Path, record: ImagesRecord) -> tuple[ImagesRecord, bool]:
        """Take a file of images that another process has written with `write_images`.

        Parameters
        ----------
        file : Path
            On the store's own disk, and durable: it is moved.
        record : ImagesRecord
            Of the images in it; when they came is set here.

        Returns
        -------
        record : ImagesRecord
            The stored one.
        is_new : bool
            False if they were there already.

        Raises
        ------
        StoreError
            If they cannot be stored; the store is as it was.
        """
        if not is_id(record.id):
            raise StoreError(
                f"Images cannot be kept as {record.id[:12]!r}: it is not a digest.",
                remedy="Use the images' own id.",
            )
        with self._changing(record.id):
            path = self._folder.path("images", record.id)
            with contextlib.suppress(StoreError):
                known = read_images_record(self._folder.path("image_records", record.id))
                if path.is_file():
                    return known, False
            record = replace(record, created=now())
            # Written before a deletion, perhaps, and put after it.
            file.touch()
            # The samples first: what has a record is there.
            self._make_shards(path.parent)
            disk.rename(file, path)
            try:
                self._write_record(record)
            except BaseException:
                disk.rename(path, file)
                raise
            return record, True

    def images_record(self, images_id: str) -> ImagesRecord:
        """Look up the record of images.

        Raises
        ------
        NotFoundError
            If there are none of that id.
        CorruptFileError
            If it is damaged.
        """
        self._open_index()
        with contextlib.suppress(NotFoundError):
            if is_id(images_id):
                return read_images_record(self._folder.path("image_records", images_id))
        raise NotFoundError(
            f"There are no images {str(images_id)[:12]!r}: images are deleted after tracking "
            "unless they are kept.",
            remedy="Use the id returned when they were sent, or send them again.",
        )

    def images_path(self, images_id: str) -> Path:
        """HDF5 file of images.

        Raises
        ------
        NotFoundError
            If there are none of that id.
        LostFileError
            If they are gone.
        """
        return self._present(
            lambda: self._folder.path("images", self.images_record(images_id).id),
            images_id,
            f"The file of images {images_id[:12]}",
            "Send the images again",
        )

    def list_images(
        self, *, limit: int = 100, cursor: str | None = None
    ) -> tuple[tuple[ImagesRecord, ...], str | None]:
        """List images from the newest to the oldest; gives a page, and the cursor of the next.

        Parameters
        ----------
        limit : int
            Of one page, 1 to 1000.
        cursor : str, optional
            Of the page before.

        Raises
        ------
        ParameterError
            If the limit is out of range or the cursor is not one of a list.
        """
        require_limit(limit)
        end = from_cursor(cursor)
        older = [one for one in self._records() if (one.created, one.id) < end]
        older.sort(key=lambda one: (one.created, one.id), reverse=True)
        page = older[:limit]
        more = to_cursor(page[-1].created, page[-1].id) if len(older) > limit else None
        return tuple(page), more

    def untracked_images(self, before: str) -> tuple[str, ...]:
        """List images that came before a time (UTC, ISO 8601), and that nobody keeps."""
        return tuple(one.id for one in self._records() if not one.is_kept and one.created < before)

    def images_id_of_track(self, track_id: str) -> str | None:
        """Id of the images that a track was made of; None if they were not kept."""
        return next((one.id for one in self._records() if track_id in one.tracks), None)

    def images_of_track(self, track_id: str) -> Path:
        """HDF5 file of the images that a track was made of.

        Raises
        ------
        NotFoundError
            If they were not kept.
        """
        images_id = self.images_id_of_track(track_id)
        if images_id is not None:
            return self.images_path(images_id)
        raise NotFoundError(
            f"The images of track {track_id[:12]} were not kept.",
            remedy="Send them again to POST /v1/images, and track them with keep=true.",
        )

    def keep_images(self, images_id: str, track_id: str) -> ImagesRecord:
        """Note that images are kept on purpose, for a track.

        Raises
        ------
        NotFoundError
            If there are none of that id.
        StoreError
            If it cannot be noted.
        """
        with self._changing(images_id):
            record = self.images_record(images_id)
            tracks = tuple(dict.fromkeys((*record.tracks, track_id)))
            record = replace(record, is_kept=True, tracks=tracks)
            self._write_record(record)
            return record

    def delete_images(self, images_id: str) -> None:
        """Delete images; what was tracked in them stays.

        Raises
        ------
        NotFoundError
            If there are none of that id.
        StoreError
            If a file cannot be removed.
        """
        self._open_index()
        with self._changing(images_id):
            # A damaged record is no reason to keep what it represents.
            if not is_id(images_id) or not self._folder.path("image_records", images_id).is_file():
                self.images_record(images_id)
            files = (
                self._folder.path("image_records", images_id),
                self._folder.path("images", images_id),
            )
            deletion.bury_and_remove(self.root, images_id, *files)

    def replace_sequence(
        self,
        sequence_id: str,
        image: Path,
        record: SequenceRecord,
        change: Callable[[SequenceRecord], SequenceRecord],
        track: Path | None = None,
    ) -> SequenceRecord:
        """Replace a sequence as `SequenceStore` does; images that are kept for it stay."""
        # Before: where it is cut short then, images are kept that could have gone.
        for one in [images for images in self._records() if sequence_id in images.tracks]:
            self.keep_images(one.id, record.id)
        made = super().replace_sequence(sequence_id, image, record, change, track)
        self._forget_track(sequence_id)
        return made

    def delete_sequence(self, sequence_id: str) -> None:
        """Delete a sequence as `SequenceStore` does; images that are kept for it forget its id."""
        super().delete_sequence(sequence_id)
        self._forget_track(sequence_id)

    def _forget_track(self, sequence_id: str) -> None:
        for one in [record for record in self._records() if sequence_id in record.tracks]:
            with self._changing(one.id), contextlib.suppress(NotFoundError):
                record = self.images_record(one.id)
                tracks = tuple(name for name in record.tracks if name != sequence_id)
                self._write_record(replace(record, tracks=tracks))

    def _records(self) -> Iterator[ImagesRecord]:
        self._open_index()
        for images_id in self._folder.names("image_records"):
            # One that is damaged costs the others nothing, nor one that is deleted meanwhile.
            with contextlib.suppress(StoreError):
                yield read_images_record(self._folder.path("image_records", images_id))

    def _write_record(self, record: ImagesRecord) -> None:
        path = self._folder.path("image_records", record.id)
        self._write([(path, IMAGES_FORM.write(asdict(record)))], lambda: None)
