"""Quantities of a report with their intervals: the same numbers in every form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from modalmotion.clinical.strain import DEFINITIONS
from modalmotion.reports.content import Report
from modalmotion.representation import shown


@shown()
@dataclass(frozen=True)
class Quantity:
    """A number with the interval of the true one.

    Parameters
    ----------
    name : str
        Code of `codes.OWN`.
    value, low, high : float
    unit : str
        In words.
    ucum : str
        Its code in UCUM.
    """

    name: str
    value: float
    low: float
    high: float
    unit: str
    ucum: str


def quantities_of(report: Report) -> tuple[Quantity, ...]:
    """Return volumes, ejection fraction, strain and dyssynchrony, if there are any."""
    readouts = report.readouts
    if readouts is None:
        return ()
    curve, factor = readouts.stated, readouts.shown_in
    unit, ucum = ("ml", "mL") if readouts.unit is not None else ("cubed length units", "1")
    found = []
    if curve.fraction is not None and curve.share is not None and curve.share_range is not None:
        found.append(Quantity(str(curve.fraction), curve.share, *curve.share_range, "%", "%"))
    for name, value, (low, high) in (
        ("end_diastolic_volume", curve.end_diastolic_volume, curve.end_diastolic_range),
        ("end_systolic_volume", curve.end_systolic_volume, curve.end_systolic_range),
        ("stroke_volume", curve.stroke_volume, curve.stroke_range),
    ):
        found.append(Quantity(name, value * factor, low * factor, high * factor, unit, ucum))
    strain = None if report.ventricle is None else report.ventricle.strain
    if strain is not None:
        found += [
            Quantity(f"{name.lower()}", *strain.end_systolic[name], "%", "%")
            for name in DEFINITIONS
        ]
        if (index := strain.dyssynchrony) is not None:
            found.append(Quantity("sdi", *index, "% of the cycle", "%"))
    return tuple(found)


def errors_of(report: Report) -> tuple[float, float]:
    """Return the RMS and the largest error of the modes, in the unit of lengths."""
    signature = report.signature
    rms = float(np.sqrt(np.mean(signature.rms_errors**2)))
    return rms, float(signature.max_errors.max())
