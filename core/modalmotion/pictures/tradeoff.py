"""A picture of the trade-off. Needs matplotlib (extra ``plot``)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.mesh.sequence import MM_PER_UNIT
from modalmotion.pictures.view import ShownUnit, new_figure, shown_unit
from modalmotion.signature.choice import NUMBERS, SceneKind
from modalmotion.signature.nested_modes import n_functions
from modalmotion.signature.tradeoff import Front, Tradeoff

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLOURS: Final = ("#1f6f8b", "#c8553d", "#6a8d3f", "#7a5195", "#8c6d31", "#444444")
_CHOSEN: Final = "#d62728"

# Below this share of the motion an error is rounding and would only stretch the scale.
_SMALLEST_SHARE: Final = 1e-4


def tradeoff_figure(tradeoff: Tradeoff) -> Figure:
    """Draw error against amplitudes and against bytes, and time against both.

    Lines are topologies and components; in the second panel the dots below them are amplitudes
    limited to harmonics over time. The star is the requested point.

    Parameters
    ----------
    tradeoff : Tradeoff

    Returns
    -------
    matplotlib.figure.Figure
    """
    front = tradeoff.front
    factor = 1.0 if front.unit is None else MM_PER_UNIT[front.unit]
    shown = shown_unit(factor * front.motion_rms, None if front.unit is None else "mm")
    unit = shown.name
    factor /= shown.size
    has_times = bool(tradeoff.fit_milliseconds)
    figure = new_figure(14.0 if has_times else 10.0, 4.6)
    panels: list[Any] = [figure.add_subplot(1, 3 if has_times else 2, 1)]
    panels.append(figure.add_subplot(1, 3 if has_times else 2, 2, sharey=panels[0]))
    for number, branch in enumerate(front.branches):
        colour = _COLOURS[number % len(_COLOURS)]
        name = f"{branch.topology}, {branch.components}"
        style = {"color": colour, "linewidth": 1.6, "label": name, "zorder": 3}
        panels[0].plot(3 * branch.counts, factor * branch.rms, **style)
        whole = np.array([8 * front.numbers(n) for n in branch.counts.tolist()])
        panels[1].plot(whole, factor * branch.rms, **style)
    sizes, errors = _lower_hull(front)
    style = {"color": "#222222", "linewidth": 1.2, "linestyle": ":", "zorder": 4}
    panels[1].plot(sizes, factor * errors, label="best with fewer harmonics", **style)
    _simple_kinds(panels, tradeoff, factor)
    price = tradeoff.chosen.price
    # Prices are in mm already if the unit is known.
    left = price.rms_error / shown.size
    star = {"marker": "*", "markersize": 15, "markeredgecolor": "white", "zorder": 6}
    # A logarithmic scale has no zero.
    for panel, x in zip(
        panels, (max(price.amplitudes_per_frame, 1), max(price.bytes, 8)), strict=True
    ):
        if left > 0:
            words = f"chosen: {left:.3g} {unit} RMS"
            panel.plot(x, left, color=_CHOSEN, linestyle="none", label=words, **star)
        if tradeoff.limit is not None:
            limit = factor * tradeoff.limit
            panel.axhline(limit, color=_CHOSEN, linewidth=0.8, linestyle="--", zorder=1)
    largest = max(factor * front.motion_rms, 1e-300)
    errors = np.concatenate([branch.rms for branch in front.branches]) * factor
    smallest = float(errors[errors > _SMALLEST_SHARE * largest].min(initial=largest))
    smallest = min(smallest, left) if left > 0 else smallest
    for panel, label in zip(
        panels, ("amplitudes per frame", "bytes of the trajectory (float64)"), strict=False
    ):
        panel.set(xscale="log", yscale="log", xlabel=label, ylim=(0.7 * smallest, 1.5 * largest))
        panel.grid(True, which="both", color="#e4e4e4", linewidth=0.6)
    panels[0].set_ylabel(f"RMS error ({unit})")
    panels[0].legend(fontsize=8, loc="upper right")
    panels[1].legend(fontsize=8, loc="lower left")
    _plain_ticks(panels[0].yaxis)
    _plain_ticks(panels[0].xaxis)
    if has_times:
        _draw_times(figure.add_subplot(1, 3, 3), tradeoff, factor, unit)
    figure.suptitle(_title(tradeoff, shown, factor), fontsize=11)
    return figure


def _lower_hull(front: Front) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Bytes and error of the points that no other point beats in both."""
    points = [
        (8.0 * 3 * count * min(n_functions(h), front.n_frames), float(error))
        for branch in front.branches
        for count, row in zip(branch.counts.tolist(), branch.joint_rms, strict=True)
        for h, error in enumerate(row)
    ]
    best, hull = np.inf, []
    for size, error in sorted(points):
        if error < best:
            best = error
            hull.append((size, error))
    sizes, errors = np.array(hull).T if hull else np.zeros((2, 0))
    return sizes, errors


