"""Images read and written as files of ours, which say nothing of a person."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from modalmotion.images.hdf5 import read_images_file, write_images
from modalmotion.stopwatch import Stopwatch
from modalmotion.store import ImagesRecord, images_record_of, track_from_hdf5
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
    return images_record_of(images), watch.milliseconds


def show_slices(path: Path, frame: int, track: Path | None) -> bytes:
    """Give the slices of a frame of kept images, as the page reads them, and a track's surface."""
    made = None if track is None else track_from_hdf5(track)
    return slices_payload(read_images_file(path), frame, made)
