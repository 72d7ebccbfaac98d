"""Further readouts of a ventricle as plain values, ready for JSON."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from modalmotion.clinical.strain import DIRECTIONS
from modalmotion.clinical.ventricle import VentricleReadouts


def ventricle_json(ventricle: VentricleReadouts) -> dict[str, Any]:
    """Write readouts out: rates, segments and strain, null where a surface has none."""
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
        "strain": None
        if strain is None
        else {
            "directions": list(DIRECTIONS),
            "whole": strain.whole.tolist(),
            "whole_bounds": strain.whole_bounds.tolist(),
            "peak": strain.peak.tolist(),
            "names": list(strain.names),
            "by_segment": _numbers(strain.by_segment),
            "end_diastole": strain.end_diastole,
        },
    }


def _numbers(values: NDArray[np.float64]) -> Any:
    """Nested lists, None for what is not a number."""
    plain = values.astype(object)
    plain[np.isnan(values)] = None
    return plain.tolist()
