"""Command that writes a table of a sequence: amplitudes, or what is known of each frame."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from modalmotion.cli.files import read, sequence_argument
from modalmotion.cli.options import (
    components_option,
    example,
    kind_option,
    list_written,
    merge_option,
    mode_options,
    output_option,
    reference_option,
    signature_parameters,
    surface_options,
    weights_option,
)
from modalmotion.cli.waiting import Waiting
from modalmotion.clinical import ClinicalReadouts, clinical_readouts
from modalmotion.clinical.ventricle import VentricleReadouts, ventricle_readouts
from modalmotion.errors import InputError
from modalmotion.exports.table import Table, amplitude_table, frame_table
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.signature.making import ModalSignature, modal_signature


@click.command(epilog=example("table beat.npz --frames -o frames.csv"))
@sequence_argument
@output_option("CSV file to write; printed by default.", ".csv", required=False)
@click.option(
    "--frames",
    is_flag=True,
    help="A row a frame in place of a row an amplitude: motion and error, volume in ml, inward "
    "motion of each segment and strain in percent.",
)
@mode_options
@surface_options
@reference_option
@weights_option
@merge_option
@components_option
@kind_option
def table(source: Path, output: Path | None, frames: bool, **options: Any) -> None:
    """Write amplitudes of the sequence in FILE as CSV: a row for each frame, mode and direction."""
    from modalmotion.store import write_atomic

    parameters = signature_parameters(options)
    with Waiting(source) as waiting:
        with waiting.watch.stage("read"):
            sequence = read(source, **options)
        signature = modal_signature(sequence, parameters, watch=waiting.watch)
        with waiting.watch.stage("table"):
            made = _frames(signature, sequence) if frames else amplitude_table(signature)
            text = made.to_csv()
    if output is None:
        click.echo(text, nl=False)
    else:
        write_atomic(output, text.encode())
        list_written(output)


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
