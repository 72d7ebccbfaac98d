"""A bull's-eye of the left ventricle's segments. Needs matplotlib (extra ``plot``)."""

from __future__ import annotations

from textwrap import fill
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from modalmotion.clinical.segments import RegionalMotion
from modalmotion.errors import needs_extra

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Radii of the rings from the base outside to the apex inside, as in Cerqueira (2002).
_RADII: Final = (1.0, 0.745, 0.49, 0.235, 0.0)
_LETTERS: Final = 62


def bulls_eye_figure(regions: RegionalMotion, frame: int | None = None) -> Figure:
    """Draw the inward motion of each segment, or of each ring if segments are unknown.

    Anterior is at the top, septal on the left, as in the standard.

    Parameters
    ----------
    regions : RegionalMotion
    frame : int, optional
        By default the one in which the wall has moved most.

    Returns
    -------
    matplotlib.figure.Figure
    """
    with needs_extra("plot"):
        from matplotlib import colormaps
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import Normalize
        from matplotlib.figure import Figure
        from matplotlib.patches import Wedge

    if frame is None:
        frame = most_moved(regions)
    values = regions.shares[frame]
    known = values[np.isfinite(values)]
    norm = Normalize(min(0.0, float(known.min(initial=0.0))), float(known.max(initial=1.0)))
    colours = colormaps["viridis"]
    figure = Figure(figsize=(5.4, 5.6), dpi=120, layout="constrained")
    axes: Any = figure.add_subplot()
    for number, value in enumerate(values.tolist()):
        inner, outer, middle, width = _place(number, regions.has_segments)
        is_known = bool(np.isfinite(value))
        colour = colours(norm(value)) if is_known else (1.0, 1.0, 1.0, 1.0)
        start, end = middle - width / 2, middle + width / 2
        axes.add_patch(
            Wedge((0, 0), outer, start, end, width=outer - inner, fc=colour, ec="white", lw=1.5)
        )
        at = 0.0 if inner == 0.0 else (inner + outer) / 2
        angle = np.radians(90.0 if width == 360.0 else middle)
        axes.text(
            at * np.cos(angle),
            at * np.sin(angle),
            f"{value:.0f}" if is_known else "–",
            ha="center",
            va="center",
            fontsize=9,
            color="#10151c" if not is_known or norm(value) > 0.55 else "white",
        )
    if regions.has_segments:
        for name, x, y in (
            *(("anterior", 0.0, 1.08), ("inferior", 0.0, -1.08)),
            *(("septal", -1.1, 0.0), ("lateral", 1.1, 0.0)),
        ):
            turn = {"septal": 90, "lateral": 270}.get(name, 0)
            axes.text(x, y, name, ha="center", va="center", fontsize=9, rotation=turn)
    axes.set(xlim=(-1.2, 1.2), ylim=(-1.2, 1.2), aspect="equal")
    axes.set_axis_off()
    axes.set_title(
        f"Inward motion since frame {regions.end_diastole}, in frame {frame}", fontsize=11
    )
    figure.colorbar(
        ScalarMappable(norm, "viridis"),
        ax=axes,
        orientation="horizontal",
        shrink=0.75,
        pad=0.02,
        label="% of the radius at end diastole",
    )
    if regions.reason:
        figure.supxlabel(fill(regions.reason, _LETTERS), fontsize=8, color="#5b6675")
    return figure


def most_moved(regions: RegionalMotion) -> int:
    """Frame with the largest mean inward motion of the segments."""
    known = np.isfinite(regions.shares).any(axis=0)
    return int(np.nanmean(regions.shares[:, known], axis=1).argmax()) if known.any() else 0


def _place(number: int, has_segments: bool) -> tuple[float, float, float, float]:
    """Inner and outer radius, middle and width in degrees of a segment."""
    if not has_segments:
        return _RADII[number + 1], _RADII[number], 0.0, 360.0
    if number == 16:
        return 0.0, _RADII[3], 0.0, 360.0
    if number >= 12:
        return _RADII[3], _RADII[2], 90.0 + 90.0 * (number - 12), 90.0
    ring = number // 6
    return _RADII[ring + 1], _RADII[ring], 90.0 + 60.0 * (number % 6), 60.0
