"""Templates made, described and drawn."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path

from modalmotion.formats import ReadOptions
from modalmotion.signature.making import SignatureParameters, resolve_template
from modalmotion.stopwatch import Stopwatch
from modalmotion.store import template_from_hdf5, template_to_hdf5
from modalmotion_service.schemas import TemplateAnswer
from modalmotion_service.work.tasks.files import read_upload, write_whole


@dataclass(frozen=True)
class Templated:
    """A template that was made of an upload.

    Parameters
    ----------
    answer : TemplateAnswer
    milliseconds : dict
        By stage.
    """

    answer: TemplateAnswer
    milliseconds: dict[str, float]


def make_template(
    upload: Path, options: ReadOptions, parameters: SignatureParameters, image: Path
) -> Templated:
    """Make the template of an upload's reference frame and write its HDF5 image."""
    watch = Stopwatch()
    with watch.stage("read"):
        sequence = read_upload(upload, options).sequence
    with watch.stage("template"):
        template = resolve_template(sequence, parameters)
    with watch.stage("image"):
        write_whole(image, template_to_hdf5(template))
    return Templated(TemplateAnswer.of(template), watch.milliseconds)


def describe_template(path: Path) -> TemplateAnswer:
    """Say what a kept template holds."""
    return TemplateAnswer.of(template_from_hdf5(path))


def draw_template(path: Path) -> bytes:
    """Draw s and theta on a kept template's surface, as PNG."""
    from modalmotion.pictures.template import template_figure

    buffer = io.BytesIO()
    template_figure(template_from_hdf5(path)).savefig(buffer, format="png")
    return buffer.getvalue()
