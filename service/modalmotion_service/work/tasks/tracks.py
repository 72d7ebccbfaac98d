"""Surfaces tracked through clouds, contours, meshes and images; tracks described and drawn."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from modalmotion.errors import InputError, NotFoundError, ParameterError
from modalmotion.images import ImageSequence
from modalmotion.images.hdf5 import read_images_file, write_images
from modalmotion.mesh.facts import Facts
from modalmotion.progress import Stopwatch
from modalmotion.store import (
    ImagesRecord,
    SequenceRecord,
    images_record_of,
    record_of,
    sequence_from_hdf5,
    track_from_hdf5,
    track_image,
    track_to_hdf5,
    upload_image,
)
from modalmotion.tracking import Track
from modalmotion.tracking.label_maps import from_labels
from modalmotion.tracking.label_values import is_label_map
from modalmotion.tracking.parameters import TrackParameters
from modalmotion.tracking.reading import recorded_images
from modalmotion.viewer.container import slices_payload
from modalmotion.viewer.page import data_payload
from modalmotion_service.schemas.sequences import TrackEstimate
from modalmotion_service.work.task_progress import ProgressFile
from modalmotion_service.work.tasks.files import png_of, whole_file, write_whole
from modalmotion_service.work.upload import Upload

# Parts of the whole; the rest is for the server.
_SHARES: Final = {"read": 0.1, "track": 0.8, "image": 0.05}


def follow(
    source: Upload | Path,
    parameters: TrackParameters,
    start: Path | None,
    sequence: Path,
    track: Path,
    progress: Path,
) -> tuple[SequenceRecord, TrackEstimate, dict[str, float]]:
    """Track a surface through an upload or kept images, and write its sequence's and its own image.

    `progress` is a `ProgressFile`.

    Returns
    -------
    record : SequenceRecord
        Of the sequence; whose it is and when it came is for the server to say.
    estimate : TrackEstimate
    milliseconds : dict
        By stage.
    """
    watch = Stopwatch(_SHARES, ProgressFile(progress).write)
    with watch.stage("read") as report:
        if isinstance(source, Path):
            recorded = recorded_images(read_images_file(source))
        else:
            recorded = source.observed(
                parameters.contours,
                parameters.coordinates,
                lambda done, total: report(done / max(total, 1)),
            )
        surface = None if start is None else sequence_from_hdf5(start)
    with watch.stage("track") as report:
        result = parameters.follow(
            recorded, start=surface, progress=lambda done, total: report(done / max(total, 1))
        )
    with watch.stage("image"):
        record = record_of(result.sequence, created="", has_upload=True)
        write_whole(sequence, upload_image(result.sequence))
        write_whole(track, track_image(result))
        estimate = TrackEstimate.of(result)
    return record, estimate, watch.milliseconds


def describe_track(path: Path) -> TrackEstimate:
    """Say what a kept track holds."""
    return TrackEstimate.of(track_from_hdf5(path))


def track_with_facts(path: Path, facts: Facts) -> bytes:
    """Write a kept track and the facts of its sequence out as HDF5."""
    track = track_from_hdf5(path)
    return track_to_hdf5(replace(track, sequence=track.sequence.with_facts(facts)))


def show_data(path: Path) -> bytes:
    """Give some of the data that a kept track was made of, as the page reads them."""
    data = track_from_hdf5(path).data
    if data is None:
        raise NotFoundError(
            "The track keeps none of the data that it was tracked through.",
            remedy="Track the recording again: some of its points are kept since.",
        )
    return data_payload(data)


def draw_overlay(path: Path, images: Path) -> bytes:
    """Draw the contours of a kept track over its images, as PNG."""
    from modalmotion.pictures.track import overlay_figure

    return png_of(overlay_figure(track_from_hdf5(path), read_images_file(images)))


def draw_track(
    path: Path, picture: Literal["deviations", "data", "determined"], frame: int | None
) -> bytes:
    """Draw the stated error of a kept track, its data, or what these have set, as PNG."""
    from modalmotion.pictures.track import data_figure, determined_figure, deviations_figure

    track = track_from_hdf5(path)
    if picture == "data":
        return png_of(data_figure(track))
    if picture == "determined":
        return png_of(determined_figure(track))
    return png_of(deviations_figure(track, _frame_of(track, frame)))


def _frame_of(track: Track, frame: int | None) -> int:
    """Frame that is asked for, or the usual one."""
    from modalmotion.pictures.track import usual_frame

    if frame is None:
        return usual_frame(track)
    if frame >= track.n_frames:
        raise ParameterError(
            f"The picture is to show frame {frame}, but there are {track.n_frames} (0 to "
            f"{track.n_frames - 1}).",
            remedy="Name a frame, counted from 0.",
            frame=frame,
        )
    return frame


# Parts of the whole; the rest is for the server.
_IMAGE_SHARES: Final = {"read": 0.6, "image": 0.3}


def ingest_images(
    upload: Upload, file: Path, progress: Path
) -> tuple[ImagesRecord, dict[str, float]]:
    """Read images and write them as HDF5.

    `progress` is a `ProgressFile`.

    Returns
    -------
    record : ImagesRecord
    milliseconds : dict
        By stage.
    """
    watch = Stopwatch(_IMAGE_SHARES, ProgressFile(progress).write)
    with watch.stage("read") as report:
        images = upload.images(lambda done, total: report(done / max(total, 1)))
    with watch.stage("image"), whole_file(file) as temporary:
        write_images(temporary, images)
    return _with_ends(images_record_of(images), images), watch.milliseconds


def _with_ends(record: ImagesRecord, images: ImageSequence) -> ImagesRecord:
    """Add apex and base that a segmentation proposes, or why it proposes none."""
    if not is_label_map(images):
        return record
    try:
        made = from_labels(images)
    except InputError as error:
        return replace(record, is_label_map=True, notes=(*record.notes, error.message))
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
    made = None if track is None else track_from_hdf5(track)
    return slices_payload(read_images_file(path), frame, made)