def _simple_kinds(panels: list[Any], tradeoff: Tradeoff, factor: float) -> None:
    """Mark the motions described by a fixed count of numbers."""
    for kind in (SceneKind.RIGID, SceneKind.AFFINE):
        numbers, error = NUMBERS[kind], factor * tradeoff.scene[kind].rms
        if error <= _SMALLEST_SHARE * factor * tradeoff.front.motion_rms:
            continue
        for panel, x in ((panels[0], numbers), (panels[1], 8 * numbers * tradeoff.front.n_frames)):
            panel.plot(x, error, marker="D", markersize=5, color="#555555", zorder=5)
            _note(panel, kind.value, (x, error), (6, 4))


def _draw_times(panel: Any, tradeoff: Tradeoff, factor: float, unit: str) -> None:
    branch = tradeoff.front.branches[0]
    counts = np.array(sorted(tradeoff.fit_milliseconds))
    spent = np.array([tradeoff.fit_milliseconds[n] for n in counts.tolist()])
    errors = factor * branch.rms[np.searchsorted(branch.counts, counts)]
    panel.plot(3 * counts, spent, color=_COLOURS[0], marker="o", markersize=4, linewidth=1.6)
    for n, ms, error in zip(counts.tolist(), spent.tolist(), errors.tolist(), strict=True):
        _note(panel, f"{error:.2g} {unit}", (3 * n, ms), (5, -10))
    panel.set(
        xscale="log",
        yscale="log",
        xlabel="amplitudes per frame",
        ylabel="time of the whole fit (ms)",
        title=f"time ({branch.topology}, {branch.components}; RMS error at each point)",
    )
    panel.title.set_fontsize(9)
    panel.margins(x=0.15, y=0.25)
    panel.grid(True, which="both", color="#e4e4e4", linewidth=0.6)
    chosen = max(tradeoff.chosen.price.amplitudes_per_frame, 1)
    panel.axvline(chosen, color=_CHOSEN, linewidth=0.8, linestyle="--", zorder=1)
    per_frame = 8 * tradeoff.front.n_frames
    above = panel.secondary_xaxis(
        "top", functions=(lambda a: a * per_frame, lambda b: b / per_frame)
    )
    _plain_ticks(panel.xaxis)
    _plain_ticks(panel.yaxis)
    _plain_ticks(above.xaxis, (1.0, 3.0))
    above.set_xlabel("bytes of the trajectory", fontsize=8)
    above.tick_params(labelsize=8)


def _note(panel: Any, text: str, at: tuple[float, float], aside: tuple[int, int]) -> None:
    style = {"textcoords": "offset points", "fontsize": 8, "color": "#555555"}
    panel.annotate(text, at, xytext=aside, **style)


def _plain_ticks(axis: Any, at: tuple[float, ...] = (1.0, 2.0, 5.0)) -> None:
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    axis.set_major_locator(LogLocator(subs=at))
    axis.set_major_formatter(StrMethodFormatter("{x:,g}"))
    axis.set_minor_formatter(NullFormatter())


def _title(tradeoff: Tradeoff, shown: ShownUnit, factor: float) -> str:
    front, chosen = tradeoff.front, tradeoff.chosen
    price, unit = chosen.price, shown.name
    rms, p95, largest = (
        error / shown.size for error in (price.rms_error, price.p95_error, price.max_error)
    )
    text = (
        f"{front.n_frames} frames of {front.n_vertices} vertices, motion "
        f"{factor * front.motion_rms:.3g} {unit} RMS.  Chosen: "
    )
    text += f"{len(chosen.signature.modes)} modes, {price.amplitudes_per_frame} amplitudes, "
    if chosen.signature.parameters.harmonics is not None:
        text += f"{chosen.signature.parameters.harmonics} harmonics, "
    return f"{text}{price.bytes} bytes; {rms:.3g} RMS, {p95:.3g} p95, {largest:.3g} max ({unit})"
