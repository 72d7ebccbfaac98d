"""The command that writes the features of a cohort as a table."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, Final

import click

from modalmotion.classification.manifest import LabelledSequence, labelled_files
from modalmotion.cli.case_options import labelled_sources
from modalmotion.cli.options import command, json_option, tell
from modalmotion.cli.outputs import OutputFile

_HELP: Final = {
    "modes": "Modes of the signatures; 3 amplitudes per frame each.",
    "topology": "cup, sphere, ..., or mesh for spring modes; found from all cases by default.",
    "kind": "axis: parts about the axis; modes: modes and their products; summary: the same "
    "in few numbers; terms: modes and their terms.",
    "timing": "cycle: one turn of a cycle; transient: a movement with a beginning and an end.",
}


@command("features cases.csv -o features.csv --covariate age")
@labelled_sources
@click.option("-o", "--out", required=True, type=OutputFile(".csv"), help="Table to write (.csv).")
@click.option("--modes", type=int, default=7, show_default=True, help=_HELP["modes"])
@click.option("--topology", help=_HELP["topology"])
@click.option(
    "--kind",
    type=click.Choice(["auto", "axis", "summary", "modes", "terms"]),
    default="auto",
    show_default=True,
    help=_HELP["kind"],
)
@click.option(
    "--timing",
    type=click.Choice(["auto", "cycle", "transient"]),
    default="auto",
    show_default=True,
    help=_HELP["timing"],
)
@click.option(
    "--covariate",
    "covariates",
    multiple=True,
    metavar="NAME",
    help="Column of the manifest to add; repeat for more. all: every one, long lists of words "
    "apart.",
)
@json_option
def features(
    sources: tuple[Path, ...],
    out: Path,
    skip_unreadable: bool,
    covariates: tuple[str, ...],
    as_json: bool,
    **options: Any,
) -> None:
    """Write the features of labelled or unlabelled sequences as a table.

    MANIFEST is a table (.csv) with the column path and, if known, label, subject and covariates; or
    name files. Each row of the result is a sequence: its file, id, label and subject, then the
    features, which do not depend on pose, unit, start or sampling.
    """
    from modalmotion.classification import SignatureFeatures, feature_table
    from modalmotion.classification.cases import left_out_notes
    from modalmotion.store import write_atomic

    wanted: Any = "all" if "all" in covariates else list(covariates) or None
    transformer = SignatureFeatures(covariates=wanted, **options)
    files = labelled_files(sources, skip_unreadable=skip_unreadable, needs_label=False)
    with click.progressbar(length=len(files), label="cases", file=sys.stderr) as bar:
        table = feature_table(
            [LabelledSequence(file, {}) for file in files],
            transformer,
            on_error="leave out" if skip_unreadable else "raise",
            progress=lambda done: bar.update(done - bar.pos),
        )
    write_atomic(out, table.as_csv().encode())
    n, m = table.values.shape
    said = (
        f"{n} sequences, {m} features: {transformer.extractor_.description}; "
        f"{transformer.readable_.topology}, {transformer.readable_.n_modes} modes"
    )
    notes = list(left_out_notes(table.left_out))
    found = {"n_cases": n, "n_features": m, "reads": transformer.extractor_.description}
    tell({**found, "notes": notes}, [said, *notes], out, as_json=as_json)
