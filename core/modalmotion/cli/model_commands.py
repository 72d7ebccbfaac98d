"""Commands of models: train, evaluate and classify."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from modalmotion.cli.cases import labelled_files, training_cases
from modalmotion.cli.files import GridShape, read, sequence_argument
from modalmotion.cli.model_texts import (
    accuracy_text,
    answer_json,
    answer_lines,
    card_lines,
    evaluation_lines,
)

if TYPE_CHECKING:
    from modalmotion.classification import Model, TrainingCase

_HELP: Final = {
    "modes": "Of the signatures; 3 amplitudes a frame each.",
    "harmonics": "Of each part of the motion.",
    "timing": "cycle: one turn of a cycle; course: a movement with a beginning and an end.",
    "pose": "any: recordings may be turned any way; fixed: they share their coordinates.",
    "estimator": "What turns features into scores; auto chooses by cross-validation.",
    "class_weights": "balanced: rare classes count as much as frequent ones.",
    "folds": "Of the grouped cross-validation.",
    "coverage": "Level that the card reports class sets at.",
    "known_share": "Share of cases like the training ones that the model is to know.",
    "seed": "Of everything that is random.",
}

_COVERAGE = click.option(
    "--coverage",
    default=0.9,
    show_default=True,
    type=click.FloatRange(0, 1, min_open=True, max_open=True),
    help="Probability that the class set holds the true class.",
)
_PLOT = click.option(
    "--plot", type=click.Path(path_type=Path), help="Picture to write (PNG, SVG, PDF)."
)
_JSON = click.option("--json", "as_json", is_flag=True, help="Print the answer as JSON.")


def _training_options(command: Callable[..., None]) -> Callable[..., None]:
    # Those of the library, each under its own name; the library says what is out of range.
    from modalmotion.classification import TrainingOptions

    for name, value in reversed(TrainingOptions().as_json().items()):
        command = click.option(
            f"--{name.replace('_', '-')}",
            name,
            type=type(value),
            default=value,
            show_default=True,
            help=_HELP.get(name),
        )(command)
    return command


def _said_of_files(command: Callable[..., None]) -> Callable[..., None]:
    """Add what may be said of all files."""
    unit = click.option("--unit", help="Length unit of all files, over what they say.")
    topology = click.option("--topology", help="Topology of all files, over what they say.")
    source = click.argument(
        "sources",
        metavar="MANIFEST|FILES...",
        nargs=-1,
        required=True,
        type=click.Path(path_type=Path),
    )
    for decorate in (topology, unit, source):
        command = decorate(command)
    return command


@click.command()
@_said_of_files
@click.option("--name", required=True, help="Of the model: lower-case letters, digits, . _ -")
@click.option(
    "-o", "--out", required=True, type=click.Path(path_type=Path), help="File to write (HDF5)."
)
@_PLOT
@_training_options
def train(
    sources: tuple[Path, ...],
    name: str,
    out: Path,
    plot: Path | None,
    unit: str | None,
    topology: str | None,
    **options: Any,
) -> None:
    """Train a model on labelled sequences.

    MANIFEST is a table (.csv) with the columns path, label and, where it is known, subject:
    sequences of one subject are never on both sides of a split. In its place files may be
    named, each in a folder that is called like its class: normal/*.npz akinesia/*.npz
    """
    from modalmotion.classification import TrainingOptions
    from modalmotion.classification import train as fit
    from modalmotion.store import model_to_hdf5, require_model_name, write_atomic

    require_model_name(name)
    chosen = TrainingOptions.from_json(options)
    files = labelled_files(sources)
    said = {"unit": unit, "topology": topology}
    with _TrainingBar() as bar:
        cases = bar.after(training_cases(files, chosen.signature_parameters, said))
        model = fit(cases, name, chosen, bar)
    write_atomic(out, model_to_hdf5(model))
    if plot is not None:
        from modalmotion.pictures.model_card import card_figure

        card_figure(model.card, name).savefig(plot)
    click.echo(card_lines(model.name, model.id, model.card))
    for path in (out, plot):
        if path is not None:
            click.echo(f"written: {path}")


@click.command()
@click.argument("model", metavar="MODEL")
@_said_of_files
@_COVERAGE
@_PLOT
@_JSON
def evaluate(
    model: str,
    sources: tuple[Path, ...],
    coverage: float,
    plot: Path | None,
    as_json: bool,
    unit: str | None,
    topology: str | None,
) -> None:
    """Test MODEL, a file or a name, on labelled sequences that it was not trained on.

    MANIFEST and FILES are as for training. The interval of the accuracy counts sequences of one
    subject as fewer than they are.
    """
    from modalmotion.classification import evaluate as test

    chosen = model_named(model)
    files = labelled_files(sources)
    said = {"unit": unit, "topology": topology}
    found = test(chosen, training_cases(files, chosen.signature_parameters, said), coverage)
    if plot is not None:
        from modalmotion.pictures.model_card import measured_figure

        measured_figure(
            title=f"{found.model}: {accuracy_text(found.accuracy, found.accuracy_interval)}, "
            f"{found.n_cases} cases",
            classes=found.classes,
            confusion=found.confusion,
            curve=found.calibration_curve,
            calibration_error=found.calibration_error,
        ).savefig(plot)
    click.echo(json.dumps(found.as_json(), indent=2) if as_json else evaluation_lines(found))
    if plot is not None:
        click.echo(f"written: {plot}", err=as_json)


@click.command()
@sequence_argument
@click.option(
    "--model",
    default="ventricle-simulated",
    show_default=True,
    help="Model to ask: the name of one that is shipped, or a file.",
)
@_COVERAGE
@click.option("--topology", help="Over what the file states.")
@click.option("--grid", type=GridShape(), help="Lattice shape; over the file's own.")
@_PLOT
@_JSON
def classify(
    source: Path,
    model: str,
    coverage: float,
    topology: str | None,
    grid: tuple[int, ...] | None,
    plot: Path | None,
    as_json: bool,
    **said: Any,
) -> None:
    """Name the motion class of the sequence in FILE."""
    from modalmotion.classification import classify as ask
    from modalmotion.signature.making import modal_signature

    chosen = model_named(model)
    sequence = read(source, grid=grid, topology=topology, **said)
    result = ask(modal_signature(sequence, chosen.signature_parameters), chosen, coverage)
    if plot is not None:
        from modalmotion.pictures.classification import answer_figure

        answer_figure(result).savefig(plot)
    click.echo(answer_json(result) if as_json else answer_lines(result))
    if plot is not None:
        click.echo(f"written: {plot}", err=as_json)


def model_named(which: str) -> Model:
    """Load the model in a file, or the one of that name that comes with the package.

    Raises
    ------
    NotFoundError
        If there is neither.
    CorruptFileError, ModelNotReproducedError
        If it is damaged, or does not answer as where it was made.
    """
    from modalmotion.classification import load_model

    path = Path(which)
    return load_model(path if path.is_file() else which)


class _TrainingBar:
    """A bar for the training itself, which begins when the last signature has been read."""

    def __init__(self) -> None:
        self._bar: Any = None

    def after(self, cases: Iterator[TrainingCase]) -> Iterator[TrainingCase]:
        """Give the cases, and show the bar from then on."""
        yield from cases
        self._bar = click.progressbar(length=1000, label="training", file=sys.stderr)
        self._bar.__enter__()

    def __call__(self, share: float, text: str) -> None:
        if self._bar is not None:
            self._bar.label = text[:40]
            self._bar.update(round(1000 * share) - self._bar.pos)

    def __enter__(self) -> _TrainingBar:
        return self

    def __exit__(self, *details: Any) -> None:
        if self._bar is not None:
            self._bar.__exit__(*details)
