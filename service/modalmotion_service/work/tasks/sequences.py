"""Uploads read and written as sequences."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from modalmotion.mesh import Facts
from modalmotion.progress import Stopwatch
from modalmotion.simulate import Acquisition, simulate_ventricle
from modalmotion.store import (
    SequenceRecord,
    record_of,
    sequence_from_hdf5,
    track_from_hdf5,
    track_image,
    upload_image,
)
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


def sample(image: Path) -> SequenceRecord:
    """Simulate a healthy left ventricle and write it as a sequence's HDF5 image."""
    beat = simulate_ventricle(
        grid=(24, 48), acquisition=Acquisition(noise=0.3), rng=np.random.default_rng(1994)
    )
    write_whole(image, upload_image(beat))
    return record_of(beat, created="", has_upload=True)


def restated(
    path: Path,
    track: Path | None,
    stated: Mapping[str, Any],
    facts: Facts,
    sequence_image: Path,
    track_file: Path,
) -> SequenceRecord:
    """Write a kept sequence with another unit or other times, and its track where there is one.

    Parameters
    ----------
    path : Path
        Of the sequence.
    track : Path or None
    stated : mapping
        Of "unit" and "times" those that change; None makes one unknown.
    facts : Facts
        Of the sequence as it will be: they have to go with the times.
    sequence_image, track_file : Path
        Where to write.
    """
    made = None if track is None else track_from_hdf5(track)
    sequence = sequence_from_hdf5(path) if made is None else made.sequence
    if "unit" in stated:
        unit = stated["unit"]
        sequence = replace(sequence, unit=None) if unit is None else sequence.with_unit(unit)
    if "times" in stated:
        sequence = sequence.with_times(stated["times"])
    sequence.with_facts(facts)
    if made is not None:
        write_whole(track_file, track_image(replace(made, sequence=sequence)))
    write_whole(sequence_image, upload_image(sequence))
    return record_of(sequence, created="", has_upload=True)
