"""Commands that simulate ventricles: one, by every parameter of the model; or a cohort."""

from __future__ import annotations

import csv
import io
import sys
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any, Final

import click
import numpy as np

from modalmotion.cli.files import GridShape
from modalmotion.formats import write_npz
from modalmotion.simulate import (
    Acquisition,
    MotionClass,
    VentricleParameters,
    simulate_ventricle,
)
from modalmotion.simulate import simulate_cohort as cohort
from modalmotion.store import write_atomic

_STATED: Final = ("tracking", "handedness", "period", "cavity", "modality")
"""Facts that the simulator knows."""


def _parameter_options(command: Callable[..., None]) -> Callable[..., None]:
    for parameter in reversed(fields(VentricleParameters)):
        low, high = parameter.metadata["range"]
        command = click.option(
            f"--{parameter.name.replace('_', '-')}",
            parameter.name,
            type=click.FloatRange(low, high),
            default=parameter.default,
            show_default=True,
        )(command)
    return command


@click.command()
@click.option(
    "-o", "--output", required=True, type=click.Path(path_type=Path), help="File to write (.npz)."
)
@click.option("--frames", default=25, show_default=True, help="Frames over one beat.")
@click.option("--noise", default=0.0, show_default=True, help="Of each coordinate, in mm.")
@click.option("--grid", type=GridShape(), default="32,64", show_default=True, help="Lattice.")
@click.option("--vertices", type=int, help="Triangulate so many vertices in place of a lattice.")
@click.option("--seed", default=0, show_default=True, help="Of everything that is random.")
@_parameter_options
def simulate(
    output: Path,
    frames: int,
    noise: float,
    grid: tuple[int, ...],
    vertices: int | None,
    seed: int,
    **parameters: Any,
) -> None:
    """Simulate one heartbeat of a left ventricle.

    The motion is kinematic: it follows ejection fraction, shortening, torsion and timing of
    known physiology, and solves no mechanics.
    """
    if len(grid) != 2:
        raise click.BadParameter("A ventricle's lattice has two axes.", param_hint="--grid")
    sequence = simulate_ventricle(
        VentricleParameters(**parameters),
        grid=(grid[0], grid[1]),
        n_vertices=vertices,
        acquisition=Acquisition(n_frames=frames, noise=noise),
        rng=np.random.default_rng(seed),
    )
    write_atomic(output, write_npz(sequence))
    click.echo(f"{sequence.n_frames} frames of {sequence.n_vertices} vertices, in mm: {output}")


@click.command("simulate-cohort")
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder to write: files, and cases.csv with path, label, subject and facts.",
)
@click.option(
    "--per-class",
    default=20,
    show_default=True,
    type=click.IntRange(min=1),
    help="Ventricles of each class.",
)
@click.option("--noise", default=0.6, show_default=True, help="Of each coordinate, in mm.")
@click.option("--seed", default=0, show_default=True, help="Of everything that is random.")
def simulate_cohort(output: Path, per_class: int, noise: float, seed: int) -> None:
    """Simulate labelled ventricles that differ in motion, shape, mesh, frames and pose."""
    output.mkdir(parents=True, exist_ok=True)
    table = io.StringIO()
    rows = csv.writer(table, lineterminator="\n")
    rows.writerow(["path", "label", "subject", *_STATED])
    total = per_class * len(MotionClass)
    cases = cohort(per_class, rng=np.random.default_rng(seed), noise=noise)
    with click.progressbar(cases, length=total, label="ventricles", file=sys.stderr) as bar:
        for number, case in enumerate(bar):
            name = f"ventricle-{seed}-{number:04d}"
            write_atomic(output / f"{name}.npz", write_npz(case.sequence))
            facts = [getattr(case.sequence.facts, fact) for fact in _STATED]
            rows.writerow([f"{name}.npz", case.label, name, *facts])
    write_atomic(output / "cases.csv", table.getvalue().encode())
    click.echo(f"{total} ventricles of {len(MotionClass)} classes: {output / 'cases.csv'}")
