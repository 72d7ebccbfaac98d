"""Command that reads volume and ejection fraction."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
import numpy as np

from modalmotion.cli.files import fitted, sequence_argument
from modalmotion.cli.options import command, fit_options, json_option, picture_option, tell
from modalmotion.cli.outputs import PICTURES, OutputFile, write_picture
from modalmotion.cli.waiting import Waiting
from modalmotion.clinical import ClinicalReadouts, VolumeCurve, clinical_readouts
from modalmotion.clinical.plain import ventricle_json
from modalmotion.clinical.strain import DEFINITIONS
from modalmotion.clinical.ventricle import VentricleReadouts, ventricle_readouts
from modalmotion.errors import TopologyError
from modalmotion.exports.tables import direction_names
from modalmotion.hdf5.image import INTENDED_USE
from modalmotion.pictures.readouts import bulls_eye_figure, most_moved, volume_figure
from modalmotion.representation import counted, numeral


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
