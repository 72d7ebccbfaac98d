"""Templates made, described and drawn."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from modalmotion.errors import LimitError
from modalmotion.exports.animation import modes_to_hdf5, modes_to_npz
from modalmotion.progress import Stopwatch
from modalmotion.signature.making import (
    SignatureParameters,
    resolve_parameters,
    resolve_template,
)
from modalmotion.store import template_from_hdf5, template_to_hdf5
from modalmotion.template.vibration_modes import surface_modes
from modalmotion_service.http.negotiation import HDF5, NPZ, PNG
from modalmotion_service.schemas.requests import ModesRequest
from modalmotion_service.schemas.signatures import ModesAnswer, TemplateAnswer
from modalmotion_service.work.task_progress import ProgressFile
from modalmotion_service.work.tasks.files import png_of, write_whole
from modalmotion_service.work.upload import Upload

# Parts of the whole, of a large mesh; the rest is for the server.
_SHARES: Final = {"read": 0.2, "template": 0.65, "image": 0.1}

# Numbers of the shapes in one answer: 256 MB, and as text much more.
_MOST_NUMBERS: Final = 32_000_000
_MOST_NUMBERS_AS_JSON: Final = 2_000_000


def make_template(
    upload: Upload, parameters: SignatureParameters, image: Path, progress: Path | None = None
) -> tuple[TemplateAnswer, dict[str, float]]:
    """Make the template of an upload and write its HDF5 image; gives milliseconds by stage too.

    `progress` is a `ProgressFile`, where somebody reads it.
    """
    watch = Stopwatch() if progress is None else Stopwatch(_SHARES, ProgressFile(progress).write)
    with watch.stage("read"):
        sequence = upload.read().sequence
    with watch.stage("template") as report:
        resolved = resolve_parameters(sequence, parameters)
        template = resolve_template(sequence, resolved, report=report)
    with watch.stage("image"):
        write_whole(image, template_to_hdf5(template))
    return TemplateAnswer.of(template), watch.milliseconds


def describe_template(path: Path) -> TemplateAnswer:
    """Say what a kept template holds."""
    return TemplateAnswer.of(template_from_hdf5(path))


def draw_template(path: Path) -> bytes:
    """Draw s and theta on a kept template's surface, as PNG."""
    from modalmotion.pictures.modes import template_figure

    return png_of(template_figure(template_from_hdf5(path)))


def modes_of_template(path: Path, query: ModesRequest, media_type: str) -> bytes:
    """Give a kept template's vibration modes as JSON, npz, HDF5 or PNG."""
    template = template_from_hdf5(path)
    _require_room(template.n_vertices * query.modes, _MOST_NUMBERS)
    modes = surface_modes(template, query.modes, query.wave_speed)
    if media_type == PNG:
        from modalmotion.pictures.modes import modes_figure

        return png_of(modes_figure(template, modes))
    if media_type in (NPZ, HDF5):
        return (modes_to_npz if media_type == NPZ else modes_to_hdf5)(modes)
    if query.shapes:
        _require_room(modes.shapes.size, _MOST_NUMBERS_AS_JSON)
    return ModesAnswer.of(template, modes, query.shapes).model_dump_json().encode()


def _require_room(n_numbers: int, most: int) -> None:
    if n_numbers > most:
        raise LimitError(
            f"The shapes of these modes are {n_numbers} numbers; one answer holds {most}.",
            remedy="Ask for fewer modes, or for npz or HDF5 in place of JSON.",
            limit="shapes",
            details={"value": n_numbers, "most": most},
        )
