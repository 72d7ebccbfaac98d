"""Further read-outs of a ventricle as plain values, ready for JSON."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from modalmotion.clinical.sensitivity import Sensitivities
from modalmotion.clinical.strain import DEFINITIONS, Strain
from modalmotion.clinical.torsion import Torsion
from modalmotion.clinical.ventricle import VentricleReadouts
from modalmotion.clinical.wall_motion import DIRECTIONS


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
        "notes": list(strain.notes),
    }


def _numbers(values: NDArray[np.float64]) -> Any:
    """Nested lists, None for what is not a number."""
    plain = values.astype(object)
    plain[np.isnan(values)] = None
    return plain.tolist()
