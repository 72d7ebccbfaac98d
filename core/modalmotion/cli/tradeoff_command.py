"""The command that measures size and time against accuracy."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from modalmotion.cli.analysis_commands import price_lines
from modalmotion.cli.files import read, sequence_argument
from modalmotion.cli.options import (
    command,
    json_option,
    mode_options,
    options_of,
    picture_option,
    signature_parameters,
    surface_options,
    tell,
    verbose_option,
)
from modalmotion.cli.outputs import write_picture
from modalmotion.cli.waiting import Waiting
from modalmotion.representation import counted, numeral, with_article
from modalmotion.signature import MOST_OF_FRONT, Tradeoff, measure_tradeoff
from modalmotion.signature.parameters import SignatureParameters
from modalmotion.signature.tradeoff import as_plain
from modalmotion.template.body_frame import Components


@command("tradeoff beat.npz --tolerance 1 -o tradeoff.png")
@sequence_argument
@options_of(
    SignatureParameters,
    "components",
    components={"default": None, "help": "The only components measured; all by default."},
)
@click.option(
    "--front-modes",
    type=click.IntRange(1, 2000),
    default=MOST_OF_FRONT,
    show_default=True,
    help="Largest number of modes on the front.",
)
@picture_option
@json_option
@verbose_option
@mode_options
@surface_options
def tradeoff(
    source: Path,
    components: Components | None,
    front_modes: int,
    plot: Path | None,
    as_json: bool,
    verbose: bool,
    **options: Any,
) -> None:
    """Measure error, size and time of each number of modes for the sequence in FILE.

    Choose a point of the front by --modes, --tolerance or --auto.
    """
    parameters = signature_parameters(options)
    with Waiting(source) as waiting:
        with waiting.watch.stage("read"):
            sequence = read(source, **options)
        result = measure_tradeoff(
            sequence,
            replace(parameters, components=components or Components.CARTESIAN),
            most_modes=front_modes,
            components=None if components is None else (components,),
            watch=waiting.watch,
        )
        if plot is not None:
            with waiting.watch.stage("picture"):
                from modalmotion.pictures.tradeoff import tradeoff_figure

                write_picture(tradeoff_figure(result), plot)
    price = replace(result.chosen.price, milliseconds=waiting.milliseconds())
    result = replace(result, chosen=replace(result.chosen, price=price))
    tell(as_plain(result), _lines(result, verbose), plot, as_json=as_json)


def _lines(result: Tradeoff, verbose: bool) -> list[str]:
    front, price = result.front, result.chosen.price
    unit, motion = front.unit or "length units", front.motion_rms
    lines = [
        (
            f"{counted(front.n_frames, 'frame')}, "
            f"{counted(front.n_vertices, 'vertex', 'vertices')}, "
            f"motion {numeral(motion)} {unit} RMS"
        )
    ]
    for branch in front.branches:
        shown = [k for k, n in enumerate(branch.counts) if n in (1, 7, 18, 37, branch.counts[-1])]
        errors = ", ".join(
            f"{branch.counts[k]}: {numeral(float(branch.rms[k]), of=motion)}" for k in shown
        )
        lines.append(f"{branch.topology}, {branch.components}: RMS by modes {errors}")
    for kind, error in result.scene.errors.items():
        text = (
            f"{numeral(error.rms, of=motion)} {unit} RMS, {numeral(error.max, of=motion)} at most"
        )
        lines.append(f"as {with_article(kind)} motion: {text}")
    if result.noise is not None:
        lines.append(result.noise.note(front.unit))
    lines.append(f"chosen: {describe(result)}")
    lines.append(
        f"error {numeral(price.rms_error, of=motion)} {unit} RMS "
        f"({numeral(price.weighted_rms_error, of=motion)} weighted), "
        f"{numeral(price.p95_error, of=motion)} (p95) and "
        f"{numeral(price.max_error, of=motion)} (max) in the worst frame"
    )
    lines += price_lines(price) if verbose else []
    if result.chosen.signature is not None:
        lines += [f"note: {note}" for note in result.chosen.signature.notes]
    return lines + [f"note: {note}" for note in result.chosen.notes]


def describe(result: Tradeoff) -> str:
    """Describe the choice in a line."""
    price, signature = result.chosen.price, result.chosen.signature
    if signature is None:
        return f"{result.chosen.kind} motion, {price.amplitudes_per_frame} numbers per frame"
    count = counted(len(signature.modes), "mode")
    text = f"{count}, {signature.surface}, {signature.parameters.components}"
    harmonics = signature.parameters.harmonics
    if harmonics is not None:
        text += f", {counted(harmonics, 'harmonic')}"
    return f"{text}: {price.amplitudes_per_frame} amplitudes per frame"
