"""Command that reads volume and ejection fraction."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import click

from modalmotion.cli.files import GridShape, ReferenceShape, read, sequence_argument
from modalmotion.clinical import ClinicalReadouts, VolumeCurve, clinical_readouts
from modalmotion.errors import TopologyError
from modalmotion.hdf5.image import INTENDED_USE
from modalmotion.mesh.sequence import MeshSequence, Reference
from modalmotion.numerals import counted, numeral
from modalmotion.pictures.readouts import volume_figure
from modalmotion.signature.making import ModalSignature, SignatureParameters, modal_signature
from modalmotion.template.body_frame import Components


@click.command()
@sequence_argument
@click.option("--modes", default=7, show_default=True, help="Modes, 3 amplitudes a frame each.")
@click.option("--topology", help="cup, cylinder, sphere, ...; over what the file states.")
@click.option("--grid", type=GridShape(), help="Lattice shape such as 32,64; over the file's own.")
@click.option(
    "--reference",
    type=ReferenceShape(),
    default=0,
    show_default=True,
    help="Frame to measure from, or mean: of all frames, wherever the recording starts.",
)
@click.option(
    "--components",
    type=click.Choice([c.value for c in Components]),
    default=Components.CARTESIAN.value,
    show_default=True,
    help="x, y, z or radial, tangential, axial.",
)
@click.option("--plot", type=click.Path(path_type=Path), help="Picture to write (PNG, SVG, PDF).")
@click.option("--json", "as_json", is_flag=True, help="Print all numbers as JSON.")
def readouts(
    source: Path,
    modes: int,
    topology: str | None,
    grid: tuple[int, ...] | None,
    reference: Reference,
    components: str,
    plot: Path | None,
    as_json: bool,
    **said: Any,
) -> None:
    """Read volume and ejection fraction of the cavity in FILE, with their bounds."""
    sequence = read(source, **said)
    parameters = SignatureParameters(
        modes=modes,
        topology=topology,
        grid=grid,
        reference=reference,
        components=Components(components),
    )
    found = clinical_readouts(modal_signature(sequence, parameters), sequence)
    if plot is not None:
        volume_figure(found).savefig(plot)
    if as_json:
        click.echo(json.dumps(_numbers(found), indent=2))
    else:
        click.echo("\n".join([*_lines(found), *(f"note: {note}" for note in found.notes)]))
    if plot is not None:
        click.echo(f"written: {plot}", err=as_json)


def volume_lines(signature: ModalSignature, sequence: MeshSequence) -> list[str]:
    """Give lines on volume and ejection fraction, none where nothing is enclosed."""
    try:
        found = clinical_readouts(signature, sequence)
    except TopologyError:
        return []
    large, small, _ = _volumes(found.curve, found.shown_in)
    low, high = found.curve.ejection_fraction_range
    return [
        f"volume {numeral(large, 1)} to {numeral(small, 1, of=large)} {found.volume_unit}",
        f"ejection fraction {found.curve.ejection_fraction:.1f} % ({low:.1f} to {high:.1f})",
        *(f"note: {note}" for note in found.notes if signature.n_frames > 1),
    ]


def _lines(found: ClinicalReadouts) -> list[str]:
    unit = found.volume_unit
    lines = [
        (
            f"{found.n_amplitudes} amplitudes a frame; {counted(found.n_openings, 'opening')}"
            f"{', closed by fans' if found.n_openings else ''}"
        ),
        f"{'':>24}{'signature':>12}{'low':>10}{'high':>10}{'mesh':>10}",
    ]
    curve, mesh, factor = found.curve, found.mesh_curve, found.shown_in
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
    low, high = curve.ejection_fraction_range
    lines.append(
        f"{'ejection fraction':<24}{curve.ejection_fraction:12.2f}{low:10.2f}{high:10.2f}"
        f"{mesh.ejection_fraction:10.2f} %"
    )
    lines.append(f"end diastole in frame {curve.end_diastole}, end systole in {curve.end_systole}")
    return lines


def _volumes(curve: VolumeCurve, factor: float) -> tuple[float, float, float]:
    volumes = (curve.end_diastolic_volume, curve.end_systolic_volume, curve.stroke_volume)
    large, small, stroke = (v * factor for v in volumes)
    return large, small, stroke


def _numbers(found: ClinicalReadouts) -> dict[str, object]:
    return {
        "sequence_id": found.sequence_id,
        "amplitudes_per_frame": found.n_amplitudes,
        "n_openings": found.n_openings,
        "volume_unit": found.volume_unit,
        "times": None if found.times is None else found.times.tolist(),
        "from_signature": _curve(found.curve, found.shown_in),
        "of_mesh": _curve(found.mesh_curve, found.shown_in),
        "notes": list(found.notes),
        "intended_use": INTENDED_USE,
    }


def _curve(curve: VolumeCurve, factor: float) -> dict[str, object]:
    large, small, stroke = _volumes(curve, factor)
    low, high = curve.ejection_fraction_range
    return {
        "volumes": (curve.volumes * factor).tolist(),
        "bounds": (curve.bounds * factor).tolist(),
        "end_diastole": curve.end_diastole,
        "end_systole": curve.end_systole,
        "end_diastolic_volume": large,
        "end_systolic_volume": small,
        "stroke_volume": stroke,
        "ejection_fraction": curve.ejection_fraction,
        "ejection_fraction_range": [low, high if math.isfinite(high) else None],
    }
