"""Command that says what a file holds."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import click

from modalmotion.cli.options import command, json_option
from modalmotion.codec.container import MAGIC
from modalmotion.errors import InputError
from modalmotion.hdf5.gate import SIGNATURE
from modalmotion.hdf5.sealed import SEAL_LENGTH

# Of texts that a file holds any number of.
_MOST_NOTES: Final = 5


@command("show beat.h5")
@click.argument(
    "file", metavar="FILE", type=click.Path(exists=True, dir_okay=False, path_type=Path)
)
@json_option
def show(file: Path, as_json: bool) -> None:
    """Say what FILE holds.

    A signature, sequence, track, template, class, model or stream of modalmotion's, or a moving
    surface in any known format.
    """
    content = _content(file)
    if as_json:
        click.echo(json.dumps(content, indent=2))
        return
    width = max(map(len, content))
    for name, value in content.items():
        if isinstance(value, list):
            for one in value[:_MOST_NOTES]:
                click.echo(f"{name:>{width}}  {one}")
        elif value is not None:
            click.echo(f"{name:>{width}}  {value}")


def _content(file: Path) -> dict[str, Any]:
    with file.open("rb") as opened:
        head = opened.read(len(SIGNATURE))
        opened.seek(max(0, file.stat().st_size - SEAL_LENGTH))
        is_ours = head == SIGNATURE and b"modalmotion sha256" in opened.read()
    if head.startswith(MAGIC):
        return _stream(file)
    if is_ours:
        from modalmotion.hdf5.form import form_of

        kind = form_of(file).kind
        return {"holds": kind, **_READERS.get(kind, _nothing_more)(file)}
    return {"holds": "moving surface", **_sequence_in(file)}


def _stream(file: Path) -> dict[str, Any]:
    from modalmotion.codec.decoder import inspect

    header = inspect(file.read_bytes())
    names = ("n_frames", "n_vertices", "n_faces", "topology", "grid", "unit", "rms", "max_error")
    stated = {name: _plain(getattr(header, name)) for name in names}
    return {"holds": "compressed sequence", **stated, "bytes": file.stat().st_size}


def _signature(file: Path) -> dict[str, Any]:
    from modalmotion.store import signature_from_hdf5

    value = signature_from_hdf5(file)
    return {
        "surface": value.surface,
        "frames": value.n_frames,
        "vertices": value.n_vertices,
        "modes": len(value.modes),
        "amplitudes_per_frame": value.n_amplitudes,
        "components": value.parameters.components.value,
        "unit": value.unit,
        "rms_error": value.rms_error,
        "max_error": value.max_error,
        "sequence_id": value.sequence_id,
        "template_id": value.template_id,
        "made_by": f"modalmotion {value.provenance.get('modalmotion', '')}".strip(),
        "note": list(value.notes),
    }


def _sequence(file: Path) -> dict[str, Any]:
    from modalmotion.store import sequence_from_hdf5

    return _of_sequence(sequence_from_hdf5(file))


def _sequence_in(file: Path) -> dict[str, Any]:
    from modalmotion.formats import ReadOptions, read_sequence

    try:
        reading = read_sequence(file, ReadOptions())
    except InputError as error:
        raise click.ClickException(
            f"{file.name} is neither a file of modalmotion's nor a moving surface: {error}"
        ) from error
    return {
        "format": reading.format,
        **_of_sequence(reading.sequence),
        "not_used": list(reading.ignored),
        "note": list(reading.notes),
    }


def _of_sequence(sequence: Any) -> dict[str, Any]:
    return {
        "frames": sequence.n_frames,
        "vertices": sequence.n_vertices,
        "triangles": len(sequence.faces),
        "topology": _plain(sequence.topology),
        "grid": _plain(sequence.grid),
        "seconds": None
        if sequence.times is None
        else float(sequence.times[-1] - sequence.times[0]),
        "unit": sequence.unit,
        "facts": repr(sequence.facts)[6:-1],
        "id": sequence.id,
    }


def _template(file: Path) -> dict[str, Any]:
    from modalmotion.store import template_from_hdf5

    value = template_from_hdf5(file)
    return {
        "surface": "mesh" if value.surface is None else value.surface.name,
        "vertices": value.n_vertices,
        "lengths": list(value.lengths),
        "id": value.id,
        "note": list(value.notes),
    }


def _model(file: Path) -> dict[str, Any]:
    from modalmotion.classification import load_model

    value = load_model(file)
    return {
        "name": value.name,
        "classes": ", ".join(value.classes),
        "cases": sum(value.card.n_cases.values()),
        "accuracy": value.card.accuracy,
        "reads": f"{value.signature_parameters.modes} modes, "
        f"{value.signature_parameters.components.value}",
    }


def _class(file: Path) -> dict[str, Any]:
    from modalmotion.store import classification_from_hdf5

    value = classification_from_hdf5(file)
    return {
        "label": value.label or "no class",
        "probability": value.probability,
        "class_set": ", ".join(value.class_set),
        "model": value.model,
        "sequence_id": value.sequence_id,
        "note": list(value.notes),
    }


def _nothing_more(file: Path) -> dict[str, Any]:
    return {"bytes": file.stat().st_size}


_READERS: Final[dict[str, Callable[[Path], dict[str, Any]]]] = {
    "signature": _signature,
    "sequence": _sequence,
    "template": _template,
    "model": _model,
    "classification": _class,
}


def _plain(value: Any) -> Any:
    if value is None or isinstance(value, int | float | str):
        return value
    return list(value) if isinstance(value, tuple) else str(value)
