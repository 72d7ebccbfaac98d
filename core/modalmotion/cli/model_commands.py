"""Commands of models: train, evaluate and classify."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from modalmotion.cli.cases import LabelledSequence, labelled_files, labelled_sources
from modalmotion.cli.files import read, sequence_argument
from modalmotion.cli.model_texts import (
    answer_json,
    answer_lines,
    card_lines,
    comparison_lines,
    evaluation_lines,
)
from modalmotion.cli.options import (
    example,
    json_option,
    list_written,
    plot_option,
    surface_options,
    tell,
)
from modalmotion.cli.outputs import OutputFile, write_picture

if TYPE_CHECKING:
    from modalmotion.classification import Model, TrainingCase
    from modalmotion.classification.training.left_out import LeftOut

_HELP: Final = {
    "modes": "Modes of the signatures; 3 amplitudes a frame each.",
    "topology": "cup, sphere, ..., or mesh for spring modes; all cases decide it together by "
    "default.",
    "kind": "material: points follow the tissue; offset: they may slide over it; by default what "
    "all recordings state, and else the better of both.",
    "harmonics": "Harmonics of each part of the motion.",
    "timing": "cycle: one turn of a cycle; course: a movement with a beginning and an end.",
    "pose": "any: recordings may be turned any way; fixed: they share their coordinates.",
    "estimator": "Turns features into scores; auto chooses by cross-validation.",
    "class_weights": "balanced: rare classes count as much as frequent ones.",
    "folds": "Folds of the grouped cross-validation.",
    "repetitions": "Repetitions of the cross-validation, each with folds of its own.",
    "card": "full, or quick: without a learning curve.",
    "fold": "Column of the manifest whose values are the folds, in place of drawn ones.",
    "groups": "Column of the manifest, such as site, whose cases stay on one side of each split.",
    "coverage": "Level of the card's class sets.",
    "walls": "Whether the zero of theta tells walls apart; auto: where every case states it.",
    "further": "Whether size, rest shape, volume and covariates may be read beside motion.",
    "known_share": "Share of cases like the training ones that the model accepts as known.",
    "seed": "Seed of all random numbers.",
}

_COVERAGE = click.option(
    "--coverage",
    default=0.9,
    show_default=True,
    type=click.FloatRange(0, 1, min_open=True, max_open=True),
    help="Probability that the class set holds the true class.",
)


def _training_options(command: Callable[..., None]) -> Callable[..., None]:
    # Options of the library under their own names; the library checks their ranges.
    from modalmotion.classification import TrainingOptions

    for name, value in reversed(TrainingOptions().as_json().items()):
        if name == "on_error":
            continue
        command = click.option(
            f"--{name.replace('_', '-')}",
            name,
            type=str if value is None else type(value),
            default=value,
            show_default=True,
            help=_HELP.get(name),
        )(command)
    return command


_cases_option = click.option(
    "--cases",
    "cases_file",
    type=OutputFile(".csv"),
    help="Table to write: probabilities of each case, held out (.csv).",
)


@click.command(epilog=example("train cases.csv --name mine -o mine.h5"))
@labelled_sources
@click.option("--name", required=True, help="Name of the model: lower-case letters, digits, . _ -")
@click.option("-o", "--out", required=True, type=OutputFile(), help="File to write (HDF5).")
@plot_option
@_cases_option
@json_option
@_training_options
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

    MANIFEST is a table (.csv) with the columns path, label and, where it is known, subject:
    sequences of one subject are never on both sides of a split. Further columns (age, sex, ...)
    are covariates. In its place you may name files, each in a folder named after its class:
    normal/*.npz akinesia/*.npz
    """
    from modalmotion.classification import TrainingOptions
    from modalmotion.classification import train as fit
    from modalmotion.classification.options import OnError
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
        from modalmotion.pictures.model_card import card_figure

        write_picture(card_figure(model.card, name), plot)
    said = [card_lines(model.name, model.id, model.card)]
    if cases_file is not None and model.cross_validation is not None:
        write_atomic(cases_file, model.cross_validation.as_csv().encode())
    elif cases_file is not None:
        said.append("note: without a cross-validation there is no table of held-out cases")
        cases_file = None
    tell(_model_answer(model), said, out, plot, cases_file, as_json=as_json)


