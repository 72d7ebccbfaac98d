"""Pictures of read-outs: volumes, strain, segments."""

from __future__ import annotations

from textwrap import fill
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from modalmotion.clinical.readouts import ClinicalReadouts
from modalmotion.clinical.segments import RegionalMotion
from modalmotion.clinical.strain import DEFINITIONS, Strain
from modalmotion.pictures.views import lighten, new_figure, time_axis
from modalmotion.representation import Array, Floats, numeral

if TYPE_CHECKING:
    from matplotlib.axes import Axes
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
    factor, unit = readouts.shown_in, readouts.volume_unit
    curve, mesh = readouts.curve, readouts.mesh_curve
    v = curve.volumes * factor
    figure = new_figure(7.2, 4.2)
    axes = figure.add_subplot()
    at = draw_volume(axes, readouts, v, curve.bounds * factor)
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
    axes.margins(x=0.03, y=0.22)
    axes.legend(fontsize=9, frameon=False, loc="upper center")
    return figure


def draw_volume(axes: Axes, readouts: ClinicalReadouts, v: Floats, reach: Floats) -> Floats:
    """Draw volumes with a band of their reach, by time in s or by frame, which is returned."""
    at, label = time_axis(readouts.times, len(v))
    axes.fill_between(at, v - reach, v + reach, color=_SIGNATURE, alpha=0.22, lw=0)
    words = f"from {readouts.n_amplitudes} amplitudes, with its bound"
    axes.plot(at, v, "o-", ms=2.5, lw=1.2, color=_SIGNATURE, label=words)
    axes.set(xlabel=label, ylabel=f"volume ({readouts.volume_unit})")
    lighten(axes)
    return at


def _side(frame: int, n_frames: int) -> str:
    """Place a label within the picture: right of its point, left of it, or centred."""
    place = frame / max(1, n_frames - 1)
    return "left" if place < 0.2 else "right" if place > 0.8 else "center"


_SOFT: Final = "#7a828c"
# Of GLS, GCS and GAS; distinct without colour, too.
_CURVES: Final = (("#1f5fa8", "-"), ("#b5533c", "--"), ("#3c7a4e", ":"))


def strain_figure(strain: Strain) -> Figure:
    """Draw GLS, GCS and GAS by frame, each with a band of two standard deviations.

    Parameters
    ----------
    strain : Strain

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure = new_figure(7.2, 4.2)
    draw_strain(figure.add_subplot(), strain, None)
    return figure


def draw_strain(axes: Axes, strain: Strain, times: Floats | None) -> None:
    """Draw the curves of strain by frame, or by time in s."""
    at, label = time_axis(times, len(strain.curves))
    for name, (colour, style) in zip(DEFINITIONS, _CURVES, strict=True):
        place = strain.names.index(name)
        curve, reach = strain.curves[:, place], 2.0 * strain.deviations[:, place]
        axes.fill_between(at, curve - reach, curve + reach, color=colour, alpha=0.22, lw=0)
        axes.plot(at, curve, lw=1.2, ls=style, color=colour, label=name)
    axes.legend(fontsize=7, frameon=False, handlelength=1.8, borderaxespad=0.0)
    mark_moments(axes, at, strain.end_diastole, strain.end_systole)
    axes.set(xlabel=label, ylabel="strain (%)")
    axes.locator_params(axis="x", integer=times is None)
    lighten(axes)


def mark_moments(axes: Axes, at: Array, start: int, end: int) -> None:
    """Name end diastole and end systole, two frames, above curves over `at`."""
    for frame, name in ((start, "ED"), (end, "ES")):
        axes.axvline(at[frame], color=_SOFT, lw=0.6, ls=":")
        axes.annotate(name, (at[frame], 1.0), xycoords=("data", "axes fraction"), fontsize=6.5)


# Radii of the rings from the base outside to the apex inside, as in Cerqueira (2002).
_RADII: Final = (1.0, 0.745, 0.49, 0.235, 0.0)
_LETTERS: Final = 62


def bulls_eye_figure(regions: RegionalMotion) -> Figure:
    """Draw the inward motion of each segment, or of each ring if segments are unknown.

    The frame is the one in which the wall has moved most. Anterior is at the top, septal on the
    left, as in the standard.

    Parameters
    ----------
    regions : RegionalMotion

    Returns
    -------
    matplotlib.figure.Figure
    """
    frame = most_moved(regions)
    figure = new_figure(5.4, 5.6)
    axes: Any = figure.add_subplot()
    scale = draw_bulls_eye(axes, regions, frame)
    if regions.has_segments:
        for name, x, y, turn in (
            *(("anterior", 0.0, 1.08, 0), ("inferior", 0.0, -1.08, 0)),
            *(("septal", -1.1, 0.0, 90), ("lateral", 1.1, 0.0, 270)),
        ):
            axes.text(x, y, name, ha="center", va="center", fontsize=9, rotation=turn)
    axes.set(xlim=(-1.2, 1.2), ylim=(-1.2, 1.2))
    axes.set_title(
        f"Inward motion since frame {regions.end_diastole}, in frame {frame}", fontsize=11
    )
    label = "% of the radius at end diastole"
    figure.colorbar(scale, ax=axes, orientation="horizontal", shrink=0.75, pad=0.02, label=label)
    if regions.reason:
        figure.supxlabel(fill(regions.reason, _LETTERS), fontsize=8, color="#5b6675")
    return figure


def draw_bulls_eye(axes: Any, regions: RegionalMotion, frame: int, fontsize: float = 9.0) -> Any:
    """Draw the disc of segments, or of rings, and return the scale of its colours."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.patches import Wedge

    values = regions.shares[frame]
    known = values[np.isfinite(values)]
    norm = Normalize(min(0.0, float(known.min(initial=0.0))), float(known.max(initial=1.0)))
    scale = ScalarMappable(norm, "viridis")
    for number, value in enumerate(values.tolist()):
        inner, outer, middle, width = _place(number, regions.has_segments)
        is_known = bool(np.isfinite(value))
        colour = scale.to_rgba(value) if is_known else "#dddddd"
        ends = middle - width / 2, middle + width / 2
        axes.add_patch(
            Wedge((0, 0), outer, *ends, width=outer - inner, fc=colour, ec="white", lw=1.5)
        )
        at = 0.0 if inner == 0.0 else (inner + outer) / 2
        angle = np.radians(90.0 if width == 360.0 else middle)
        ink = "white" if is_known and norm(value) <= 0.55 else "#10151c"
        style = {"ha": "center", "va": "center", "fontsize": fontsize, "color": ink}
        words = f"{value:.0f}" if is_known else "–"
        axes.text(at * np.cos(angle), at * np.sin(angle), words, **style)
    axes.set(xlim=(-1, 1), ylim=(-1, 1), aspect="equal")
    axes.set_axis_off()
    return scale


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
