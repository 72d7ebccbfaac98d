"""Whether a motion would be an ordinary one if it were several times smaller."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.numeric.frozen_arrays import FrozenArrays
from modalmotion.representation import shown

FACTORS: Final = (2.0, 2.5, 3.0, 4.0)
"""By which a motion may be too large."""

# Fewer training cases do not say how often sizes, shapes and motions occur together; of more
# some do.
_FEWEST: Final = 500
_MOST: Final = 2000

# Of the standard deviations within a class: width of a training case, and the distance below
# which two may be one ventricle in two forms, which are up to as far apart.
_WIDTH: Final = 0.4
_SAME: Final = 0.4

# Share of the training cases, each left out, within the limit.
_KNOWN: Final = 0.998

# Density of what occurs nowhere near.
_NOWHERE: Final = 1e-9
_ROWS: Final = 64


@shown("width")
@dataclass(frozen=True, eq=False)
class MotionScale(FrozenArrays):
    """How often amounts of motion occur on surfaces of a size and shape.

    A place alone says little: there are weak hearts and strong ones. But weak hearts are wide, and
    a wide one that moves as a strong one does is rarer than one that moves a third of it.

    Parameters
    ----------
    points : (cases, 3) float64
        Amount of motion (log), size and shape of the training cases, over their standard
        deviations within a class.
    width : float
        Standard deviation of the amount (log) within a class.
    """

    points: NDArray[np.float64]
    width: float

    def evidence(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """Log of how much more often a motion occurs that is some of `FACTORS` times smaller.

        Parameters
        ----------
        places : (n, 3) float64
            As the points.

        Returns
        -------
        (n,) float64
            0 where nothing like it occurs.
        """
        return self._evidence(places, self._compared, 0.0)

    @cached_property
    def limit(self) -> float:
        """Evidence that few training cases have where they are left out; infinite if unknown."""
        if len(self.points) < _FEWEST or not np.isfinite(self.width):
            return np.inf
        own = self._evidence(self._compared, self._compared, _SAME)
        return max(0.0, float(np.quantile(own, _KNOWN, method="higher")))

    def exceeds(self, place: NDArray[np.float64]) -> bool:
        """Whether the motion at a place, (3,), is surely some times too large."""
        if len(self.points) < _FEWEST:
            return False
        found = float(self.evidence(place[None])[0])
        # The limit, which takes longer, is not below 0.
        return found > 0.0 and found > self.limit

    @cached_property
    def _compared(self) -> NDArray[np.float64]:
        return self._some(_MOST)

    def _some(self, most: int) -> NDArray[np.float64]:
        n = len(self.points)
        rows = np.linspace(0, n - 1, min(n, most)).astype(np.int64)
        return np.asarray(self.points[rows])

    def _evidence(
        self, places: NDArray[np.float64], points: NDArray[np.float64], least: float
    ) -> NDArray[np.float64]:
        parts = [np.zeros(0)]
        for first in range(0, len(places), _ROWS):
            apart = places[first : first + _ROWS, None] - points
            beside = np.einsum("ijk,ijk->ij", apart[..., 1:], apart[..., 1:])
            weights = np.exp(-beside / (2 * _WIDTH**2))
            if least > 0.0:
                weights[beside + apart[..., 0] ** 2 < least**2] = 0.0
            densities = [
                (weights * np.exp(-((apart[..., 0] - step) ** 2) / (2 * _WIDTH**2))).mean(axis=1)
                for step in (0.0, *np.log(FACTORS) / self.width)
            ]
            own, *others = np.stack(densities) + _NOWHERE
            parts.append(np.log(np.max(others, axis=0) / own))
        return np.concatenate(parts)
