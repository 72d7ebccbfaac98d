"""A picture of strain over time. Needs matplotlib (extra ``plot``)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.clinical.strain import DEFINITIONS, Strain
from modalmotion.errors import needs_extra

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

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
    with needs_extra("plot"):
        from matplotlib.figure import Figure

    figure = Figure(figsize=(7.2, 4.2), dpi=120, layout="constrained")
    draw_strain(figure.add_subplot(), strain, None)
    return figure


def draw_strain(axes: Axes, strain: Strain, times: NDArray[np.float64] | None) -> None:
    """Draw the curves of strain by frame, or by time in s."""
    at = np.arange(len(strain.curves)) if times is None else times
    for name, (colour, style) in zip(DEFINITIONS, _CURVES, strict=True):
        place = strain.names.index(name)
        curve, reach = strain.curves[:, place], 2.0 * strain.deviations[:, place]
        axes.fill_between(at, curve - reach, curve + reach, color=colour, alpha=0.22, lw=0)
        axes.plot(at, curve, lw=1.2, ls=style, color=colour)
        axes.annotate(
            name, (at[-1], curve[strain.end_systole]), fontsize=7, color=colour, ha="right"
        )
    mark_moments(axes, at, strain.end_diastole, strain.end_systole)
    axes.set_xlabel("frame" if times is None else "time (s)", fontsize=8)
    axes.set_ylabel("strain (%)", fontsize=8)
    axes.tick_params(labelsize=7.5)
    axes.grid(alpha=0.25)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def mark_moments(axes: Axes, at: NDArray[Any], start: int, end: int) -> None:
    """Name end diastole and end systole, two frames, above curves over `at`."""
    for frame, name in ((start, "ED"), (end, "ES")):
        axes.axvline(at[frame], color=_SOFT, lw=0.6, ls=":")
        axes.annotate(name, (at[frame], 1.0), xycoords=("data", "axes fraction"), fontsize=6.5)
