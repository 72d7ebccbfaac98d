"""Scale bar and axes of the file in a picture of a surface."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.pictures.unit import shown_unit

_INK: Final = "#444a52"
# Of the picture's extent: the longest bar, the arrows, and how far below the surface they are.
_LONGEST: Final = 0.4
_ARROW: Final = 0.1
_BELOW: Final = 0.1

# Letters of the patient's sides that the axes point to, by coordinates.
_LETTERS: Final = {"LPS": ("L", "P", "S"), "RAS": ("R", "A", "S")}


def round_length(longest: float) -> float:
    """Largest of 1, 2 and 5 times a power of ten that is not longer."""
    power = 10.0 ** math.floor(math.log10(longest))
    return next(k * power for k in (5.0, 2.0, 1.0) if k * power <= longest * (1 + 1e-12))


def draw_scale(
    axes: Any,
    box: NDArray[np.float64],
    view: NDArray[np.float64],
    *,
    size: float,
    unit: str | None,
    coordinates: str,
    azimuth: float,
) -> None:
    """Draw a scale bar, and the directions of x, y and z, below a surface.

    Parameters
    ----------
    axes : matplotlib 3D axes
        Orthographic, so that the bar is valid everywhere.
    box : (points, 3) float64
        As drawn.
    view : (3, 3) float64
        Positions of the file, as rows, times it are in the axes of the picture.
    size : float
        Length that is drawn as 1.
    unit : str or None
    coordinates : {"LPS", "RAS", "unknown"}
        Of the file: letters of the patient's sides replace x, y and z if they are known.
    azimuth : float
        Of the view, degrees.
    """
    low, high = box.min(axis=0), box.max(axis=0)
    extent, middle = float((high - low).max()), (low + high) / 2
    if not extent > 0:
        return
    angle = math.radians(azimuth)
    right = np.array([-math.sin(angle), math.cos(angle), 0.0])
    down = middle - [0.0, 0.0, (high[2] - low[2]) / 2 + _BELOW * extent]
    shown = shown_unit(extent * size, unit)
    length = round_length(_LONGEST * extent * size / shown.size)
    start = down + 0.05 * extent * right
    end = start + length * shown.size / size * right
    # Below the box of the axes, whose size is unchanged.
    line = {"color": _INK, "clip_on": False, "in_layout": False}
    axes.plot(*zip(start, end, strict=True), lw=2.2, solid_capstyle="butt", **line)
    style = {"color": _INK, "fontsize": 8, "ha": "center", "va": "top", "in_layout": False}
    below = (start + end) / 2 - [0.0, 0.0, 0.025 * extent]
    axes.text(*below, f"{length:g} {shown.name}", **style)
    corner = down - 0.34 * extent * right - [0.0, 0.0, 0.06 * extent]
    for name, direction in zip(_LETTERS.get(coordinates, ("x", "y", "z")), view, strict=True):
        tip = corner + _ARROW * extent * direction
        axes.plot(*zip(corner, tip, strict=True), lw=1.1, **line)
        letter = corner + 1.4 * _ARROW * extent * direction
        axes.text(*letter, name, **{**style, "va": "center"})
