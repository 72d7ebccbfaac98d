"""Commands of modal signatures: fit, reconstruct, and the trade-off of their size."""

from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Any

import click

from modalmotion.cli import shared
from modalmotion.cli.files import Waiting, fitted, read, sequence_argument
from modalmotion.exports.signature_pack import (
    SUFFIXES,
    write_superposed,
)
from modalmotion.mesh import facts_as_json
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.representation import counted, numeral, plain, with_article
from modalmotion.signature import (
    MOST_OF_FRONT,
    Price,
    Tradeoff,
    measure_tradeoff,
    price_of,
)
from modalmotion.signature.making import ModalSignature, SignatureKind
from modalmotion.signature.tradeoff import as_plain
from modalmotion.store import write_atomic
from modalmotion.template.body_frame import Components


@shared.command("signature beat.npz --modes 18 -o beat.h5 --plot beat.png")
@sequence_argument
@shared.fit_options
def signature(
    source: Path,
    output: Annotated[
        Path | None, shared.OutputFile(".h5", ".csv", ".html", *shared.PICTURES)
    ] = None,
    plot: shared.Plot = None,
    **options: Any,
) -> Any:
    """Fit the modal signature of the sequence in FILE.

    FILE is a file of any known format, a folder of frames, or a pattern of their
    names such as 'scan_*.ply'.

    Parameters
    ----------
    output
        File to write: .h5, a table (.csv), .html, or a picture.
    plot
        Picture to write (.png, .svg, .pdf).
    """
    with Waiting(source) as waiting:
        watch = waiting.watch
        sequence, result = fitted(source, waiting, options)
        for path in filter(None, (output, plot)):
            with watch.stage("picture" if path.suffix.lower() in shared.PICTURES else "write"):
                _write(path, sequence, result)
    return summary(result, price_of(result, waiting.milliseconds())), _lines(result)


def _write(path: Path, sequence: MeshSequence, result: ModalSignature) -> None:
    if path.suffix.lower() in shared.PICTURES:
        from modalmotion.pictures.signature import signature_figure

        shared.write_picture(signature_figure(sequence, result), path)
    elif path.suffix.lower() == ".h5":
        # Without the imports of all that can be saved.
        from modalmotion.store import signature_to_hdf5

        write_atomic(path, signature_to_hdf5(result))
    else:
        result.save(path)


@shared.command("reconstruct beat.npz -o beat.glb --modes 7")
@sequence_argument
@shared.fit_options
def reconstruct(
    source: Path,
    output: Annotated[Path, shared.OutputFile(*SUFFIXES)],
    max_targets: int | None = None,
    **options: Any,
) -> Any:
    """Write the surfaces superposed from a few modes of the sequence in FILE.

    Parameters
    ----------
    output
        File to write: .npz, .vtkhdf, .glb or .zip (of PLY).
    max_targets
        For GLB: largest number of morph targets, by energy.
    """
    kind = SUFFIXES[output.suffix.lower()]
    with Waiting(source) as waiting:
        sequence, result = fitted(source, waiting, options)
        with waiting.watch.stage("write"):
            write_atomic(output, write_superposed(result, sequence, kind, max_targets=max_targets))
    return shared.members(result, "n_frames", "rms_error", "unit")


def summary(result: ModalSignature, price: Price) -> dict[str, object]:
    """Return the summary numbers of a signature."""
    largest = ("motion_rms", "weighted_motion_rms")
    return {
        **shared.members(result, "surface as topology", "n_frames", "n_vertices", "kind", "unit"),
        **shared.members(
            result, "n_amplitudes as amplitudes_per_frame", "deviation_share", "condition"
        ),
        **shared.members(result, "rms_error", "weighted_rms_error", "max_error"),
        "p95_error": float(result.p95_errors.max()),
        **{name: float(getattr(result, name).max()) for name in largest},
        **shared.members(result, "compression", "compression_of_sequence", "deformation_spectrum"),
        **shared.members(result, "times", "amplitudes", "sequence_id", "notes"),
        "modes": len(result.modes),
        "labels": [str(label) for label in result.modes.labels],
        "facts": facts_as_json(result.facts),
        "price": asdict(price),
        "choice": plain(result.choice),
    }


