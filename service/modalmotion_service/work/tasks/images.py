"""Images read and written as files of ours, which say nothing of a person."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from modalmotion.errors import InputError
from modalmotion.images import ImageSequence
from modalmotion.images.hdf5 import read_images_file, write_images
from modalmotion.progress import Stopwatch
from modalmotion.store import ImagesRecord, images_record_of, track_from_hdf5
from modalmotion.tracking.label_maps import from_labels
from modalmotion.tracking.label_values import is_label_map
from modalmotion.viewer.slices import slices_payload
from modalmotion_service.work.task_progress import ProgressFile
from modalmotion_service.work.tasks.files import whole_file
from modalmotion_service.work.upload import Upload

# Parts of the whole; the rest is for the server.
_SHARES: Final = {"read": 0.6, "image": 0.3}


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
    watch = Stopwatch(_SHARES, ProgressFile(progress).write)
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
