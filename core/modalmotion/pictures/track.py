"""Pictures of a track: data, stated error, share determined by data. Needs matplotlib (plot)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ParameterError, TopologyError, needs_extra
from modalmotion.numerals import numeral
from modalmotion.pictures.unit import shown_unit
from modalmotion.pictures.view import size_of, tilted, upright
from modalmotion.tracking.result import STRAY, Track

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_NORMAL: Final = "#1f5fa8"
_TANGENTIAL: Final = "#c4572b"
_DATA: Final = "#222222"

# Frames drawn side by side.
_N_FRAMES: Final = 6


def data_figure(track: Track) -> Figure:
    """Draw the data over the surface, outliers marked, in frames spread over the beat.

    Parameters
    ----------
    track : Track
        Of a surface.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    TopologyError
        If the track is that of a curve.
    ParameterError
        If it has none of its data.
    """
    with needs_extra("plot"):
        from matplotlib.figure import Figure

    _require_surface(track)
    data = track.data
    if data is None:
        raise ParameterError(
            "The track does not contain the data that it was tracked through.",
            remedy="Track the recording again: newer tracks contain some of their points.",
        )
    shown = np.unique(np.linspace(0, track.n_frames - 1, _N_FRAMES).astype(np.int64))
    view = tilted(upright(track.template))
    size = size_of(track.template)
    figure = Figure(figsize=(2.6 * len(shown), 3.2), dpi=120, layout="constrained")
    middle = track.template.weights @ track.template.vertices
    for panel, k in enumerate(shown.tolist()):
        axes: Any = figure.add_subplot(1, len(shown), panel + 1)
        x = (track.sequence.vertices[k] - middle) @ view / size
        axes.triplot(x[:, 0], x[:, 2], track.template.faces, lw=0.25, color=_NORMAL, alpha=0.5)
        rows = data.of_frame(k)
        y = (data.points[rows] - middle) @ view / size
        marks, strays = data.are_landmarks[rows], data.weights[rows] < STRAY
        for chosen, colour, style in (
            (~marks & ~strays, _DATA, {"s": 1.5, "lw": 0}),
            (~marks & strays, _TANGENTIAL, {"s": 2.5, "lw": 0}),
            (marks, _DATA, {"s": 30, "marker": "x"}),
        ):
            axes.scatter(y[chosen, 0], y[chosen, 2], color=colour, zorder=3, **style)
        missing = " (nothing seen)" if k in track.unseen else ""
        axes.set_title(f"frame {k}{missing}", fontsize=9)
        axes.set_aspect("equal")
        axes.set_axis_off()
    rms = track.residuals[:, 0]
    seen = rms[np.isfinite(rms)]
    if len(seen):
        mean = float(seen.mean())
        unit = shown_unit(mean, track.sequence.unit)
        text = f"Data over the surface; residual RMS {numeral(mean / unit.size, 2)} {unit.name}"
        n_strays = int((data.weights < STRAY).sum())
        left_out = f"; {n_strays} of {data.n_points} points are outliers" if n_strays else ""
        figure.suptitle(text + left_out, fontsize=11)
    return figure


def usual_frame(track: Track) -> int:
    """Choose the frame of the smallest volume, or of the largest stated error without volumes."""
    if track.volumes is not None:
        return int(np.argmin(track.volumes))
    return int(np.argmax(track.deviations.mean(axis=(1, 2))))


def deviations_figure(track: Track, frame: int) -> Figure:
    """Draw the stated standard deviation on the surface: across it, and along it.

    Parameters
    ----------
    track : Track
        Of a surface.
    frame : int

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    TopologyError
        If the track is that of a curve.
    """
    with needs_extra("plot"):
        from matplotlib.figure import Figure

    _require_surface(track)
    view = tilted(upright(track.template))
    x = track.sequence.vertices[frame] @ view / size_of(track.template)
    faces = track.template.faces
    figure = Figure(figsize=(8.2, 4.0), dpi=120, layout="constrained")
    unit = shown_unit(float(track.deviations[frame].max()), track.sequence.unit)
    for k, name in enumerate(("across the surface", "along it, from the prior")):
        axes: Any = figure.add_subplot(1, 2, k + 1, projection="3d")
        values = track.deviations[frame, :, k][faces].mean(axis=1) / unit.size
        drawn = axes.plot_trisurf(
            x[:, 0], x[:, 1], x[:, 2], triangles=faces, cmap="viridis", lw=0, antialiased=False
        )
        drawn.set_array(values)
        drawn.autoscale()
        axes.set_axis_off()
        axes.set_box_aspect(np.ptp(x, axis=0))
        axes.view_init(elev=0, azim=-90)
        axes.set_title(name, fontsize=10)
        figure.colorbar(drawn, ax=axes, shrink=0.7, label=f"standard deviation ({unit.name})")
    figure.suptitle(f"Stated error in frame {frame}", fontsize=11)
    return figure


def determined_figure(track: Track) -> Figure:
    """Draw the share of each mode that the data determine: across the surface, and along it.

    Returns
    -------
    matplotlib.figure.Figure
    """
    with needs_extra("plot"):
        from matplotlib.figure import Figure
        from matplotlib.ticker import MaxNLocator

    share: NDArray[np.float64] = 100.0 * track.determined
    at = np.arange(len(share))
    figure = Figure(figsize=(7.2, 3.6), dpi=120, layout="constrained")
    axes = figure.add_subplot()
    axes.bar(at - 0.2, share[:, 0], 0.4, color=_NORMAL, label="across the surface")
    axes.bar(at + 0.2, share[:, 1], 0.4, color=_TANGENTIAL, label="along it")
    axes.axhline(50.0, color=_DATA, lw=0.8, ls="--")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel="mode, by rank", ylabel="determined by the data (%)", ylim=(0, 105))
    undetermined = int((share[:, 1] < 50.0).sum())
    axes.set_title(
        f"{undetermined} of {len(share)} modes undetermined along the surface", fontsize=11
    )
    axes.legend(fontsize=9, frameon=False, loc="upper right")
    return figure


def _require_surface(track: Track) -> None:
    if not len(track.template.faces):
        raise TopologyError(
            "The track is that of a curve, which has no triangles to draw.",
            remedy="Draw the track of a surface.",
        )
