"""Surfaces tracked through clouds, contours, meshes and images; tracks described and drawn."""

from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from modalmotion import errors, mesh, notes, store
from modalmotion.images import ImageSequence, hdf5
from modalmotion.progress import Stopwatch
from modalmotion.tracking import Track, label_maps, label_values, reading, recordings
from modalmotion.tracking.parameters import TrackParameters
from modalmotion.viewer import container, page
from modalmotion_service.http.negotiation import HDF5, PNG, VIEW
from modalmotion_service.schemas import queries, sequences
from modalmotion_service.work.tasks.files import ProgressFile, png_of, whole_file, write_whole
from modalmotion_service.work.upload import Upload

# Parts of the whole; the rest is for the server.
_SHARES: Final = {"read": 0.1, "track": 0.8, "image": 0.05}


def follow(
    source: Upload | Path,
    parameters: TrackParameters,
    facts: mesh.Facts,
    start: Path | None,
    sequence: Path,
    track: Path,
    progress: Path,
) -> tuple[store.SequenceRecord, sequences.TrackEstimate]:
    """Track a surface through an upload or kept images, and write its sequence's and its own image.

    `progress` is a `ProgressFile`.

    Returns
    -------
    record : SequenceRecord
        Of the sequence; whose it is and when it came is for the server to say.
    estimate : TrackEstimate
    """
    watch = Stopwatch(_SHARES, ProgressFile(progress).write)
    with watch.stage("read") as report:
        if isinstance(source, Path):
            recorded = reading.recorded_images(hdf5.read_images_file(source))
        else:
            recorded = source.observed(parameters.labels, facts.coordinates, report)
        surface = None if start is None else store.sequence_from_hdf5(start)
    with watch.stage("track") as report:
        result = recordings.track(
            recorded, start=surface, facts=facts, progress=report, **vars(parameters)
        )
    with watch.stage("image"):
        record = store.record_of(result.sequence, created="", has_upload=True)
        write_whole(sequence, store.upload_image(result.sequence))
        write_whole(track, store.track_image(result))
        estimate = sequences.TrackEstimate.of(result)
    return record, estimate


def show_track(
    path: Path,
    record: store.SequenceRecord,
    images_id: str | None,
    images: Path | None,
    query: queries.TrackView,
    media_type: str,
) -> bytes:
    """Describe or draw a kept track, or give its file or its data.

    Parameters
    ----------
    path : Path
    record : SequenceRecord
        Of its sequence, whose facts the file lacks.
    images_id : str or None
        Of images that were kept for it.
    images : Path or None
        Their file, where contours are drawn over them.
    query : TrackView
    media_type : str
    """
    track = store.track_from_hdf5(path)
    if media_type == HDF5:
        return store.track_to_hdf5(replace(track, sequence=track.sequence.with_facts(record.facts)))
    if media_type == VIEW:
        if track.data is None:
            raise errors.NotFoundError(
                "The track keeps none of the data that it was tracked through.",
                remedy="Track the recording again: some of its points are kept since.",
            )
        return page.data_payload(track.data)
    if media_type == PNG:
        return _drawn(track, query, images)
    answer = sequences.TrackAnswer.joined(sequences.TrackEstimate.of(track), record, images_id)
    return answer.model_dump_json().encode()


def _drawn(track: Track, query: queries.TrackView, images: Path | None) -> bytes:
    from modalmotion.pictures import track as figures

    if images is not None:
        return png_of(figures.overlay_figure(track, hdf5.read_images_file(images)))
    if query.picture == "data":
        return png_of(figures.data_figure(track))
    if query.picture == "determined":
        return png_of(figures.determined_figure(track))
    frame = figures.usual_frame(track) if query.frame is None else query.frame
    if frame >= track.n_frames:
        raise errors.ParameterError(
            f"The picture is to show frame {frame}, but there are {track.n_frames} (0 to "
            f"{track.n_frames - 1}).",
            remedy="Name a frame, counted from 0.",
            frame=frame,
        )
    return png_of(figures.deviations_figure(track, frame))


# Parts of the whole; the rest is for the server.
_IMAGE_SHARES: Final = {"read": 0.6, "image": 0.3}


def ingest_images(upload: Upload, file: Path, progress: Path) -> store.ImagesRecord:
    """Read images and write them as HDF5; `progress` is a `ProgressFile`."""
    watch = Stopwatch(_IMAGE_SHARES, ProgressFile(progress).write)
    with watch.stage("read") as report:
        images = upload.images(report)
    with watch.stage("image"), whole_file(file) as temporary:
        hdf5.write_images(temporary, images)
    return _with_ends(store.images_record_of(images), images)


def _with_ends(record: store.ImagesRecord, images: ImageSequence) -> store.ImagesRecord:
    """Add apex and base that a segmentation proposes, or why it proposes none."""
    if not label_values.is_label_map(images):
        return record
    try:
        made = label_maps.from_labels(images)
    except errors.InputError as error:
        return replace(
            record,
            is_label_map=True,
            notes=(
                *record.notes,
                notes.Note.of("not_computed", reason=error.message, error=error.code),
            ),
        )
    ends: dict[str, Any] = {
        name: tuple(
            tuple(map(float, place)) if np.isfinite(place).all() else None
            for place in np.atleast_2d(one.places)
        )
        for name, one in made.landmarks.items()
    }
    return replace(record, is_label_map=True, notes=made.images.notes, **ends)


def show_slices(path: Path, frame: int, track: Path | None) -> bytes:
    """Give the slices of a frame of kept images, as the page reads them, and a track's surface."""
    made = None if track is None else store.track_from_hdf5(track)
    return container.slices_payload(hdf5.read_images_file(path), frame, made)