def _lines(result: ModalSignature) -> Iterator[str]:
    unit, motion = result.unit or "length units", float(result.motion_rms.max())
    yield (
        f"{result.surface}, {counted(result.n_frames, 'frame')}, "
        f"{counted(result.n_vertices, 'vertex', 'vertices')}"
    )
    if result.facts.stated:
        yield f"facts: {repr(result.facts)[6:-1]}"
    each = "amplitude" if result.kind == SignatureKind.MATERIAL else "normal displacement"
    modes = counted(len(result.modes), "mode")
    yield f"{modes}, {counted(result.n_amplitudes, each)} per frame"
    yield f"motion {numeral(motion)} {unit} RMS in the frame with most motion"
    yield (
        f"error {numeral(result.rms_error, of=motion)} {unit} RMS over all vertices and frames "
        f"({numeral(result.weighted_rms_error, of=motion)} weighted); "
        f"in the worst frame {numeral(float(result.p95_errors.max()), of=motion)} (p95) and "
        f"{numeral(result.max_error, of=motion)} (max)"
    )
    deviations, share = result.amplitude_deviations, result.deviation_share
    if deviations is not None and share is not None:
        largest = numeral(float(deviations.max(initial=0.0)))
        yield f"standard deviations of the amplitudes up to {largest} {unit}, {share:.1%} of them"
    yield "deformation spectrum:"
    spectrum = result.deformation_spectrum
    top = max(float(spectrum.max()), 1e-300)
    for label, value in zip(result.modes.labels[:20], spectrum, strict=False):
        bar = "#" * round(30 * float(value) / top)
        yield f"  {label!s:>14} {numeral(float(value), of=motion):>9}  {bar}"
    if len(spectrum) > 20:
        yield f"  ... and {len(spectrum) - 20} more"
    yield from (f"note: {note}" for note in result.notes)


@shared.command("tradeoff beat.npz --tolerance 1 -o tradeoff.png")
@sequence_argument
@shared.mode_options
@shared.surface_options
def tradeoff(
    source: Path,
    components: Components | None = None,
    front_modes: Annotated[int, click.IntRange(1, 2000)] = MOST_OF_FRONT,
    plot: shared.OnlyPlot = None,
    **options: Any,
) -> Any:
    """Measure error, size and time of each number of modes for the sequence in FILE.

    Choose a point of the front by --modes, --tolerance or --auto.

    Parameters
    ----------
    components
        The only components measured; all by default.
    front_modes
        Largest number of modes on the front.
    plot
        Picture to write (.png, .svg, .pdf).
    """
    parameters = shared.signature_parameters(options)
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
                from modalmotion.pictures.signature import tradeoff_figure

                shared.write_picture(tradeoff_figure(result), plot)
    price = replace(result.chosen.price, milliseconds=waiting.milliseconds())
    result = replace(result, chosen=replace(result.chosen, price=price))
    return as_plain(result), _lines_of_tradeoff(result)


def _lines_of_tradeoff(result: Tradeoff) -> Iterator[str]:
    front, chosen = result.front, result.chosen
    errors: dict[str, object] = {}
    for branch in front.branches:
        shown = [k for k, n in enumerate(branch.counts) if n in (1, 7, 18, 37, branch.counts[-1])]
        errors[f"{branch.topology}, {branch.components}, by modes"] = ", ".join(
            f"{branch.counts[k]}: {numeral(float(branch.rms[k]), of=front.motion_rms)}"
            for k in shown
        )
    for kind, error in result.scene.items():
        errors[f"as {with_article(kind)} motion"] = error.rms
    signature = chosen.signature
    named = ("rms_error", "weighted_rms_error", "p95_error", "max_error", "amplitudes_per_frame")
    notes = [] if result.noise is None else [result.noise.note(front.unit)]
    yield from shared.described(
        {
            **shared.members(front, "n_frames", "n_vertices", "unit", "motion_rms"),
            "rms_errors": errors,
            "chosen": {
                "n_modes": len(signature.modes),
                **shared.members(
                    signature, "surface", "parameters.components", "parameters.harmonics"
                ),
                **shared.members(chosen.price, *named),
                "unit": front.unit,
            },
            "notes": (*notes, *signature.notes),
        }
    )