def _model_answer(model: Model) -> dict[str, object]:
    return {"name": model.name, "id": model.id, "card": model.card.as_json()}


@click.command(epilog=example("evaluate mine.h5 others.csv"))
@click.argument("model", metavar="MODEL")
@labelled_sources
@_COVERAGE
@plot_option
@_cases_option
@json_option
def evaluate(
    model: str,
    sources: tuple[Path, ...],
    coverage: float,
    plot: Path | None,
    cases_file: Path | None,
    as_json: bool,
    unit: str | None,
    skip_unreadable: bool,
) -> None:
    """Test MODEL, a file or a name, on labelled sequences that it was not trained on.

    MANIFEST and FILES are as for training. The interval of the accuracy counts sequences of one
    subject as fewer than they are.
    """
    from modalmotion.classification import evaluate as test
    from modalmotion.classification.training.left_out import left_out_notes
    from modalmotion.classification.usable_cases import usable_cases
    from modalmotion.store import write_atomic

    stored_model = model_named(model)
    files = labelled_files(sources, skip_unreadable=skip_unreadable)
    sources_ = [LabelledSequence(file, {"unit": unit}) for file in files]
    left_out: list[LeftOut] = []
    with click.progressbar(sources_, label="cases", file=sys.stderr) as bar:
        cases: Iterator[TrainingCase] = (source.read() for source in bar)
        if skip_unreadable:
            cases = usable_cases(stored_model, bar, left_out)
        result = test(stored_model, cases, coverage)
    if plot is not None:
        from modalmotion.pictures.model_card import evaluation_figure

        write_picture(evaluation_figure(result), plot)
    if cases_file is not None:
        write_atomic(cases_file, result.as_csv().encode())
    click.echo(json.dumps(result.as_json(), indent=2) if as_json else evaluation_lines(result))
    for note in left_out_notes(left_out):
        click.echo(note, err=as_json)
    list_written(plot, cases_file, as_json=as_json)


@click.command(epilog=example("compare-models mine.h5 other.h5 cases.csv"))
@click.argument("first", metavar="MODEL")
@click.argument("second", metavar="OTHER")
@labelled_sources
@_COVERAGE
@json_option
def compare_models(
    first: str,
    second: str,
    sources: tuple[Path, ...],
    coverage: float,
    as_json: bool,
    unit: str | None,
    skip_unreadable: bool,
) -> None:
    """Compare two models, on the same labelled sequences: MODEL and OTHER.

    Each is a file or a name. MANIFEST and FILES are as for training, of subjects that neither model
    was trained on. Subjects are resampled whole.
    """
    from modalmotion.classification import compare_models as compare
    from modalmotion.classification.training.left_out import left_out_notes

    models = model_named(first), model_named(second)
    files = labelled_files(sources, skip_unreadable=skip_unreadable)
    cases = [LabelledSequence(file, {"unit": unit}) for file in files]
    left_out: list[LeftOut] = []
    with click.progressbar(cases, label="cases", file=sys.stderr) as bar:
        result = compare(*models, bar, coverage, left_out=left_out if skip_unreadable else None)
    click.echo(json.dumps(result.as_json(), indent=2) if as_json else comparison_lines(result))
    for note in left_out_notes(left_out):
        click.echo(note, err=as_json)


class _Named(click.ParamType[tuple[str, float]]):
    """A class, or a pair of classes, with a number: normal=0.95."""

    name = "CLASS=NUMBER"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, float]:
        """Split at the last "="."""
        if isinstance(value, tuple):
            return value
        label, _, number = str(value).rpartition("=")
        try:
            return label, float(number)
        except ValueError:
            self.fail(f"{value!r} is not a class, '=' and a number.", param, ctx)


