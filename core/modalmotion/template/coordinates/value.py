"""Natural coordinates of a surface of any kind, and where they sit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modalmotion.modes.topology import Topology
from modalmotion.representation import shown
from modalmotion.template.landmarks import Landmarks


@shown("topology", "values", "notes")
@dataclass(frozen=True, eq=False)
class Coordinates:
    """Natural coordinates of one surface.

    Parameters
    ----------
    topology : Topology
    values : (vertices, axes) float64
        s from 0 to 1 on open and pole axes, theta in turns on closed ones.
    landmarks : Landmarks or None
        None where there is no axis.
    notes : tuple of str
        Caveats for the user.
    """

    topology: Topology
    values: NDArray[np.float64]
    landmarks: Landmarks | None
    notes: tuple[str, ...] = ()
