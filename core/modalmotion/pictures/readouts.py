"""A picture of volume over time. Needs matplotlib (extra ``plot``)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from modalmotion.clinical.readouts import ClinicalReadouts
from modalmotion.errors import needs_extra
from modalmotion.numerals import numeral

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SIGNATURE = "#1f5fa8"
_MESH = "#333333"


def volume_figure(readouts: ClinicalReadouts) -> Figure:
    """Draw the volume over time with its bound as a band, and that of the mesh.

    Parameters
    ----------
    readouts : ClinicalReadouts

    Returns
    -------
    matplotlib.figure.Figure
    """
    # Imported here because only pictures need it. A bare Figure has no window or global state.
    with needs_extra("plot"):
        from matplotlib.figure import Figure

    factor, unit = readouts.shown_in, readouts.volume_unit
    curve, mesh = readouts.curve, readouts.mesh_curve
    v, b = curve.volumes * factor, curve.bounds * factor
    times = readouts.times
    at = np.arange(len(v), dtype=np.float64) if times is None else times
    figure = Figure(figsize=(7.2, 4.2), dpi=120, layout="constrained")
    axes = figure.add_subplot()
    axes.fill_between(at, v - b, v + b, color=_SIGNATURE, alpha=0.22, lw=0, label="its bound")
    axes.plot(
        at, v, "o-", ms=3.5, color=_SIGNATURE, label=f"from {readouts.n_amplitudes} amplitudes"
    )
    axes.plot(at, mesh.volumes * factor, "--", lw=1.2, color=_MESH, label="the mesh itself")
    for frame, name, above in (
        (curve.end_diastole, "end diastole", True),
        (curve.end_systole, "end systole", False),
    ):
        axes.annotate(
            f"{name}\n{numeral(float(v[frame]), 1)} {unit}",
            (at[frame], v[frame]),
            xytext=(0, 9 if above else -9),
            textcoords="offset points",
            ha=_side(frame, len(v)),
            va="bottom" if above else "top",
            fontsize=9,
        )
    if curve.fraction is not None and curve.share_range is not None:
        low, high = curve.share_range
        axes.set_title(
            f"{curve.fraction.words.capitalize()} {curve.share:.1f} % ({low:.1f} to {high:.1f}); "
            f"mesh {mesh.share:.1f} %",
            fontsize=11,
        )
    axes.set(xlabel="frame" if times is None else "time (s)", ylabel=f"volume ({unit})")
    axes.margins(x=0.03, y=0.22)
    axes.grid(alpha=0.25)
    axes.legend(fontsize=9, frameon=False, loc="upper center")
    return figure


def _side(frame: int, n_frames: int) -> str:
    """Place a label within the picture: right of its point, left of it, or centred."""
    place = frame / max(1, n_frames - 1)
    return "left" if place < 0.2 else "right" if place > 0.8 else "center"
