"""Figures to draw in."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def new_figure(width: float, height: float, dpi: int = 120) -> Figure:
    """Make an empty figure, width by height inches, without a window or global state."""
    # Imported here: only pictures need it.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=dpi, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def hide_spines(axes: Any, *sides: str) -> None:
    """Leave out lines around axes."""
    for side in sides:
        axes.spines[side].set_visible(False)
