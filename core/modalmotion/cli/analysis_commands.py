"""Commands that look at one sequence: signature and reconstruct."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from modalmotion.cli.files import read, sequence_argument
from modalmotion.cli.options import (
    Command,
    components_option,
    deviations_option,
    example,
    json_option,
    kind_option,
    list_written,
    merge_option,
    mode_options,
    output_option,
    plot_option,
    reference_option,
    rotation_option,
    signature_parameters,
    surface_options,
    tell,
    volumes_option,
    weights_option,
)
from modalmotion.cli.outputs import write_picture
from modalmotion.cli.waiting import Waiting
from modalmotion.errors import TopologyError
from modalmotion.exports.surfaces import SUFFIXES, write_superposed
from modalmotion.facts import facts_as_json
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.numerals import counted, numeral
from modalmotion.signature.making import ModalSignature, SignatureKind, modal_signature
from modalmotion.tradeoff import Price, price_of


@click.command(cls=Command, epilog=example("signature beat.npz --modes 18 --plot beat.png"))
@sequence_argument
@output_option("HDF5 file to write.", required=False)
@mode_options
@surface_options
@reference_option
@weights_option
@merge_option
@components_option
@kind_option
@rotation_option
@volumes_option
@deviations_option
@plot_option
@json_option
def signature(
    source: Path, output: Path | None, plot: Path | None, as_json: bool, **options: Any
) -> None:
    """Fit the modal signature of the sequence in FILE.

    FILE is a file of any known format, a folder of frames, or a pattern of their
    names such as 'scan_*.ply'.
    """
    from modalmotion.store import signature_to_hdf5, write_atomic

    parameters = signature_parameters(options)
    with Waiting(source) as waiting:
        watch, volume = waiting.watch, []
        with watch.stage("read"):
            sequence = read(source, **options)
        result = modal_signature(sequence, parameters, watch=watch)
        if not as_json:
            with watch.stage("volume"):
                volume = _volume_lines(result, sequence)
        if output is not None:
            with watch.stage("write"):
                write_atomic(output, signature_to_hdf5(result))
        if plot is not None:
            with watch.stage("picture"):
                from modalmotion.pictures.signature import signature_figure

                write_picture(signature_figure(sequence, result), plot)
    price = price_of(result, waiting.milliseconds())
    if as_json:
        click.echo(json.dumps(summary(result, price), indent=2))
    else:
        click.echo("\n".join([_lines(result, price), *volume]))
    list_written(output, plot, as_json=as_json)


@click.command(cls=Command, epilog=example("reconstruct beat.npz -o beat.glb --modes 7"))
@sequence_argument
@output_option("File to write: .npz, .vtkhdf, .glb or .zip (of PLY).", *SUFFIXES)
@mode_options
@surface_options
@merge_option
@click.option(
    "--max-targets", type=int, help="Of a GLB: largest number of morph targets, by energy."
)
@json_option
def reconstruct(
    source: Path, output: Path, max_targets: int | None, as_json: bool, **options: Any
) -> None:
    """Write the surfaces that a few modes of the sequence in FILE stand for."""
    from modalmotion.store import write_atomic

    kind = SUFFIXES[output.suffix.lower()]
    parameters = signature_parameters(options)
    with Waiting(source) as waiting:
        with waiting.watch.stage("read"):
            sequence = read(source, **options)
        result = modal_signature(sequence, parameters, watch=waiting.watch)
        with waiting.watch.stage("write"):
            write_atomic(output, write_superposed(result, sequence, kind, max_targets=max_targets))
    motion = float(result.motion_rms.max())
    said = (
        f"{counted(result.n_frames, 'frame')}, error {numeral(result.rms_error, of=motion)} "
        f"{result.unit or 'length units'} RMS"
    )
    found = {"n_frames": result.n_frames, "rms_error": result.rms_error, "unit": result.unit}
    tell(found, [said], output, as_json=as_json)


def _volume_lines(signature: ModalSignature, sequence: MeshSequence) -> list[str]:
    """Write the volume and its share; nothing if the surface encloses nothing."""
    from modalmotion.clinical import clinical_readouts

    try:
        readouts = clinical_readouts(signature, sequence)
    except TopologyError:
        return []
    curve, factor = readouts.stated, readouts.shown_in
    large, small = curve.end_diastolic_volume * factor, curve.end_systolic_volume * factor
    lines = [f"volume {numeral(large, 1)} to {numeral(small, 1, of=large)} {readouts.volume_unit}"]
    if curve.fraction is not None and curve.share_range is not None:
        low, high = curve.share_range
        lines.append(f"{curve.fraction.words} {curve.share:.1f} % ({low:.1f} to {high:.1f})")
    return lines + [f"note: {note}" for note in readouts.notes if signature.n_frames > 1]


def summary(result: ModalSignature, price: Price) -> dict[str, object]:
    """Return the summary numbers of a signature."""
    return {
        "topology": result.surface,
        "n_frames": result.n_frames,
        "n_vertices": result.n_vertices,
        "modes": len(result.modes),
        "kind": result.kind.value,
        "amplitudes_per_frame": result.n_amplitudes,
        "unit": result.unit,
        "facts": facts_as_json(result.facts),
        "rms_error": result.rms_error,
        "weighted_rms_error": result.weighted_rms_error,
        "p95_error": float(result.p95_errors.max()),
        "max_error": result.max_error,
        "motion_rms": float(result.motion_rms.max()),
        "weighted_motion_rms": float(result.weighted_motion_rms.max()),
        "deviation_share": result.deviation_share,
        "compression": result.compression,
        "compression_of_sequence": result.compression_of_sequence,
        "condition": result.condition,
        "deformation_spectrum": result.deformation_spectrum.tolist(),
        "labels": [str(label) for label in result.modes.labels],
        "times": None if result.times is None else result.times.tolist(),
        "amplitudes": result.amplitudes.tolist(),
        "price": asdict(price),
        "choice": None if result.choice is None else result.choice.as_json(),
        "sequence_id": result.sequence_id,
        "notes": list(result.notes),
    }


def _lines(result: ModalSignature, price: Price) -> str:
    unit = result.unit or "length units"
    motion = float(result.motion_rms.max())
    lines = [
        (
            f"{result.surface}, {counted(result.n_frames, 'frame')}, "
            f"{counted(result.n_vertices, 'vertex', 'vertices')}"
        ),
        *([f"facts: {repr(result.facts)[6:-1]}"] if result.facts.stated else []),
        _amount(result),
        (
            f"compression {result.compression:.0f}:1 a frame, "
            f"{result.compression_of_sequence:.1f}:1 with the reference"
        ),
        f"motion {numeral(motion)} {unit} RMS in the frame that moves most",
        (
            f"error {numeral(result.rms_error, of=motion)} {unit} RMS over all vertices and frames "
            f"({numeral(result.weighted_rms_error, of=motion)} weighted); "
            f"in the worst frame {numeral(float(result.p95_errors.max()), of=motion)} (p95) and "
            f"{numeral(result.max_error, of=motion)} (max)"
        ),
        *_deviation_lines(result),
        *price_lines(price),
        "deformation spectrum:",
    ]
    spectrum = result.deformation_spectrum
    largest = max(float(spectrum.max()), 1e-300)
    for label, value in zip(result.modes.labels[:20], spectrum, strict=False):
        bar = "#" * round(30 * float(value) / largest)
        lines.append(f"  {label!s:>14} {numeral(float(value), of=motion):>9}  {bar}")
    if len(spectrum) > 20:
        lines.append(f"  ... and {len(spectrum) - 20} more")
    return "\n".join(lines + [f"note: {note}" for note in result.notes])


def _amount(result: ModalSignature) -> str:
    count = counted(len(result.modes), "mode")
    if result.kind == SignatureKind.OFFSET:
        return f"{count} = {result.n_amplitudes} offsets a frame"
    return f"{count} x 3 directions = {result.n_amplitudes} amplitudes a frame"


def _deviation_lines(result: ModalSignature) -> list[str]:
    deviations, share = result.amplitude_deviations, result.deviation_share
    if deviations is None or share is None:
        return []
    largest = numeral(float(deviations.max(initial=0.0)))
    unit = result.unit or "length units"
    return [f"standard deviations of the amplitudes up to {largest} {unit}, {share:.1%} of them"]


def price_lines(price: Price) -> list[str]:
    """Write the price of a description."""
    times = ", ".join(f"{name} {spent:.1f} ms" for name, spent in price.milliseconds.items())
    lines = [
        (
            f"{price.numbers} numbers: {price.bytes} bytes as float64, {price.bytes_float32} as "
            f"float32; condition {price.condition:.3g}"
        )
    ]
    total = sum(price.milliseconds.values()) / 1e3
    return [*lines, f"time: {times}; {total:.1f} s in all"] if times else lines
