"""Uploads read and written as sequences."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from modalmotion.formats import ReadOptions
from modalmotion.stopwatch import Stopwatch
from modalmotion.store import SequenceRecord, record_of, sequence_to_hdf5
from modalmotion_service.schemas import ReadingAnswer
from modalmotion_service.work.tasks.files import read_upload, write_whole


@dataclass(frozen=True)
class Ingested:
    """An upload that was understood.

    Parameters
    ----------
    record : SequenceRecord
        Of the sequence; whose it is and when it came is for the server to say.
    reading : ReadingAnswer
        What the file held besides.
    milliseconds : dict
        By stage.
    """

    record: SequenceRecord
    reading: ReadingAnswer
    milliseconds: dict[str, float]


def ingest(upload: Path, options: ReadOptions, image: Path) -> Ingested:
    """Read an upload, check it, and write it as a sequence's HDF5 image."""
    watch = Stopwatch()
    with watch.stage("read"):
        read = read_upload(upload, options)
    with watch.stage("image"):
        record = record_of(read.sequence, created="", has_upload=True)
        write_whole(image, sequence_to_hdf5(read.sequence))
    return Ingested(record, ReadingAnswer.of(read), watch.milliseconds)
