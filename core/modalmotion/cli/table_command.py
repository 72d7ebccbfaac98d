"""Command that writes a table of a sequence: amplitudes, or what is known of each frame."""

from __future__ import annotations

import contextlib
import sys
from pathlib import Path
from typing import Any

import click

from modalmotion.classification.cases import named
from modalmotion.classification.manifest import LabelledFile, labelled_files
from modalmotion.cli.files import fitted, sequence_argument
from modalmotion.cli.options import (
    command,
    fit_options,
    list_written,
    output_option,
    signature_parameters,
)
from modalmotion.cli.stated_facts import stated_facts
from modalmotion.cli.waiting import Waiting
from modalmotion.clinical import ClinicalReadouts, clinical_readouts
from modalmotion.clinical.ventricle import VentricleReadouts, ventricle_readouts
from modalmotion.errors import InputError, ModalMotionError, ParameterError
from modalmotion.exports.tables import Recording, Table, amplitude_table, cohort_table, frame_table
from modalmotion.formats import ReadOptions
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.signature.making import ModalSignature, SignatureParameters, modal_signature
from modalmotion.tracking.recording import sequence_of


@command("table beat.npz --frames -o frames.csv")
@sequence_argument
@output_option("CSV file to write; printed by default.", ".csv", required=False)
@click.option(
    "--frames",
    is_flag=True,
    help="One row per frame instead of per amplitude: motion and error, volume in ml, inward "
    "motion of each segment and strain in percent.",
)
@click.option(
    "--skip-unreadable",
    is_flag=True,
    help="For a manifest: continue without recordings that cannot be used; they are named.",
)
@fit_options
def table(
    source: Path, output: Path | None, frames: bool, skip_unreadable: bool, **options: Any
) -> None:
    """Write amplitudes of the sequence in FILE as CSV: a row for each frame, mode and direction.

    Where FILE is a manifest (.csv, with the column path and, where they are known, label, subject
    and facts), each of its recordings has a row: errors, volumes, ejection fraction, amplitudes.
    """
    if source.suffix.lower() in (".csv", ".tsv"):
        if frames:
            raise click.UsageError("--frames is for one sequence, and not for a manifest.")
        parameters = signature_parameters(options)
        _write(_cohort(source, parameters, skip_unreadable, options).to_csv(), output)
        return
    with Waiting(source) as waiting:
        sequence, signature = fitted(source, waiting, options)
        with waiting.watch.stage("table"):
            made = _frames(signature, sequence) if frames else amplitude_table(signature)
            text = made.to_csv()
    _write(text, output)


def _write(text: str, output: Path | None) -> None:
    from modalmotion.store import write_atomic

    if output is None:
        click.echo(text, nl=False)
    else:
        write_atomic(output, text.encode())
        list_written(output)


def _cohort(
    manifest: Path, parameters: SignatureParameters, skips: bool, stated: dict[str, Any]
) -> Table:
    """Tabulate the recordings of a manifest; those that are left out are named."""
    files = labelled_files([manifest], skip_unreadable=skips, needs_label=False)
    made = []
    with click.progressbar(files, label="recordings", file=sys.stderr) as bar:
        for file in bar:
            try:
                made.append(_recording(file, parameters, {**stated}))
            except ModalMotionError as error:
                if not skips:
                    raise named(error, str(file.path)) from error
                click.echo(f"left out: {file.path}: {error}", err=True)
    if not made:
        raise ParameterError(
            f"No recording of '{manifest}' can be tabulated.",
            remedy="Name files that can be read in its column path.",
        )
    return cohort_table(made)


def _recording(
    file: LabelledFile, parameters: SignatureParameters, stated: dict[str, Any]
) -> Recording:
    options = ReadOptions(facts=stated_facts(stated).over(file.facts), **stated)
    sequence = sequence_of(file.path, options)
    signature = modal_signature(sequence, parameters)
    readouts: ClinicalReadouts | None = None
    with contextlib.suppress(InputError):
        readouts = clinical_readouts(signature, sequence)
    return Recording(str(file.path), signature, readouts, file.subject, file.label or None)


def _frames(signature: ModalSignature, sequence: MeshSequence) -> Table:
    """Tabulate frames, with all that this surface has."""
    readouts: ClinicalReadouts | None = None
    ventricle: VentricleReadouts | None = None
    try:
        readouts = clinical_readouts(signature, sequence)
    except InputError as error:
        click.echo(f"note: {error}", err=True)
    else:
        ventricle = ventricle_readouts(signature, sequence, readouts)
        for reason in ventricle.reasons:
            click.echo(f"note: {reason}", err=True)
    return frame_table(signature, readouts, ventricle)
