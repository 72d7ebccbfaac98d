"""Read-outs of a ventricle besides its volume: rates, segments, strain; and as values for JSON."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, TypeVar

import numpy as np

from modalmotion.arguments.checking import Plotted
from modalmotion.clinical.rates import Rates, rates_of
from modalmotion.clinical.readouts import ClinicalReadouts
from modalmotion.clinical.segments import RegionalMotion, regional_motion
from modalmotion.clinical.sensitivity import Sensitivities, sensitivities
from modalmotion.clinical.strain import DEFINITIONS, Strain, wall_strain
from modalmotion.clinical.torsion import Torsion, torsion
from modalmotion.clinical.volume_curve import Fraction, VolumeCurve
from modalmotion.clinical.wall_motion import DIRECTIONS
from modalmotion.errors import InputError
from modalmotion.hdf5.image import INTENDED_USE
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.notes import Note, notes_as_json
from modalmotion.representation import Floats, shown
from modalmotion.signature.making import ModalSignature
from modalmotion.signature.reconstruction import fitted_on
from modalmotion.template import Template

T = TypeVar("T")


@shown("rates", "regions", "strain")
@dataclass(frozen=True, eq=False)
class VentricleReadouts(Plotted):
    """Read-outs that not every surface has; None otherwise, with the reason.

    Parameters
    ----------
    rates : Rates or None
    regions : RegionalMotion or None
    strain : Strain or None
    torsion : Torsion or None
        None unless it is stated that vertices follow the tissue.
    per_mode : Sensitivities or None
        Effect of a unit of each amplitude on the read-outs.
    reasons : tuple of Note
        Reasons of those that are None.
    """

    rates: Rates | None
    regions: RegionalMotion | None
    strain: Strain | None
    torsion: Torsion | None
    per_mode: Sensitivities | None
    reasons: tuple[Note, ...]


def ventricle_readouts(
    signature: ModalSignature,
    sequence: MeshSequence,
    readouts: ClinicalReadouts,
    *,
    template: Template | None = None,
) -> VentricleReadouts:
    """Compute further read-outs of a ventricle's wall and volume.

    Parameters
    ----------
    signature : ModalSignature
    sequence : MeshSequence
        The one it was made from, with its facts.
    readouts : ClinicalReadouts
        Of the same signature: its largest volume is end diastole, its smallest end systole.
    template : Template, optional
        The one that the signature's parameters name, if they name one.
    """
    start, end = readouts.mesh_curve.end_diastole, readouts.mesh_curve.end_systole
    reasons: list[Note] = []

    def attempt(make: Callable[[], T]) -> T | None:
        try:
            return make()
        except InputError as error:
            reasons.append(Note.of("not_computed", reason=str(error)))
            return None

    return VentricleReadouts(
        rates=attempt(lambda: rates_of(readouts, sequence.facts.period)),
        regions=attempt(lambda: regional_motion(signature, sequence, start, template=template)),
        strain=attempt(
            lambda: wall_strain(sequence, fitted_on(signature, sequence, template), start, end)
        ),
        torsion=attempt(
            lambda: torsion(sequence, fitted_on(signature, sequence, template), start, end)
        ),
        per_mode=attempt(lambda: sensitivities(signature, sequence, readouts, template=template)),
        reasons=tuple(dict.fromkeys(reasons)),
    )


def readouts_json(readouts: ClinicalReadouts, ventricle: VentricleReadouts) -> dict[str, Any]:
    """Write all read-outs, each number with its interval; volumes in `volume_unit`."""
    return {
        "sequence_id": readouts.sequence_id,
        "template_id": readouts.template_id,
        "amplitudes_per_frame": readouts.n_amplitudes,
        "volume_unit": readouts.volume_unit,
        "times": None if readouts.times is None else readouts.times.tolist(),
        "n_openings": readouts.n_openings,
        "from_signature": volumes_json(readouts.curve, readouts.shown_in),
        "of_mesh": volumes_json(readouts.mesh_curve, readouts.shown_in),
        **ventricle_json(ventricle),
        "notes": [*readouts.notes, *ventricle.reasons],
        "intended_use": INTENDED_USE,
    }


def volumes_json(curve: VolumeCurve, factor: float) -> dict[str, Any]:
    """Write volumes over time in another unit, and their read-outs."""

    def figure(value: float, interval: tuple[float, float], factor: float) -> dict[str, float]:
        low, high = interval
        return {"value": factor * value, "low": factor * low, "high": factor * high}

    share = None
    if curve.share is not None and curve.share_range is not None:
        share = figure(curve.share, curve.share_range, 1.0)
    is_ejected = curve.fraction == Fraction.EJECTION_FRACTION
    large, small = curve.end_diastolic_volume, curve.end_systolic_volume
    return {
        "volumes": (curve.volumes * factor).tolist(),
        "bounds": (curve.bounds * factor).tolist(),
        "end_diastole": curve.end_diastole,
        "end_systole": curve.end_systole,
        "end_diastolic_volume": figure(large, curve.end_diastolic_range, factor),
        "end_systolic_volume": figure(small, curve.end_systolic_range, factor),
        "stroke_volume": figure(curve.stroke_volume, curve.stroke_range, factor),
        "ejection_fraction": share if is_ejected else None,
        "volume_change": None if is_ejected else share,
    }


def ventricle_json(ventricle: VentricleReadouts) -> dict[str, Any]:
    """Write read-outs: rates, segments and strain, null if a surface has none."""
    regions, strain = ventricle.regions, ventricle.strain
    return {
        "rates": None if ventricle.rates is None else asdict(ventricle.rates),
        "segments": None
        if regions is None
        else {
            "names": list(regions.names),
            "percent": _numbers(regions.shares),
            "end_diastole": regions.end_diastole,
            "reason": regions.reason,
        },
        "strain": None if strain is None else strain_json(strain),
        "torsion": None if ventricle.torsion is None else torsion_json(ventricle.torsion),
        "per_mode": None if ventricle.per_mode is None else per_mode_json(ventricle.per_mode),
    }


def torsion_json(torsion: Torsion) -> dict[str, Any]:
    """Write twist and shear, degrees."""
    return {
        "twist": torsion.twist.tolist(),
        "twist_deviations": torsion.twist_deviations.tolist(),
        "shear": torsion.shear.tolist(),
        "shear_deviations": torsion.shear_deviations.tolist(),
        "end_diastole": torsion.end_diastole,
        "end_systole": torsion.end_systole,
    }


def per_mode_json(per_mode: Sensitivities) -> dict[str, Any]:
    """Write gradients by amplitudes."""
    return {
        "names": list(per_mode.names),
        "units": list(per_mode.units),
        "modes": [str(label) for label in per_mode.labels],
        "values": per_mode.values.tolist(),
    }


def strain_json(strain: Strain) -> dict[str, Any]:
    """Write strain, each number with its interval and its definition."""
    return {
        "figures": [
            {
                "name": name,
                "definition": DEFINITIONS.get(name, DEFINITIONS["GCS"]),
                "end_systolic": strain.end_systolic[name]._asdict(),
                "peak": strain.peak[name]._asdict(),
                "curve": strain.curves[:, place].tolist(),
                "deviations": strain.deviations[:, place].tolist(),
            }
            for place, name in enumerate(strain.names)
        ],
        "segments": {
            "names": list(strain.segments),
            "directions": list(DIRECTIONS),
            "percent": _numbers(strain.by_segment),
            "end_systolic_deviations": _numbers(strain.segment_deviations),
            "reason": strain.reason,
        },
        "dyssynchrony": None if strain.dyssynchrony is None else strain.dyssynchrony._asdict(),
        "end_diastole": strain.end_diastole,
        "end_systole": strain.end_systole,
        "found_by": "largest and smallest volume",
        "layer": strain.layer,
        "source": strain.source,
        "notes": notes_as_json(strain.notes),
    }


def _numbers(values: Floats) -> Any:
    """Nested lists, None for what is not a number."""
    plain = values.astype(object)
    plain[np.isnan(values)] = None
    return plain.tolist()
