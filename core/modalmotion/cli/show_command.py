"""Command that shows what is in a file."""

from __future__ import annotations

import json
from operator import attrgetter
from pathlib import Path
from typing import Any, Final

import click

from modalmotion.cli.options import command, json_option
from modalmotion.codec.container import MAGIC
from modalmotion.errors import InputError, StoreError
from modalmotion.hdf5.form import form_of
from modalmotion.hdf5.gate import SIGNATURE

# Of texts of which a file may have any number.
_MOST_NOTES: Final = 5

_SEQUENCE: Final = (
    "n_frames as frames",
    "n_vertices as vertices",
    "faces as triangles",
    *("topology", "grid", "span as seconds", "unit", "facts", "id"),
)
_SHOWN: Final = {
    "sequence": _SEQUENCE,
    "track": tuple(f"sequence.{one}" for one in _SEQUENCE),
    "signature": (
        *("surface", "n_frames as frames", "n_vertices as vertices", "modes"),
        *("n_amplitudes as amplitudes_per_frame", "parameters.components", "unit", "rms_error"),
        *("max_error", "sequence_id", "template_id", "notes"),
    ),
    "template": ("topology as surface", "n_vertices as vertices", "lengths", "id", "notes"),
    "model": ("name", "classes", "card.n_cases as cases", "card.accuracy", "readable.n_modes"),
    "classification": ("label", "probability", "class_set", "model", "sequence_id", "notes"),
    "norm": ("name", "n_controls", "readable.n_modes", "id", "notes"),
    "compressed sequence": (
        *("n_frames", "n_vertices", "n_faces", "topology", "grid", "unit", "rms", "max_error"),
    ),
}
"""Attributes by kind of file, and their names where these are others."""


@command("show beat.h5")
@click.argument("file", metavar="FILE", type=click.Path(exists=True, path_type=Path))
@json_option
def show(file: Path, as_json: bool) -> None:
    """Show what is in FILE.

    FILE is a signature, sequence, track, template, class, model or stream of modalmotion; a moving
    surface in any known format, as a file or a folder of frames; or images.
    """
    content = _content(file)
    if as_json:
        click.echo(json.dumps(content, indent=2))
        return
    width = max(map(len, content))
    for name, value in content.items():
        many = value[:_MOST_NOTES] if name in ("notes", "ignored") else [value]
        for one in many:
            if one is not None:
                text = ", ".join(map(str, one)) if isinstance(one, list) else one
                click.echo(f"{name:>{width}}  {text}")


def _content(file: Path) -> dict[str, Any]:
    head = b""
    if file.is_file():
        with file.open("rb") as opened:
            head = opened.read(len(SIGNATURE))
    if head.startswith(MAGIC):
        from modalmotion.codec.decoder import inspect

        header = inspect(file.read_bytes())
        return {**_shown("compressed sequence", header), "bytes": file.stat().st_size}
    if head == SIGNATURE:
        kind = _kind(file)
        if kind in _SHOWN:
            from modalmotion.exports.files import load

            return _shown(kind, load(file))
        if kind:
            return {"holds": kind, "bytes": file.stat().st_size}
    from modalmotion.formats import read_sequence
    from modalmotion.formats.volumes.reading import holds_images

    if holds_images(file):
        return _images(file)
    try:
        reading = read_sequence(file)
    except InputError as error:
        raise click.ClickException(
            f"{file.name} is neither a file of modalmotion nor a moving surface: {error}"
        ) from error
    return {
        **_shown("sequence", reading.sequence),
        "holds": "moving surface",
        "format": reading.format,
        "ignored": list(reading.ignored),
        "notes": list(reading.notes),
    }


def _images(file: Path) -> dict[str, Any]:
    """Describe images; of a label map the labels of its first frame, with their volumes."""
    from modalmotion.formats.volumes import read_images
    from modalmotion.images import Volume
    from modalmotion.tracking.label_values import is_label_map, values_in

    images = read_images(file)
    first = next(frame for frame in images.frames if frame is not None)
    content = {"holds": "images", "frames": images.n_frames, "period": images.period}
    if isinstance(first, Volume):
        content |= {"voxels": list(first.shape), "spacing": [round(s, 3) for s in first.spacing]}
    else:
        content["planes"] = len(first)
    if isinstance(first, Volume) and is_label_map(images):
        content |= {"holds": "label map", "labels": values_in(first)}
    return content | {"notes": list(images.notes)}


def _kind(file: Path) -> str:
    try:
        return form_of(file).kind
    except StoreError:
        # HDF5 of other programs.
        return ""


def _shown(kind: str, value: Any) -> dict[str, Any]:
    content: dict[str, Any] = {"holds": kind}
    for one in _SHOWN[kind]:
        path, _, name = one.partition(" as ")
        content[name or path.rpartition(".")[2]] = _plain(attrgetter(path)(value))
    return content


def _plain(value: Any) -> Any:
    """Give a value as JSON has it; of sets of modes and of arrays their number."""
    if value is None or isinstance(value, int | float | str):
        return value
    if isinstance(value, tuple):
        return list(value)
    if isinstance(value, dict):
        return sum(value.values())
    return len(value) if hasattr(value, "__len__") else str(value)
