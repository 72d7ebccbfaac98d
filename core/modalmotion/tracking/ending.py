"""Where the data of a frame end, as an observation of a rim."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.tracking.closest import Matches, closest_points
from modalmotion.tracking.cloud_end import DataEnd, end_of_cloud
from modalmotion.tracking.deformable import Deformable
from modalmotion.tracking.noise import Noise, robust_weights
from modalmotion.tracking.observation import Observation
from modalmotion.tracking.rim import NEAR_END, Rim

# Of a sector: the border of a mesh lies along more than that of it, or does not show it.
_LEAST: Final = 0.5


class Lying(NamedTuple):
    """Points that lie evenly on a surface, and their feet on it."""

    part: Observation
    found: Matches


def lies_evenly(part: Observation) -> bool:
    """Tell whether nothing is said of points but that they are on the surface."""
    said = (part.weights, part.normals, part.places, part.feet, part.end)
    return len(part) > 0 and all(value is None for value in said)


@dataclass(frozen=True, eq=False)
class Ending(Observation):
    """The data of a frame end at a rim.

    Parameters
    ----------
    points : (n, 3) float64, length unit
        Middles of the sides of a mesh's border, their lengths as `weights`; none of a cloud, whose
        end is found anew wherever the surface is.
    rim : Rim
    doubt : float, length unit squared
        Variance of the end in each sector, beside chance and what the modes leave.
    """

    rim: Rim | None = None
    doubt: float = 0.0

    def found(
        self,
        surface: Deformable,
        x: NDArray[np.float64],
        even: Sequence[Lying],
        noise: Noise,
    ) -> DataEnd | None:
        """How far the data end beyond the rim of a surface with the vertices x, (vertices, 3)."""
        if self.rim is None:
            return None
        if len(self):
            return self._of_border(surface, self.rim, x, noise)
        if not even:
            return None
        own = np.concatenate([np.broadcast_to(noise.own(part.sd), len(part)) for part, _ in even])
        blur = float(np.sqrt(own.mean()))
        points = [(part.points, found) for part, found in even]
        beside = float(np.hypot(blur, noise.truncation))
        return end_of_cloud(surface, self.rim, x, points, beside, blur)

    def _of_border(
        self, surface: Deformable, rim: Rim, x: NDArray[np.float64], noise: Noise
    ) -> DataEnd | None:
        # Holes have borders, too, and other ends.
        feet = closest_points(self.points, x, surface.cells)
        s = (feet.shares * surface.template.coordinates[feet.corners, 0]).sum(axis=1)
        is_near = np.abs(s - (0.0 if rim.end == "apex" else 1.0)) < NEAR_END
        if not is_near.any():
            return None
        found = closest_points(self.points, x, rim.sides)
        there = rim.at(x)
        place = np.searchsorted(there.vertices, found.corners)
        outward = (found.shares[:, :, None] * there.directions[place]).sum(axis=1)
        gap = ((self.points - found.feet) * outward).sum(axis=1)
        weights = np.zeros(len(self))
        weights[is_near] = robust_weights(found.distances[is_near], noise.total)
        weights = weights * (1.0 if self.weights is None else self.weights)
        nearest = found.corners[np.arange(len(self)), found.shares.argmax(axis=1)]
        n, sector = rim.n_sectors, rim.sectors[nearest]
        total = np.bincount(sector, weights, minlength=n)
        kept = np.where(total > 0, total, 1.0)
        beyond = np.bincount(sector, weights * gap, minlength=n) / kept
        own = np.broadcast_to(noise.own(self.sd), len(self))
        variances = np.bincount(sector, weights**2 * own, minlength=n) / kept**2
        shown = np.clip(2.0 * total / there.totals - _LEAST, 0.0, 1.0)
        return DataEnd(beyond, variances, shown, np.inf) if shown.any() else None
