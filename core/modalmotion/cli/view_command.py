"""Command that writes an HTML page of a moving surface."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
import numpy as np

from modalmotion.classification.answer import Classification
from modalmotion.cli.files import fitted, sequence_argument
from modalmotion.cli.options import command, fit_options, json_option, output_option, tell
from modalmotion.cli.waiting import Waiting
from modalmotion.exports.reading import stream_at
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.modes.topology import CUP
from modalmotion.signature.making import ModalSignature


@command("view beat.npz -o beat.html")
@sequence_argument
@output_option("Page to write.", ".html")
@click.option(
    "--with",
    "other",
    type=click.Path(exists=True, path_type=Path),
    help="A second file, shown beside the first with a common clock and camera.",
)
@click.option(
    "--classify/--no-classify",
    default=True,
    show_default=True,
    help="Show the class by the included model.",
)
@json_option
@fit_options
def view(
    source: Path,
    output: Path,
    other: Path | None,
    classify: bool,
    as_json: bool,
    **options: Any,
) -> None:
    """Write an HTML page of the moving surface in FILE, with its reconstruction.

    The page is one file: it opens from disk in any browser and needs no network. For a track (.h5)
    the data are drawn over the surface. If FILE is a compressed
    stream, the page contains it and decodes it.
    """
    from modalmotion.store import write_atomic
    from modalmotion.tracking.hdf5 import kept_track
    from modalmotion.viewer.page import View, view_page

    views = []
    with Waiting(source) as waiting:
        for path in filter(None, (source, other)):
            sequence, signature = fitted(path, waiting, {**options})
            answer = _answer(sequence, signature) if classify else None
            tracked = kept_track(path)
            data = None if tracked is None else tracked.data
            stream = _stream(path, sequence)
            views.append(
                View(signature, sequence, path.name, None, answer, data=data, stream=stream)
            )
        with waiting.watch.stage("write"):
            write_atomic(output, view_page(views).encode())
    tell({"titles": [view.title for view in views]}, [], output, as_json=as_json)


def _answer(sequence: MeshSequence, signature: ModalSignature) -> Classification | None:
    """Classify by the shipped model, which knows ventricles only."""
    from modalmotion.classification import classify

    return classify(sequence) if signature.topology == CUP else None


def _stream(path: Path, sequence: MeshSequence) -> bytes | None:
    """Give the bytes of a compressed file, if a page can decode them to this sequence."""
    from modalmotion.codec import decode, inspect
    from modalmotion.codec.spatial_modes import STORED

    data = stream_at(path)
    if data is None or inspect(data).modes == STORED:
        return None
    # Options of reading may have changed the order of frames.
    return data if np.array_equal(decode(data).vertices, sequence.vertices) else None