@click.command(epilog=example("decide mine.h5 --sensitivity akinesia=0.95 -o decided.h5"))
@click.argument("model", metavar="MODEL")
@click.option(
    "--sensitivity",
    multiple=True,
    type=_Named(),
    help="Share of a class to be answered as such; the most urgent class first.",
)
@click.option(
    "--cost",
    multiple=True,
    type=_Named(),
    help="Cost of an error, as TRUE:ANSWER=NUMBER; 1 where none is stated.",
)
@click.option("-o", "--out", required=True, type=OutputFile(), help="File to write (HDF5).")
@json_option
def decide(
    model: str,
    sensitivity: tuple[tuple[str, float], ...],
    cost: tuple[tuple[str, float], ...],
    out: Path,
    as_json: bool,
) -> None:
    """Write MODEL with a rule by which its probabilities become a label.

    Thresholds that reach the sensitivities are chosen on held-out answers; the rule makes another
    model, with an id of its own.
    """
    from modalmotion.classification import decided
    from modalmotion.store import model_to_hdf5, write_atomic

    costs: dict[str, dict[str, float]] = {}
    for pair, number in cost:
        true, _, answer = pair.partition(":")
        costs.setdefault(true, {})[answer] = number
    result = decided(model_named(model), costs=costs or None, sensitivity=dict(sensitivity) or None)
    write_atomic(out, model_to_hdf5(result))
    said = [card_lines(result.name, result.id, result.card)]
    tell(_model_answer(result), said, out, as_json=as_json)


@click.command(epilog=example("classify beat.npz --model mine.h5"))
@sequence_argument
@click.option(
    "--model",
    default="ventricle-simulated",
    show_default=True,
    help="Model: the name of a shipped one, or a file. The default reads displacements where the "
    "file states tracking=material, the surface's offsets otherwise.",
)
@_COVERAGE
@surface_options
@plot_option
@json_option
def classify(
    source: Path,
    model: str,
    coverage: float,
    plot: Path | None,
    as_json: bool,
    **stated: Any,
) -> None:
    """Name the motion class of the sequence in FILE."""
    from modalmotion.classification import classify as ask
    from modalmotion.classification import shipped_for
    from modalmotion.mesh.sequence import MeshSequence
    from modalmotion.modes.topology import MESH
    from modalmotion.signature.making import ModalSignature, modal_signature

    springs = stated["topology"] == MESH
    if springs:
        stated["topology"] = None
    motion: MeshSequence | ModalSignature = read(source, **stated)
    stored_model = model_named(shipped_for(model, motion.facts))
    if springs and isinstance(motion, MeshSequence):
        parameters = replace(stored_model.signature_parameters, topology=MESH)
        motion = modal_signature(motion, parameters)
    result = ask(motion, stored_model, coverage)
    if plot is not None:
        from modalmotion.pictures.classification import answer_figure

        write_picture(answer_figure(result), plot)
    click.echo(answer_json(result) if as_json else answer_lines(result))
    list_written(plot, as_json=as_json)


@click.command(epilog=example("card mine.h5 --markdown -o README.md"))
@click.argument("model")
@click.option(
    "--markdown", is_flag=True, help="As Markdown with a YAML head, as the Hugging Face Hub has it."
)
@click.option("-o", "--out", type=OutputFile(), help="File to write.")
@json_option
def card(model: str, markdown: bool, out: Path | None, as_json: bool) -> None:
    """Say what MODEL was made of, and how well it does.

    MODEL is a file, or the name of a shipped one.
    """
    from modalmotion.classification import card_markdown
    from modalmotion.store import write_atomic

    if markdown and as_json:
        raise click.UsageError("--markdown and --json exclude each other.")
    stored = model_named(model)
    if markdown:
        text = card_markdown(stored.name, stored.id, stored.card)
    elif as_json:
        text = json.dumps(stored.card.as_json(), indent=2) + "\n"
    else:
        text = card_lines(stored.name, stored.id, stored.card) + "\n"
    if out is None:
        click.echo(text, nl=False)
        return
    write_atomic(out, text.encode())
    list_written(out, as_json=as_json)


def model_named(which: str) -> Model:
    """Load the model in a file, or the shipped model of that name.

    Raises
    ------
    NotFoundError
        If neither exists.
    CorruptFileError, ModelNotReproducedError
        If it is damaged, or its answers differ from those where it was trained.
    """
    from modalmotion.classification import load_model

    path = Path(which)
    return load_model(path if path.is_file() else which)


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
