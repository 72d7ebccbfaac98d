"""Commands of clinical read-outs, of a comparison with known motion, and of norms."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from modalmotion.cli.files import Waiting, fitted, sequence_argument
from modalmotion.cli.options import (
    PICTURES,
    OutputFile,
    command,
    example,
    fit_options,
    json_option,
    labelled_sources,
    picture_option,
    tell,
    unit_option,
    write_picture,
)
from modalmotion.clinical import ClinicalReadouts, VolumeCurve, clinical_readouts
from modalmotion.clinical.plain import ventricle_json
from modalmotion.clinical.strain import DEFINITIONS
from modalmotion.clinical.ventricle import VentricleReadouts, ventricle_readouts
from modalmotion.errors import TopologyError
from modalmotion.exports.tables import direction_names
from modalmotion.hdf5.image import INTENDED_USE
from modalmotion.pictures.readouts import bulls_eye_figure, most_moved, volume_figure
from modalmotion.representation import counted, numeral

if TYPE_CHECKING:
    from modalmotion.classification.manifest import LabelledFile


@command("readouts beat.npz --modes 18 -o volumes.png")
@sequence_argument
@picture_option
@click.option(
    "--bulls-eye",
    type=OutputFile(*PICTURES),
    help="Picture of inward motion by segment to write (.png, .svg, .pdf).",
)
@json_option
@fit_options
def readouts(
    source: Path, plot: Path | None, bulls_eye: Path | None, as_json: bool, **options: Any
) -> None:
    """Compute volume, ejection fraction and strain of the cavity in FILE, with intervals.

    The relative change of volume is an ejection fraction if --cavity is given or the surface is a
    cup, otherwise a volume change.
    """
    with Waiting(source) as waiting:
        sequence, signature = fitted(source, waiting, options)
        with waiting.watch.stage("volume"):
            result = clinical_readouts(signature, sequence)
            ventricle = ventricle_readouts(signature, sequence, result)
    if plot is not None:
        write_picture(volume_figure(result), plot)
    if bulls_eye is not None:
        if ventricle.regions is None:
            raise TopologyError(
                "This surface has no segments to draw.",
                remedy="Leave --bulls-eye out: segments are those of a cup, a ventricle's wall.",
            )
        write_picture(bulls_eye_figure(ventricle.regions), bulls_eye)
    lines = [
        *_lines(result),
        *_further(ventricle, result.volume_unit, direction_names(signature)),
        *(f"note: {note}" for note in (*result.notes, *ventricle.reasons)),
    ]
    numbers = {**_numbers(result), **ventricle_json(ventricle)}
    tell(numbers, lines, plot, bulls_eye, as_json=as_json)


def _lines(readouts: ClinicalReadouts) -> list[str]:
    unit = readouts.volume_unit
    names, mesh = ("signature", "mesh"), readouts.mesh_curve
    if readouts.stated is mesh:
        names, mesh = ("surface", "signature"), readouts.curve
    lines = [
        (
            f"{readouts.n_amplitudes} amplitudes per frame; "
            f"{counted(readouts.n_openings, 'opening')}{', capped' if readouts.n_openings else ''}"
        ),
        f"{'':>24}{names[0]:>12}{'low':>10}{'high':>10}{names[1]:>10}",
    ]
    curve, factor = readouts.stated, readouts.shown_in
    intervals = (curve.end_diastolic_range, curve.end_systolic_range, curve.stroke_range)
    largest = abs(curve.end_diastolic_volume) * factor
    rows = zip(
        ("end-diastolic volume", "end-systolic volume", "stroke volume"),
        _volumes(curve, factor),
        intervals,
        _volumes(mesh, factor),
        strict=True,
    )
    for name, value, (low, high), own in rows:
        shown = (numeral(v, 2, of=largest) for v in (low * factor, high * factor, own))
        lines.append(
            f"{name:<24}{numeral(value, 2, of=largest):>12}"
            f"{''.join(f'{text:>10}' for text in shown)} {unit}"
        )
    if curve.fraction is not None and curve.share_range is not None:
        low, high = curve.share_range
        lines.append(
            f"{curve.fraction.words:<24}{curve.share:12.2f}{low:10.2f}{high:10.2f}"
            f"{mesh.share:10.2f} %"
        )
    lines.append(f"end diastole in frame {curve.end_diastole}, end systole in {curve.end_systole}")
    return lines


def _further(ventricle: VentricleReadouts, unit: str, directions: tuple[str, ...]) -> list[str]:
    lines = []
    if (rates := ventricle.rates) is not None:
        for name, value, bound in (
            ("peak ejection rate", rates.peak_ejection_rate, rates.ejection_bound),
            ("peak filling rate", rates.peak_filling_rate, rates.filling_bound),
        ):
            lines.append(f"{name:<24}{numeral(value, 1):>12} +- {numeral(bound, 1)} {unit}/s")
        if rates.heart_rate is not None and rates.cardiac_output is not None:
            lines.append(f"{'heart rate':<24}{rates.heart_rate:12.1f} /min")
            lines.append(f"{'cardiac output':<24}{numeral(rates.cardiac_output, 1):>12} {unit}/min")
    if (strain := ventricle.strain) is not None:
        for name, figure in strain.end_systolic.items():
            lines.append(f"{name:<24}{figure.value:12.1f}{figure.low:10.1f}{figure.high:10.1f} %")
        if (index := strain.dyssynchrony) is not None:
            lines.append(
                f"{'SDI':<24}{index.value:12.1f}{index.low:10.1f}{index.high:10.1f} % of the cycle"
            )
        lines.append(
            f"strain in frame {strain.end_systole}, since frame {strain.end_diastole}, of "
            f"{strain.source}, {strain.layer}:"
        )
        lines += [f"  {name} is the change of the {what}" for name, what in DEFINITIONS.items()]
    if (turning := ventricle.torsion) is not None:
        for name, values, deviations in (
            ("twist", turning.twist, turning.twist_deviations),
            ("shear", turning.shear, turning.shear_deviations),
        ):
            value, reach = values[turning.end_systole], 2.0 * deviations[turning.end_systole]
            lines.append(f"{name:<24}{value:12.1f}{value - reach:10.1f}{value + reach:10.1f} deg")
    if (per_mode := ventricle.per_mode) is not None:
        lines += ["largest effect of an amplitude, for each length unit of it:"]
        for name, what, values in zip(per_mode.names, per_mode.units, per_mode.values, strict=True):
            mode, direction = np.unravel_index(np.abs(values).argmax(), values.shape)
            lines.append(
                f"  {name.replace('_', ' '):<22}{values[mode, direction]:12.2f} {what}, mode "
                f"{per_mode.labels[mode]}, {directions[direction]}"
            )
    if (regions := ventricle.regions) is not None:
        frame = most_moved(regions)
        lines.append(f"inward motion over the radius at end diastole, frame {frame}, %:")
        for name, share in zip(regions.names, regions.shares[frame], strict=True):
            lines.append(f"  {name:<22}{share:12.1f}")
    return lines


def _volumes(curve: VolumeCurve, factor: float) -> tuple[float, float, float]:
    volumes = (curve.end_diastolic_volume, curve.end_systolic_volume, curve.stroke_volume)
    large, small, stroke = (v * factor for v in volumes)
    return large, small, stroke


def _numbers(readouts: ClinicalReadouts) -> dict[str, object]:
    return {
        "sequence_id": readouts.sequence_id,
        "amplitudes_per_frame": readouts.n_amplitudes,
        "n_openings": readouts.n_openings,
        "volume_unit": readouts.volume_unit,
        "times": None if readouts.times is None else readouts.times.tolist(),
        "from_signature": _curve(readouts.curve, readouts.shown_in),
        "of_mesh": _curve(readouts.mesh_curve, readouts.shown_in),
        "notes": list(readouts.notes),
        "intended_use": INTENDED_USE,
    }


def _curve(curve: VolumeCurve, factor: float) -> dict[str, object]:
    large, small, stroke = _volumes(curve, factor)
    return {
        "volumes": (curve.volumes * factor).tolist(),
        "bounds": (curve.bounds * factor).tolist(),
        "end_diastole": curve.end_diastole,
        "end_systole": curve.end_systole,
        "end_diastolic_volume": large,
        "end_systolic_volume": small,
        "stroke_volume": stroke,
        "ejection_fraction": curve.ejection_fraction,
        "volume_change": curve.volume_change,
        "share_range": curve.share_range,
    }


@command("score truth.npz answer.h5")
@click.argument("truth", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.argument("answer", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@json_option
def score(truth: Path, answer: Path, as_json: bool) -> None:
    """Compare the motion in ANSWER with the true one in TRUTH.

    ANSWER is a track (.h5), with its deviations, or a sequence in any format; .npz may contain
    `deviations` (frames, vertices), mm.
    """
    from modalmotion.clinical.score import PUBLISHED
    from modalmotion.clinical.score import score as scored
    from modalmotion.formats import read_sequence
    from modalmotion.formats.npz import read_arrays
    from modalmotion.tracking.hdf5 import track_from_hdf5

    deviations = None
    if answer.suffix.lower() in (".h5", ".hdf5"):
        found = track_from_hdf5(answer.read_bytes())
        estimated, deviations = found.sequence, found.deviations[:, :, 0]
    else:
        estimated = read_sequence(answer).sequence
        if answer.suffix.lower() == ".npz":
            arrays, _ = read_arrays(answer.read_bytes(), ["deviations"], [])
            deviations = arrays.get("deviations")
    result = scored(read_sequence(truth).sequence, estimated, deviations)
    if as_json:
        click.echo(json.dumps(asdict(result), indent=2))
        return
    inside = "not stated"
    if result.inside is not None:
        inside = f"{100 * result.inside:.0f} % (mean stated deviation {result.stated:.2f} mm)"
    click.echo(
        f"end-point error of 12 landmarks: {result.end_point_end_systole:.2f} mm at end systole, "
        f"{result.end_point:.2f} mm over all frames\n"
        f"distance along the normal: {result.along_normal:.2f} mm\n"
        f"error of EF {result.ejection_fraction:+.1f}, GLS {result.gls:+.1f}, "
        f"GCS {result.gcs:+.1f} percentage points\n"
        f"within 1.96 stated deviations: {inside}\n"
        f"Published end-point errors: {PUBLISHED} mm. They are of other recordings and landmarks, "
        "and compare with end-point errors only: distances along the normal do not see motion "
        "within the surface and are smaller."
    )


@click.group()
def norm() -> None:
    """Compare recordings with your own controls."""


@norm.command(epilog=example("norm train controls.csv --name volunteers -o volunteers.h5"))
@labelled_sources
@unit_option
@click.option("--name", required=True, help="Of the norm: lower-case letters, digits, '._-'.")
@click.option("-o", "--out", required=True, type=OutputFile(), help="File to write (HDF5).")
@click.option(
    "--modes", default=7, show_default=True, help="Modes of the signatures; 3 amplitudes per frame."
)
@click.option(
    "--topology",
    help="cup, sphere, ..., or mesh for spring modes; found from all controls by default.",
)
@json_option
def train(
    sources: tuple[Path, ...],
    name: str,
    out: Path,
    modes: int,
    topology: str | None,
    as_json: bool,
    unit: str | None,
    skip_unreadable: bool,
) -> None:
    """Make a norm of recordings of controls, one of each person.

    MANIFEST is a table with the column path and, if known, subject and facts; labels are ignored.
    FILES are files of sequences.
    """
    from modalmotion.classification.manifest import labelled_files
    from modalmotion.norm import norm_to_hdf5, train_norm
    from modalmotion.store import write_atomic

    files = labelled_files(sources, skip_unreadable=skip_unreadable, needs_label=False)
    cases, left_out = _read(files, unit, lambda case, _: case, skip_unreadable=skip_unreadable)
    result = train_norm(cases, name, modes=modes, topology=topology)
    write_atomic(out, norm_to_hdf5(result))
    said = result.as_json()
    lines = [
        f"{result.name} (id {result.id[:12]}): {result.n_controls} controls",
        f"{said['topology']}, {said['n_modes']} modes",
        f"groups: {', '.join(said['groups'])}",
        f"smallest level: {said['smallest_level']:.3g}",
        *(f"note: {note}" for note in result.notes),
        *left_out,
    ]
    tell({**said, "left_out": left_out}, lines, out, as_json=as_json)


@norm.command(epilog=example("norm ask volunteers.h5 beat.npz"))
@click.argument("norm_file", metavar="NORM", type=click.Path(exists=True, path_type=Path))
@labelled_sources
@unit_option
@click.option(
    "--level",
    default=0.05,
    show_default=True,
    help="Level: share of recordings like the controls that are called a deviation.",
)
@json_option
def ask(
    norm_file: Path,
    sources: tuple[Path, ...],
    level: float,
    as_json: bool,
    unit: str | None,
    skip_unreadable: bool,
) -> None:
    """Compare recordings with the controls of NORM, a file.

    Five or more are also compared together, with a warning if machine or protocol differ. MANIFEST
    and FILES are as for training.
    """
    from modalmotion.classification.manifest import labelled_files
    from modalmotion.norm import cohort_deviation, norm_from_hdf5

    controls = norm_from_hdf5(norm_file)
    files = labelled_files(sources, skip_unreadable=skip_unreadable, needs_label=False)

    def read(case: Any, name: str) -> Any:
        return controls.read(case.motion, subject=case.subject, name=name)

    readings, left_out = _read(files, unit, read, skip_unreadable=skip_unreadable)
    together = cohort_deviation(controls, readings, level=level)
    pairs = list(zip(readings, together.deviations, strict=True))
    lines = [f"{one.name}\n{answer.lines}" for one, answer in pairs]
    if together.p is not None:
        lines.append(f"together: p = {together.p:.3g} of {controls.n_controls} like controls")
        if together.warning is not None:
            lines.append(f"warning: {together.warning}")
    shown = [{"path": one.name, **answer.as_json()} for one, answer in pairs]
    whole = None if together.p is None else together.as_json()
    found = {"cohort": whole, "deviations": shown, "left_out": left_out}
    tell(found, [*lines, *left_out], as_json=as_json)


def _read(
    files: list[LabelledFile],
    unit: str | None,
    use: Callable[[Any, str], Any],
    *,
    skip_unreadable: bool,
) -> tuple[list[Any], list[str]]:
    """Read files, each for a use; those that cannot be used may be left out, and are named."""
    from modalmotion.classification.cases import UNUSABLE, LeftOut, left_out_notes
    from modalmotion.classification.manifest import LabelledSequence

    used: list[Any] = []
    left_out: list[LeftOut] = []
    with click.progressbar(files, label="recordings", file=sys.stderr) as bar:
        for file in bar:
            source = LabelledSequence(file, {"unit": unit})
            try:
                used.append(use(source.read(), source.name))
            except UNUSABLE as error:
                if not skip_unreadable:
                    raise
                left_out.append(LeftOut.of(error, source.name))
    return used, list(left_out_notes(left_out))
