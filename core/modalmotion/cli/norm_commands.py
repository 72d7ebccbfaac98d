"""Commands of norms: train and ask."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from modalmotion.classification.manifest import LabelledFile, LabelledSequence, labelled_files
from modalmotion.cli.case_options import labelled_sources, unit_option
from modalmotion.cli.options import example, json_option, tell
from modalmotion.cli.outputs import OutputFile


@click.group()
def norm() -> None:
    """Compare recordings with your own controls."""


@norm.command(epilog=example("norm train controls.csv --name volunteers -o volunteers.h5"))
@labelled_sources
@unit_option
@click.option("--name", required=True, help="Of the norm: lower-case letters, digits, '._-'.")
@click.option("-o", "--out", required=True, type=OutputFile(), help="File to write (HDF5).")
@click.option(
    "--modes", default=7, show_default=True, help="Modes of the signatures; 3 amplitudes per frame."
)
@click.option(
    "--topology",
    help="cup, sphere, ..., or mesh for spring modes; found from all controls by default.",
)
@json_option
def train(
    sources: tuple[Path, ...],
    name: str,
    out: Path,
    modes: int,
    topology: str | None,
    as_json: bool,
    unit: str | None,
    skip_unreadable: bool,
) -> None:
    """Make a norm of recordings of controls, one of each person.

    MANIFEST is a table with the column path and, if known, subject and facts; labels are ignored.
    FILES are files of sequences.
    """
    from modalmotion.norm import norm_to_hdf5, train_norm
    from modalmotion.store import write_atomic

    files = labelled_files(sources, skip_unreadable=skip_unreadable, needs_label=False)
    cases, left_out = _read(files, unit, lambda case, _: case, skip_unreadable=skip_unreadable)
    result = train_norm(cases, name, modes=modes, topology=topology)
    write_atomic(out, norm_to_hdf5(result))
    said = result.as_json()
    lines = [
        f"{result.name} (id {result.id[:12]}): {result.n_controls} controls",
        f"{said['topology']}, {said['n_modes']} modes",
        f"groups: {', '.join(said['groups'])}",
        f"smallest level: {said['smallest_level']:.3g}",
        *(f"note: {note}" for note in result.notes),
        *left_out,
    ]
    tell({**said, "left_out": left_out}, lines, out, as_json=as_json)


@norm.command(epilog=example("norm ask volunteers.h5 beat.npz"))
@click.argument("norm_file", metavar="NORM", type=click.Path(exists=True, path_type=Path))
@labelled_sources
@unit_option
@click.option(
    "--level",
    default=0.05,
    show_default=True,
    help="Level: share of recordings like the controls that are called a deviation.",
)
@json_option
def ask(
    norm_file: Path,
    sources: tuple[Path, ...],
    level: float,
    as_json: bool,
    unit: str | None,
    skip_unreadable: bool,
) -> None:
    """Compare recordings with the controls of NORM, a file.

    Five or more are also compared together, with a warning if machine or protocol differ. MANIFEST
    and FILES are as for training.
    """
    from modalmotion.norm import cohort_deviation, norm_from_hdf5
    from modalmotion.norm.norm import FEWEST_RECORDINGS, others_than

    controls = norm_from_hdf5(norm_file)
    files = labelled_files(sources, skip_unreadable=skip_unreadable, needs_label=False)

    def read(case: Any, name: str) -> Any:
        return controls.read(case.motion, subject=case.subject, name=name)

    readings, left_out = _read(files, unit, read, skip_unreadable=skip_unreadable)
    together = None
    if len(others_than(controls, readings)) >= FEWEST_RECORDINGS:
        together = cohort_deviation(controls, readings, level=level)
    answers = [controls.deviation(one, level=level) for one in readings]
    pairs = list(zip(readings, answers, strict=True))
    lines = [f"{one.name}\n{answer.lines}" for one, answer in pairs]
    if together is not None:
        lines.append(f"together: p = {together.p:.3g} of {controls.n_controls} like controls")
        if together.warning is not None:
            lines.append(f"warning: {together.warning}")
    shown = [{"path": one.name, **answer.as_json()} for one, answer in pairs]
    whole = None if together is None else together.as_json()
    found = {"cohort": whole, "deviations": shown, "left_out": left_out}
    tell(found, [*lines, *left_out], as_json=as_json)


def _read(
    files: list[LabelledFile],
    unit: str | None,
    use: Callable[[Any, str], Any],
    *,
    skip_unreadable: bool,
) -> tuple[list[Any], list[str]]:
    """Read files, each for a use; those that cannot be used may be left out, and are named."""
    from modalmotion.classification.cases import UNUSABLE, LeftOut, left_out_notes

    used: list[Any] = []
    left_out: list[LeftOut] = []
    with click.progressbar(files, label="recordings", file=sys.stderr) as bar:
        for file in bar:
            source = LabelledSequence(file, {"unit": unit})
            try:
                used.append(use(source.read(), source.name))
            except UNUSABLE as error:
                if not skip_unreadable:
                    raise
                left_out.append(LeftOut.of(error, source.name))
    return used, list(left_out_notes(left_out))
