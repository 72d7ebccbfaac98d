"""The command that measures speed and numbers against accuracy."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from modalmotion.choice.parameters import SignatureParameters
from modalmotion.cli.analysis_commands import price_lines
from modalmotion.cli.asking import asked_for, asking_options
from modalmotion.cli.files import GridShape, read, sequence_argument
from modalmotion.numerals import counted, numeral, with_article
from modalmotion.template.body_frame import Components
from modalmotion.tradeoff import MOST_OF_FRONT, Tradeoff, measure_tradeoff
from modalmotion.tradeoff.plain import as_plain


@click.command()
@sequence_argument
@asking_options
@click.option("--topology", help="Over what the file states; the only one that is measured.")
@click.option("--grid", type=GridShape(), help="Lattice shape; over the file's own.")
@click.option(
    "--components",
    type=click.Choice([c.value for c in Components]),
    help="The only ones that are measured.  [default: all that the surface has]",
)
@click.option(
    "--front-modes",
    type=click.IntRange(1, 2000),
    default=MOST_OF_FRONT,
    show_default=True,
    help="Modes that the front reaches to.",
)
@click.option("--plot", type=click.Path(path_type=Path), help="Picture to write (PNG, SVG, PDF).")
@click.option("--json", "as_json", is_flag=True, help="Print all of it as JSON.")
def tradeoff(
    source: Path,
    topology: str | None,
    grid: tuple[int, ...] | None,
    components: str | None,
    front_modes: int,
    plot: Path | None,
    as_json: bool,
    **said: Any,
) -> None:
    """Measure what each choice of modes costs and loses on the sequence in FILE.

    Ask for a point of the front by --modes, --tolerance, --tolerance-share or --auto.
    """
    asked = asked_for(said)
    only = None if components is None else Components(components)
    parameters = SignatureParameters(
        topology=topology, grid=grid, components=only or Components.CARTESIAN, **asked
    )
    found = measure_tradeoff(
        read(source, **said),
        parameters,
        most_modes=front_modes,
        components=None if only is None else (only,),
    )
    if plot is not None:
        from modalmotion.pictures.tradeoff import tradeoff_figure

        tradeoff_figure(found).savefig(plot)
    click.echo(json.dumps(as_plain(found), indent=2) if as_json else _lines(found))
    if plot is not None:
        click.echo(f"written: {plot}", err=as_json)


def _lines(found: Tradeoff) -> str:
    front, price = found.front, found.chosen.price
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
    for kind, error in found.scene.errors.items():
        moved = (
            f"{numeral(error.rms, of=motion)} {unit} RMS, {numeral(error.max, of=motion)} at most"
        )
        lines.append(f"as {with_article(kind)} motion: {moved}")
    if found.noise is not None:
        lines.append(found.noise.note(front.unit))
    lines.append(f"chosen: {describe(found)}")
    lines.append(
        f"error {numeral(price.rms_error, of=motion)} {unit} RMS, "
        f"{numeral(price.p95_error, of=motion)} (p95) and "
        f"{numeral(price.max_error, of=motion)} (max) in the worst frame"
    )
    lines += price_lines(price)
    if found.chosen.signature is not None:
        lines += [f"note: {note}" for note in found.chosen.signature.notes]
    return "\n".join(lines)


def describe(found: Tradeoff) -> str:
    """Say in a line what was chosen."""
    price, signature = found.chosen.price, found.chosen.signature
    if signature is None:
        return f"{found.chosen.kind} motion, {price.amplitudes_per_frame} numbers a frame"
    count = counted(len(signature.modes), "mode")
    text = f"{count}, {signature.surface}, {signature.parameters.components}"
    harmonics = signature.parameters.harmonics
    if harmonics is not None:
        text += f", {counted(harmonics, 'harmonic')}"
    return f"{text}: {price.amplitudes_per_frame} amplitudes a frame"
