"""Uploads read and written as sequences."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from modalmotion.stopwatch import Stopwatch
from modalmotion.store import SequenceRecord, record_of, upload_image
from modalmotion_service.schemas.sequences import ReadingAnswer
from modalmotion_service.work.task_progress import ProgressFile
from modalmotion_service.work.tasks.files import write_whole
from modalmotion_service.work.upload import Upload

# Parts of the whole; the rest is for the server.
_SHARES: Final = {"read": 0.7, "image": 0.2}


def ingest(
    upload: Upload, image: Path, progress: Path
) -> tuple[SequenceRecord, ReadingAnswer, dict[str, float]]:
    """Read an upload, check it, and write it as a sequence's HDF5 image.

    `progress` is a `ProgressFile`.

    Returns
    -------
    record : SequenceRecord
        Of the sequence; whose it is and when it came is for the server to say.
    reading : ReadingAnswer
        What the file held besides.
    milliseconds : dict
        By stage.
    """
    watch = Stopwatch(_SHARES, ProgressFile(progress).write)
    with watch.stage("read") as report:
        reading = upload.read(lambda done, total: report(done / max(total, 1)))
    with watch.stage("image"):
        record = record_of(reading.sequence, created="", has_upload=True)
        write_whole(image, upload_image(reading.sequence))
    return record, ReadingAnswer.of(reading), watch.milliseconds
