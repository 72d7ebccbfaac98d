"""Frames whose surfaces a report shows."""

from __future__ import annotations

import numpy as np

from modalmotion.reports.content import Report


def moments_of(report: Report) -> list[tuple[int, str]]:
    """Return two frames with their names: the ends of diastole and systole, if there are any."""
    if report.readouts is None:
        middle = int(np.argmax(report.signature.motion_rms))
        return [(0, "first frame"), (middle, "largest motion")]
    curve = report.readouts.mesh_curve
    names = ("end diastole", "end systole")
    if report.readouts.stated.fraction != "ejection_fraction":
        names = ("largest volume", "smallest volume")
    return list(zip((curve.end_diastole, curve.end_systole), names, strict=True))
