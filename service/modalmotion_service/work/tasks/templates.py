"""Templates made, described and drawn."""

from __future__ import annotations

from pathlib import Path

from modalmotion.signature.making import SignatureParameters, resolve_template
from modalmotion.stopwatch import Stopwatch
from modalmotion.store import template_from_hdf5, template_to_hdf5
from modalmotion_service.schemas import TemplateAnswer
from modalmotion_service.work.tasks.files import png_of, write_whole
from modalmotion_service.work.upload import Upload


def make_template(
    upload: Upload, parameters: SignatureParameters, image: Path
) -> tuple[TemplateAnswer, dict[str, float]]:
    """Make the template of an upload and write its HDF5 image; gives milliseconds by stage too."""
    watch = Stopwatch()
    with watch.stage("read"):
        sequence = upload.read().sequence
    with watch.stage("template"):
        template = resolve_template(sequence, parameters)
    with watch.stage("image"):
        write_whole(image, template_to_hdf5(template))
    return TemplateAnswer.of(template), watch.milliseconds


def describe_template(path: Path) -> TemplateAnswer:
    """Say what a kept template holds."""
    return TemplateAnswer.of(template_from_hdf5(path))


def draw_template(path: Path) -> bytes:
    """Draw s and theta on a kept template's surface, as PNG."""
    from modalmotion.pictures.template import template_figure

    return png_of(template_figure(template_from_hdf5(path)))
