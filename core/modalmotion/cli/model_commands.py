"""Commands of models: evaluate, compare, classify and card."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from modalmotion.classification.manifest import LabelledSequence, labelled_files
from modalmotion.cli.case_options import cases_option, labelled_sources, unit_option
from modalmotion.cli.files import read, sequence_argument
from modalmotion.cli.model_texts import (
    answer_json,
    answer_lines,
    card_lines,
    comparison_lines,
    evaluation_lines,
)
from modalmotion.cli.options import (
    command,
    coverage_option,
    json_option,
    list_written,
    plot_option,
    surface_options,
    tell,
)
from modalmotion.cli.outputs import OutputFile, write_picture

if TYPE_CHECKING:
    from modalmotion.classification import Model
    from modalmotion.classification.cases import LeftOut


@command("evaluate mine.h5 others.csv")
@click.argument("model", metavar="MODEL")
@labelled_sources
@unit_option
@coverage_option
@plot_option
@cases_option
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
    from modalmotion.classification.cases import left_out_notes
    from modalmotion.store import write_atomic

    stored_model = model_named(model)
    files = labelled_files(sources, skip_unreadable=skip_unreadable)
    sources_ = [LabelledSequence(file, {"unit": unit}) for file in files]
    left_out: list[LeftOut] = []
    with click.progressbar(sources_, label="cases", file=sys.stderr) as bar:
        result = test(stored_model, bar, coverage, left_out=left_out if skip_unreadable else None)
    if plot is not None:
        from modalmotion.pictures.classification import evaluation_figure

        write_picture(evaluation_figure(result), plot)
    if cases_file is not None:
        write_atomic(cases_file, result.as_csv().encode())
    notes = list(left_out_notes(left_out))
    found = {**result.as_json(), "left_out": notes}
    tell(found, [evaluation_lines(result), *notes], plot, cases_file, as_json=as_json)


@command("compare-models mine.h5 other.h5 cases.csv")
@click.argument("first", metavar="MODEL")
@click.argument("second", metavar="OTHER")
@labelled_sources
@unit_option
@coverage_option
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
    """Compare two models on the same labelled sequences.

    MODEL and OTHER are each a file or a name. MANIFEST and FILES are as for training, of subjects
    that neither model was trained on. Cases of one subject count together.
    """
    from modalmotion.classification import compare_models as compare
    from modalmotion.classification.cases import left_out_notes

    models = model_named(first), model_named(second)
    files = labelled_files(sources, skip_unreadable=skip_unreadable)
    cases = [LabelledSequence(file, {"unit": unit}) for file in files]
    left_out: list[LeftOut] = []
    with click.progressbar(cases, label="cases", file=sys.stderr) as bar:
        result = compare(*models, bar, coverage, left_out=left_out if skip_unreadable else None)
    click.echo(json.dumps(result.as_json(), indent=2) if as_json else comparison_lines(result))
    for note in left_out_notes(left_out):
        click.echo(note, err=as_json)


@command("classify beat.npz --model mine.h5")
@sequence_argument
@click.option(
    "--model",
    default="ventricle-simulated",
    show_default=True,
    help="Model: the name of an included one, or a file. The default reads displacements if the "
    "file states tracking=material, the surface's offsets otherwise.",
)
@coverage_option
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
    """Classify the motion of the sequence in FILE."""
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
    tell(answer_json(result), [answer_lines(result)], plot, as_json=as_json)


@command("card mine.h5 --markdown -o README.md")
@click.argument("model")
@click.option(
    "--markdown", is_flag=True, help="As Markdown with a YAML head, as the Hugging Face Hub has it."
)
@click.option("-o", "--out", type=OutputFile(), help="File to write.")
@json_option
def card(model: str, markdown: bool, out: Path | None, as_json: bool) -> None:
    """Show the training and the performance of MODEL.

    MODEL is a file, or the name of an included model.
    """
    from modalmotion.classification import card_markdown
    from modalmotion.store import write_atomic

    if markdown and as_json:
        raise click.UsageError("--markdown and --json exclude each other.")
    stored = model_named(model)
    if markdown:
        file = model if Path(model).is_file() else None
        text = card_markdown(stored.name, stored.id, stored.card, file=file)
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
    CorruptFileError
        If it is damaged.
    """
    from modalmotion.classification import load_model

    path = Path(which)
    return load_model(path if path.is_file() else which)
