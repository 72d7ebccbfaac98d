"""Command that writes a moving surface in another format."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from modalmotion.cli.files import read, sequence_argument
from modalmotion.cli.options import command, json_option, tell
from modalmotion.cli.outputs import OutputFile
from modalmotion.exports.files import SURFACES, save


@command("convert frames/ beat.vtkhdf --unit mm")
@sequence_argument
@click.argument("output", metavar="OUT", type=OutputFile(*SURFACES))
@json_option
def convert(source: Path, output: Path, as_json: bool, **options: Any) -> None:
    """Write the sequence in FILE in another format.

    The suffix chooses it: .npz, .h5, .vtkhdf, .glb, .zip (PLY) or .raw.

    FILE is a file of any known format, a folder of frames, or a pattern of their names in quotes.
    """
    sequence = read(source, **options)
    save(sequence, output)
    found = {"n_frames": sequence.n_frames, "n_vertices": sequence.n_vertices, "id": sequence.id}
    said = f"{sequence.n_frames} frames of {sequence.n_vertices} vertices"
    tell({**found, "unit": sequence.unit}, [said], output, as_json=as_json)
