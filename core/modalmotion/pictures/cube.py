"""The cube in which a surface is drawn."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def fill_cube(axes: Any, points: NDArray[np.float64]) -> None:
    """Set invisible axes of equal scale that the points fill.

    Parameters
    ----------
    axes : matplotlib 3D axes
    points : (points, 3) float64
    """
    low, high = points.min(axis=0), points.max(axis=0)
    reach, middle = float((high - low).max()) / 2 or 1.0, (low + high) / 2
    axes.set(
        xlim=(middle[0] - reach, middle[0] + reach),
        ylim=(middle[1] - reach, middle[1] + reach),
        zlim=(middle[2] - reach, middle[2] + reach),
    )
    axes.set_box_aspect((1, 1, 1), zoom=1.5)
    axes.set_axis_off()
