"""Command that writes the surface at other phases of its cycle."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from modalmotion.cli.files import read, sequence_argument
from modalmotion.cli.options import command, json_option, output_option, tell
from modalmotion.cli.waiting import Waiting
from modalmotion.exports.signature_pack import SUFFIXES, SurfaceFormat, write_surfaces
from modalmotion.representation import counted
from modalmotion.signature import reconstruction
from modalmotion.store import write_atomic

_SUFFIXES = {suffix: kind for suffix, kind in SUFFIXES.items() if kind != SurfaceFormat.GLB}


@command("resample beat.npz --phase 0.37 -o systole.npz")
@sequence_argument
@output_option("File to write: .npz, .vtkhdf or .zip (of PLY).", *_SUFFIXES)
@click.option("--phase", "phases", type=float, multiple=True, help="Share of the cycle, 0 to 1.")
@click.option("--frames", type=click.IntRange(2), help="Instead of phases: number of even steps.")
@json_option
def resample(
    source: Path,
    output: Path,
    phases: tuple[float, ...],
    frames: int | None,
    as_json: bool,
    **options: Any,
) -> None:
    """Write the surface in FILE at any phase of its cycle, with its deviation."""
    if bool(phases) == (frames is not None):
        raise click.UsageError("Give one of --phase and --frames.")
    with Waiting(source) as waiting:
        with waiting.watch.stage("read"):
            sequence = read(source, **options)
        with waiting.watch.stage("resample"):
            result = reconstruction.resample(
                sequence, frames if frames is not None else sorted(phases)
            )
        with waiting.watch.stage("write"):
            kind = _SUFFIXES[output.suffix.lower()]
            fields = {"deviation": result.deviations} if kind == SurfaceFormat.VTKHDF else None
            write_atomic(output, write_surfaces(result.sequence, kind, fields))
    found = {
        "phases": result.phases.tolist(),
        "rms_deviations": result.rms_deviations.tolist(),
        "course": result.course,
        "unit": sequence.unit,
    }
    said = [
        f"{counted(len(result.phases), 'frame')}, {result.course} in time",
        reconstruction.note_on(result),
    ]
    tell(found, said, output, as_json=as_json)
