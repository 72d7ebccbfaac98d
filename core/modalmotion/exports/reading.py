"""A moving surface read from a file of any kind, and pictures written; light, for every command."""

from __future__ import annotations

import io
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Final

from modalmotion import errors, formats
from modalmotion.formats import detect, result
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.progress import Reporter
from modalmotion.store.disk import write_atomic

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def read(path: str | Path, options: formats.ReadOptions | None = None) -> MeshSequence:
    """Read a moving surface: a file, a folder of frames, or a pattern such as "scan_*.ply".

    Parameters
    ----------
    path : str or Path
    options : ReadOptions, optional
        What the file does not state: `read(path, unit="mm")`.

    Returns
    -------
    MeshSequence
        For a track its sequence, with the track's errors.

    Raises
    ------
    InputError
        If it cannot be read; the remedy is how to convert or track it.

    Warns
    -----
    UserWarning
        About what the reader changed or assumed; `read_sequence` returns it as notes.
    """
    reading = read_recording(Path(path), options)
    for note in reading.notes:
        # Of the caller, through the check of its arguments.
        warnings.warn(note.text, stacklevel=3)
    return reading.sequence


def read_recording(
    path: Path, options: formats.ReadOptions | None = None, *, progress: Reporter | None = None
) -> result.Reading:
    """Read a moving surface with its notes; for a track its sequence and errors.

    A compressed stream is decoded.
    """
    options = formats.ReadOptions() if options is None else options
    stream = stream_at(path)
    if stream is not None:
        from modalmotion.codec import decode

        return options.apply(result.Reading(decode(stream, limits=options.limits), format="stream"))
    if path.suffix.lower() in (".h5", ".hdf5"):
        # Tracking is imported for these only.
        from modalmotion.tracking.hdf5 import kept_track

        track = kept_track(path)
        if track is not None:
            return options.apply(result.Reading(track.sequence, format="hdf5"))
    return formats.read_sequence(path, options, progress=progress)


def stream_at(path: Path) -> bytes | None:
    """Return the bytes of a compressed stream, or None if the file is something else."""
    if not path.is_file():
        return None
    with path.open("rb") as file:
        start = file.read(len(detect.STREAM))
        return start + file.read() if start == detect.STREAM else None


PICTURES: Final = (".png", ".svg", ".pdf")
"""Suffixes of pictures."""


def picture_bytes(figure: Figure, kind: str) -> bytes:
    """Write a picture as png, svg or pdf."""
    picture = io.BytesIO()
    figure.savefig(picture, format=kind)
    return picture.getvalue()


def write_picture(figure: Figure, path: Path) -> None:
    """Write a picture to a file, in the format of its suffix.

    Raises
    ------
    ParameterError
        If the suffix is another.
    StoreError
        If it cannot be written.
    """
    if path.suffix.lower() not in PICTURES:
        raise errors.ParameterError(
            f"{path.name!r} does not have the suffix of a picture.",
            remedy=f"Use a name that ends with {', '.join(PICTURES)}.",
        )
    write_atomic(path, picture_bytes(figure, path.suffix[1:].lower()))
