"""Commands of models: train, evaluate, classify, and tables of features."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import click

from modalmotion import store
from modalmotion.classification.manifest import LabelledSequence, labelled_files
from modalmotion.classification.options import OnError, TrainingOptions
from modalmotion.cli import shared
from modalmotion.cli.files import counting, read, sequence_argument
from modalmotion.representation import numeral, plain, probability

if TYPE_CHECKING:
    from modalmotion.classification import Classification, Model
    from modalmotion.classification.cases import LeftOut


_OF_TRAINING: Final = (
    *("modes", "topology", "kind", "timing", "folds", "repetitions", "groups", "seed"),
)


@shared.command("evaluate mine.h5 others.csv")
@click.argument("model", metavar="MODEL")
@shared.labelled_sources
def evaluate(
    model: str,
    sources: tuple[Path, ...],
    skip_unreadable: bool,
    unit: str | None = None,
    coverage: shared.Coverage = 0.9,
    plot: shared.Plot = None,
    cases_file: shared.Cases = None,
) -> Any:
    """Test MODEL, a file or a name, on labelled sequences that it was not trained on.

    MANIFEST and FILES are as for training. The interval of the accuracy counts sequences of one
    subject as fewer than they are.

    Parameters
    ----------
    unit
        Length unit of all files; overrides their own.
    coverage
        Probability that the class set contains the true class.
    plot
        Picture to write (.png, .svg, .pdf).
    cases_file
        Table to write: probabilities of each case, held out (.csv).
    """
    from modalmotion.classification import evaluate as test
    from modalmotion.classification.cases import left_out_notes

    files = labelled_files(sources, skip_unreadable=skip_unreadable)
    cases = [LabelledSequence(file, {"unit": unit}) for file in files]
    left_out: list[LeftOut] | None = [] if skip_unreadable else None
    with counting("cases") as show:
        result = test(model_named(model), cases, coverage, progress=show, left_out=left_out)
    notes = list(left_out_notes(left_out or ()))
    if plot is not None:
        from modalmotion.pictures.classification import evaluation_figure

        shared.write_picture(evaluation_figure(result), plot)
    if cases_file is not None:
        store.write_atomic(cases_file, result.as_csv().encode())
    answer = plain(result)
    said = {**answer, "cases": None, "confusion": _confusion(result.classes, result.confusion)}
    return {**answer, "left_out": notes}, shared.described({**said, "left_out": notes})


@shared.command("classify beat.npz --model mine.h5")
@sequence_argument
@shared.surface_options
def classify(
    source: Path,
    model: str = "ventricle-simulated",
    coverage: shared.Coverage = 0.9,
    plot: shared.Plot = None,
    **stated: Any,
) -> Any:
    """Classify the motion of the sequence in FILE.

    Parameters
    ----------
    model
        Model: the name of an included one, or a file. The default reads displacements if
        the file states tracking=material, the surface's normal displacements otherwise.
    coverage
        Probability that the class set contains the true class.
    plot
        Picture to write (.png, .svg, .pdf).
    """
    from modalmotion.classification import classify as ask
    from modalmotion.classification import shipped_for
    from modalmotion.mesh.sequence import MeshSequence
    from modalmotion.modes.topologies import MESH
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

        shared.write_picture(answer_figure(result), plot)
    named = ("sequence_id", "model", "model_id", "label", "class_set", "coverage", "flags", "notes")
    answer = shared.members(result, *named, "explanation")
    answer["probabilities"] = dict(zip(result.classes, result.probabilities.tolist(), strict=True))
    return answer, _answer_lines(result)


@shared.command("card mine.h5 --markdown -o README.md")
@click.argument("model")
def card(
    model: str, markdown: bool = False, out: Annotated[Path | None, shared.OutputFile()] = None
) -> Any:
    """Show the training and the performance of MODEL.

    MODEL is a file, or the name of an included model.

    Parameters
    ----------
    markdown
        With the YAML head that the Hugging Face Hub reads.
    out
        File to write.
    """
    from modalmotion.classification import card_markdown

    stored = model_named(model)
    text = card_markdown(stored.name, stored.id, stored.card, head=markdown)
    if out is not None:
        store.write_atomic(out, text.encode())
    return stored.card.as_json(), [text.rstrip()] if out is None else []


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


@shared.command("features cases.csv -o features.csv --covariate age")
@shared.labelled_sources
def features(
    sources: tuple[Path, ...],
    skip_unreadable: bool,
    out: Annotated[Path, shared.OutputFile(".csv")],
    modes: int = 7,
    topology: str | None = None,
    kind: Literal["auto", "axis", "summary", "modes", "terms"] = "auto",
    timing: Literal["auto", "cycle", "transient"] = "auto",
    covariates: Annotated[tuple[str, ...], {"flag": "covariate", "metavar": "NAME"}] = (),
) -> Any:
    """Write the features of labelled or unlabelled sequences as a table.

    MANIFEST is a table (.csv) with the column path and, if known, label, subject and covariates; or
    name files. Each row of the result is a sequence: its file, id, label and subject, then the
    features, which do not depend on pose, unit, start or sampling.

    Parameters
    ----------
    out
        Table to write (.csv).
    modes
        Modes of the signatures; 3 amplitudes per frame each.
    topology
        cup, sphere, ..., or mesh for spring modes; found from all cases by default.
    kind
        axis: parts about the axis; modes: modes and their products; summary: the same in
        few numbers; terms: modes and their terms, of a transient.
    timing
        cycle: one period of a cycle; transient: a movement with a beginning and an end.
    covariates
        Column of the manifest to add; repeat for more. all: every one, long lists of words
        apart.
    """
    from modalmotion.classification import SignatureFeatures, feature_table
    from modalmotion.classification.cases import left_out_notes

    wanted: Any = "all" if "all" in covariates else list(covariates) or None
    transformer = SignatureFeatures(
        covariates=wanted, modes=modes, topology=topology, kind=kind, timing=timing
    )
    files = labelled_files(sources, skip_unreadable=skip_unreadable, needs_label=False)
    with counting("cases") as show:
        table = feature_table(
            [LabelledSequence(file, {}) for file in files],
            transformer,
            on_error="leave out" if skip_unreadable else "raise",
            progress=show,
        )
    store.write_atomic(out, table.as_csv().encode())
    n, m = table.values.shape
    notes = list(left_out_notes(table.left_out))
    reads = transformer.extractor_.description
    return {"n_cases": n, "n_features": m, "reads": reads, "notes": notes}


@shared.command("train cases.csv --name mine -o mine.h5")
@shared.labelled_sources
@shared.options_of(TrainingOptions, *_OF_TRAINING)
def train(
    sources: tuple[Path, ...],
    skip_unreadable: bool,
    name: str,
    out: Annotated[Path, shared.OutputFile()],
    unit: str | None = None,
    plot: shared.Plot = None,
    cases_file: shared.Cases = None,
    **options: Any,
) -> Any:
    """Train a model on labelled sequences.

    MANIFEST is a table (.csv) with the columns path, label and, if known, subject: sequences of one
    subject are never on both sides of a split. Further columns (age, sex, ...) are covariates. Or
    name files, each in a folder named after its class: normal/*.npz akinesia/*.npz

    Parameters
    ----------
    name
        Name of the model: lower-case letters, digits, . _ -
    out
        File to write (HDF5).
    unit
        Length unit of all files; overrides their own.
    plot
        Picture to write (.png, .svg, .pdf).
    cases_file
        Table to write: probabilities of each case, held out (.csv).
    """
    from modalmotion.classification import card_markdown
    from modalmotion.classification import train as fit

    store.require_model_name(name)
    on_error = OnError.LEAVE_OUT if skip_unreadable else OnError.RAISE
    training_options = TrainingOptions.from_json({**options, "on_error": on_error})
    files = labelled_files(sources, skip_unreadable=skip_unreadable)
    with counting("training") as show:
        cases = [LabelledSequence(file, {"unit": unit}) for file in files]
        model = fit(cases, name, training_options, show)
    store.write_atomic(out, store.model_to_hdf5(model))
    if plot is not None:
        from modalmotion.pictures.classification import card_figure

        shared.write_picture(card_figure(model.card, name), plot)
    said = [card_markdown(model.name, model.id, model.card)]
    if cases_file is not None and model.cross_validation is not None:
        store.write_atomic(cases_file, model.cross_validation.as_csv().encode())
    elif cases_file is not None:
        said.append("note: without a cross-validation there is no table of held-out cases")
        cases_file = None
    written = [path for path in (out, plot, cases_file) if path is not None]
    answer = {"name": model.name, "id": model.id, "card": model.card.as_json()}
    return {**answer, "written": written}, said


def _confusion(
    classes: tuple[str, ...], counts: tuple[tuple[int, ...], ...]
) -> list[dict[str, object]]:
    """Give the rows of a table of answers by true class."""
    answers = [*classes, "no class"]
    return [
        {"true class": label, **dict(zip(answers, row, strict=False))}
        for label, row in zip(classes, counts, strict=False)
    ]


def _answer_lines(result: Classification) -> Iterator[str]:
    """Write a model's answer for a sequence."""
    if result.label is None:
        yield f"{result.model}: no class"
    else:
        yield f"{result.model}: {result.label}, probability {probability(result.probability)}"
    yield from (f"flag: {flag}" for flag in result.flags)
    # Equal probabilities are not a measurement.
    if result.label is not None:
        shares = dict(zip(result.classes, result.probabilities.tolist(), strict=True))
        for name, share in sorted(shares.items(), key=lambda item: -item[1]):
            mark = "*" if name in result.class_set else " "
            yield f"  {probability(share):>6} {mark} {name}"
        if result.class_set:
            yield f"* cannot be excluded at {100 * result.coverage:g} %"
    for part in result.explanation[:5]:
        unit = part.unit or "length unit"
        size = f"{numeral(part.amplitude):>8} {unit}, {part.per_unit:+.2f} per {unit}"
        yield f"  {part.score:+7.2f}  {size}  {' '.join(part.modes)}"
    yield from (f"note: {note}" for note in result.notes)
