"""Command that trains a model."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, Final

import click

from modalmotion.classification.manifest import LabelledSequence, labelled_files
from modalmotion.classification.options import OnError, TrainingOptions
from modalmotion.cli.case_options import cases_option, labelled_sources, unit_option
from modalmotion.cli.model_texts import card_lines, model_json
from modalmotion.cli.options import command, json_option, options_of, plot_option, tell
from modalmotion.cli.outputs import OutputFile, write_picture

_HELP: Final = {
    "modes": "Modes of the signatures; 3 amplitudes per frame each.",
    "topology": "cup, sphere, ..., or mesh for spring modes; found from all cases by default.",
    "kind": "material: points follow the tissue; offset: normal displacement, for points that may "
    "slide over it; by default what all recordings state, and else the better of both.",
    "timing": "cycle: one turn of a cycle; transient: a movement with a beginning and an end.",
    "folds": "Folds of the grouped cross-validation.",
    "repetitions": "Repetitions of the cross-validation, each with folds of its own.",
    "groups": "Column of the manifest, such as site, whose cases are never divided by a split.",
    "seed": "Seed of all random numbers.",
}
_OWN: Final[dict[str, Any]] = {name: {"help": text} for name, text in _HELP.items()}


@command("train cases.csv --name mine -o mine.h5")
@labelled_sources
@unit_option
@click.option("--name", required=True, help="Name of the model: lower-case letters, digits, . _ -")
@click.option("-o", "--out", required=True, type=OutputFile(), help="File to write (HDF5).")
@plot_option
@cases_option
@json_option
@options_of(TrainingOptions, *_HELP, **_OWN)
def train(
    sources: tuple[Path, ...],
    name: str,
    out: Path,
    plot: Path | None,
    cases_file: Path | None,
    unit: str | None,
    skip_unreadable: bool,
    as_json: bool,
    **options: Any,
) -> None:
    """Train a model on labelled sequences.

    MANIFEST is a table (.csv) with the columns path, label and, if known, subject: sequences of one
    subject are never on both sides of a split. Further columns (age, sex, ...) are covariates. Or
    name files, each in a folder named after its class: normal/*.npz akinesia/*.npz
    """
    from modalmotion.classification import train as fit
    from modalmotion.store import model_to_hdf5, require_model_name, write_atomic

    require_model_name(name)
    on_error = OnError.LEAVE_OUT if skip_unreadable else OnError.RAISE
    training_options = TrainingOptions.from_json({**options, "on_error": on_error})
    files = labelled_files(sources, skip_unreadable=skip_unreadable)
    with _TrainingBar() as bar:
        cases = [LabelledSequence(file, {"unit": unit}) for file in files]
        model = fit(cases, name, training_options, bar)
    write_atomic(out, model_to_hdf5(model))
    if plot is not None:
        from modalmotion.pictures.classification import card_figure

        write_picture(card_figure(model.card, name), plot)
    said = [card_lines(model.name, model.id, model.card)]
    if cases_file is not None and model.cross_validation is not None:
        write_atomic(cases_file, model.cross_validation.as_csv().encode())
    elif cases_file is not None:
        said.append("note: without a cross-validation there is no table of held-out cases")
        cases_file = None
    tell(model_json(model), said, out, plot, cases_file, as_json=as_json)


class _TrainingBar:
    """A bar for the reading of the files and the training."""

    def __init__(self) -> None:
        self._bar: Any = click.progressbar(length=1000, label="training", file=sys.stderr)

    def __call__(self, share: float, text: str) -> None:
        self._bar.label = text[:40]
        # Files are read twice where the first fit of some does not compare with the others'.
        self._bar.update(max(0, round(1000 * share) - self._bar.pos))

    def __enter__(self) -> _TrainingBar:
        self._bar.__enter__()
        return self

    def __exit__(self, *details: Any) -> None:
        self._bar.__exit__(*details)
