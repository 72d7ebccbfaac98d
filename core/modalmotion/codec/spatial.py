"""Which modes a stream is written in."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class Modes(Protocol):
    """An orthonormal basis of the vertices, smoothest modes first."""

    def analyse(self, values: Floats) -> Floats:
        """Values to coefficients, (rows, vertices) to (rows, modes)."""

    def synthesise(self, coefficients: Floats) -> Floats:
        """Coefficients of the first modes to values, (rows, modes) to (rows, vertices)."""
