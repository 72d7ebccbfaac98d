"""Commands of modal signatures: fit, reconstruct, resample, and the trade-off of their size."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import click

from modalmotion.cli.files import Waiting, fitted, read, sequence_argument
from modalmotion.cli.options import (
    PICTURES,
    command,
    fit_options,
    json_option,
    mode_options,
    options_of,
    output_option,
    picture_option,
    plot_option,
    signature_parameters,
    surface_options,
    tell,
    verbose_option,
    write_picture,
)
from modalmotion.errors import TopologyError
from modalmotion.exports.signature_pack import (
    SUFFIXES,
    SurfaceFormat,
    write_superposed,
    write_surfaces,
)
from modalmotion.mesh import facts_as_json
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.representation import counted, numeral, with_article
from modalmotion.signature import (
    MOST_OF_FRONT,
    Price,
    Tradeoff,
    measure_tradeoff,
    price_of,
    reconstruction,
)
from modalmotion.signature.making import ModalSignature, SignatureKind
from modalmotion.signature.parameters import SignatureParameters
from modalmotion.signature.tradeoff import as_plain
from modalmotion.store import write_atomic
from modalmotion.template.body_frame import Components


@command("signature beat.npz --modes 18 -o beat.h5 --plot beat.png")
@sequence_argument
@output_option(
    "File to write: .h5, a table (.csv), .html, or a picture.",
    *(".h5", ".csv", ".html", *PICTURES),
    required=False,
)
@plot_option
@json_option
@verbose_option
@fit_options
def signature(
    source: Path,
    output: Path | None,
    plot: Path | None,
    as_json: bool,
    verbose: bool,
    **options: Any,
) -> None:
    """Fit the modal signature of the sequence in FILE.

    FILE is a file of any known format, a folder of frames, or a pattern of their
    names such as 'scan_*.ply'.
    """
    with Waiting(source) as waiting:
        watch, volume = waiting.watch, []
        sequence, result = fitted(source, waiting, options)
        if not as_json:
            with watch.stage("volume"):
                volume = _volume_lines(result, sequence)
        for path in filter(None, (output, plot)):
            with watch.stage("picture" if path.suffix.lower() in PICTURES else "write"):
                _write(path, sequence, result)
    price = price_of(result, waiting.milliseconds())
    lines = [*_lines(result), *(price_lines(price) if verbose else []), *volume]
    lines += [f"note: {note}" for note in result.notes]
    tell(summary(result, price), lines, output, plot, as_json=as_json)


def _write(path: Path, sequence: MeshSequence, result: ModalSignature) -> None:
    if path.suffix.lower() in PICTURES:
        from modalmotion.pictures.signature import signature_figure

        write_picture(signature_figure(sequence, result), path)
    elif path.suffix.lower() == ".h5":
        from modalmotion.store import signature_to_hdf5, write_atomic

        write_atomic(path, signature_to_hdf5(result))
    else:
        result.save(path)


@command("reconstruct beat.npz -o beat.glb --modes 7")
@sequence_argument
@output_option("File to write: .npz, .vtkhdf, .glb or .zip (of PLY).", *SUFFIXES)
@click.option(
    "--max-targets", type=int, help="For GLB: largest number of morph targets, by energy."
)
@json_option
@fit_options
def reconstruct(
    source: Path, output: Path, max_targets: int | None, as_json: bool, **options: Any
) -> None:
    """Write the surfaces superposed from a few modes of the sequence in FILE."""
    from modalmotion.store import write_atomic

    kind = SUFFIXES[output.suffix.lower()]
    with Waiting(source) as waiting:
        sequence, result = fitted(source, waiting, options)
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
    """Print volume and ejection fraction; nothing if the surface encloses nothing."""
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


def _lines(result: ModalSignature) -> list[str]:
    unit = result.unit or "length units"
    motion = float(result.motion_rms.max())
    lines = [
        (
            f"{result.surface}, {counted(result.n_frames, 'frame')}, "
            f"{counted(result.n_vertices, 'vertex', 'vertices')}"
        ),
        *([f"facts: {repr(result.facts)[6:-1]}"] if result.facts.stated else []),
        _amount(result),
        f"motion {numeral(motion)} {unit} RMS in the frame with most motion",
        (
            f"error {numeral(result.rms_error, of=motion)} {unit} RMS over all vertices and frames "
            f"({numeral(result.weighted_rms_error, of=motion)} weighted); "
            f"in the worst frame {numeral(float(result.p95_errors.max()), of=motion)} (p95) and "
            f"{numeral(result.max_error, of=motion)} (max)"
        ),
        *_deviation_lines(result),
        "deformation spectrum:",
    ]
    spectrum = result.deformation_spectrum
    largest = max(float(spectrum.max()), 1e-300)
    for label, value in zip(result.modes.labels[:20], spectrum, strict=False):
        bar = "#" * round(30 * float(value) / largest)
        lines.append(f"  {label!s:>14} {numeral(float(value), of=motion):>9}  {bar}")
    return lines + ([f"  ... and {len(spectrum) - 20} more"] if len(spectrum) > 20 else [])


def _amount(result: ModalSignature) -> str:
    count = counted(len(result.modes), "mode")
    if result.kind == SignatureKind.OFFSET:
        return f"{count} = {result.n_amplitudes} offsets per frame"
    return f"{count} x 3 directions = {result.n_amplitudes} amplitudes per frame"


def _deviation_lines(result: ModalSignature) -> list[str]:
    deviations, share = result.amplitude_deviations, result.deviation_share
    if deviations is None or share is None:
        return []
    largest = numeral(float(deviations.max(initial=0.0)))
    unit = result.unit or "length units"
    return [f"standard deviations of the amplitudes up to {largest} {unit}, {share:.1%} of them"]


def price_lines(price: Price) -> list[str]:
    """Write the sizes and times of a description."""
    times = ", ".join(f"{name} {spent:.1f} ms" for name, spent in price.milliseconds.items())
    total = sum(price.milliseconds.values()) / 1e3
    return [
        (
            f"{price.numbers} numbers: {price.bytes} bytes as float64, {price.bytes_float32} as "
            f"float32; compression {price.compression:.1f}:1; condition {price.condition:.3g}"
        ),
        *([f"time: {times}; {total:.1f} s in all"] if times else []),
    ]


_SUFFIXES = {suffix: kind for suffix, kind in SUFFIXES.items() if kind != SurfaceFormat.GLB}


@command("resample beat.npz --phase 0.37 -o systole.npz")
@sequence_argument
@output_option("File to write: .npz, .vtkhdf or .zip (of PLY).", *_SUFFIXES)
@click.option("--phase", "phases", type=float, multiple=True, help="Share of the cycle, 0 to 1.")
@click.option("--frames", type=click.IntRange(2), help="Instead of phases: number of even steps.")
@json_option
def resample(
    source: Path,
    output: Path,
    phases: tuple[float, ...],
    frames: int | None,
    as_json: bool,
    **options: Any,
) -> None:
    """Write the surface in FILE at any phase of its cycle, with its deviation."""
    if bool(phases) == (frames is not None):
        raise click.UsageError("Give one of --phase and --frames.")
    with Waiting(source) as waiting:
        with waiting.watch.stage("read"):
            sequence = read(source, **options)
        with waiting.watch.stage("resample"):
            result = reconstruction.resample(
                sequence, frames if frames is not None else sorted(phases)
            )
        with waiting.watch.stage("write"):
            kind = _SUFFIXES[output.suffix.lower()]
            fields = {"deviation": result.deviations} if kind == SurfaceFormat.VTKHDF else None
            write_atomic(output, write_surfaces(result.sequence, kind, fields))
    found = {
        "phases": result.phases.tolist(),
        "rms_deviations": result.rms_deviations.tolist(),
        "course": result.course,
        "unit": sequence.unit,
    }
    said = [
        f"{counted(len(result.phases), 'frame')}, {result.course} in time",
        reconstruction.note_on(result),
    ]
    tell(found, said, output, as_json=as_json)


@command("tradeoff beat.npz --tolerance 1 -o tradeoff.png")
@sequence_argument
@options_of(
    SignatureParameters,
    "components",
    components={"default": None, "help": "The only components measured; all by default."},
)
@click.option(
    "--front-modes",
    type=click.IntRange(1, 2000),
    default=MOST_OF_FRONT,
    show_default=True,
    help="Largest number of modes on the front.",
)
@picture_option
@json_option
@verbose_option
@mode_options
@surface_options
def tradeoff(
    source: Path,
    components: Components | None,
    front_modes: int,
    plot: Path | None,
    as_json: bool,
    verbose: bool,
    **options: Any,
) -> None:
    """Measure error, size and time of each number of modes for the sequence in FILE.

    Choose a point of the front by --modes, --tolerance or --auto.
    """
    parameters = signature_parameters(options)
    with Waiting(source) as waiting:
        with waiting.watch.stage("read"):
            sequence = read(source, **options)
        result = measure_tradeoff(
            sequence,
            replace(parameters, components=components or Components.CARTESIAN),
            most_modes=front_modes,
            components=None if components is None else (components,),
            watch=waiting.watch,
        )
        if plot is not None:
            with waiting.watch.stage("picture"):
                from modalmotion.pictures.tradeoff import tradeoff_figure

                write_picture(tradeoff_figure(result), plot)
    price = replace(result.chosen.price, milliseconds=waiting.milliseconds())
    result = replace(result, chosen=replace(result.chosen, price=price))
    tell(as_plain(result), _lines_of_tradeoff(result, verbose), plot, as_json=as_json)


def _lines_of_tradeoff(result: Tradeoff, verbose: bool) -> list[str]:
    front, price = result.front, result.chosen.price
    unit, motion = front.unit or "length units", front.motion_rms
    lines = [
        (
            f"{counted(front.n_frames, 'frame')}, "
            f"{counted(front.n_vertices, 'vertex', 'vertices')}, "
            f"motion {numeral(motion)} {unit} RMS"
        )
    ]
    for branch in front.branches:
        shown = [k for k, n in enumerate(branch.counts) if n in (1, 7, 18, 37, branch.counts[-1])]
        errors = ", ".join(
            f"{branch.counts[k]}: {numeral(float(branch.rms[k]), of=motion)}" for k in shown
        )
        lines.append(f"{branch.topology}, {branch.components}: RMS by modes {errors}")
    for kind, error in result.scene.items():
        text = (
            f"{numeral(error.rms, of=motion)} {unit} RMS, {numeral(error.max, of=motion)} at most"
        )
        lines.append(f"as {with_article(kind)} motion: {text}")
    if result.noise is not None:
        lines.append(result.noise.note(front.unit))
    lines.append(f"chosen: {describe(result)}")
    lines.append(
        f"error {numeral(price.rms_error, of=motion)} {unit} RMS "
        f"({numeral(price.weighted_rms_error, of=motion)} weighted), "
        f"{numeral(price.p95_error, of=motion)} (p95) and "
        f"{numeral(price.max_error, of=motion)} (max) in the worst frame"
    )
    lines += price_lines(price) if verbose else []
    lines += [f"note: {note}" for note in result.chosen.signature.notes]
    return lines + [f"note: {note}" for note in result.chosen.notes]


def describe(result: Tradeoff) -> str:
    """Describe the choice in a line."""
    price, signature = result.chosen.price, result.chosen.signature
    count = counted(len(signature.modes), "mode")
    text = f"{count}, {signature.surface}, {signature.parameters.components}"
    harmonics = signature.parameters.harmonics
    if harmonics is not None:
        text += f", {counted(harmonics, 'harmonic')}"
    return f"{text}: {price.amplitudes_per_frame} amplitudes per frame"
