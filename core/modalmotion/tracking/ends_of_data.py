"""Where the data of frames end, and whether the surface ends there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from modalmotion.mesh import face_areas
from modalmotion.tracking.closest import Matches, closest_points
from modalmotion.tracking.cloud_end import DataEnd, end_of_cloud
from modalmotion.tracking.deformable import Deformable
from modalmotion.tracking.noise import Noise, robust_weights
from modalmotion.tracking.observation import NAMED_PLACES, Frame, Observation
from modalmotion.tracking.rim import NEAR_END, Rim, rim_of

# Of a sector: the border of a mesh is along more than that of it, or does not show it.
_LEAST: Final = 0.5


class Lying(NamedTuple):
    """Points that lie evenly on a surface, and their feet on it."""

    part: Observation
    found: Matches


def lies_evenly(part: Observation) -> bool:
    """Return whether nothing is said of points but that they are on the surface."""
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
    offset : float, length unit
        How far beyond the rim they end where it is known: points that represent what is around
        them, such as the vertices of a mesh, end farther out.
    """

    rim: Rim | None = None
    offset: float = 0.0

    def found(
        self,
        surface: Deformable,
        x: NDArray[np.float64],
        even: Sequence[Lying],
        noise: Noise,
    ) -> DataEnd | None:
        """How far the data end beyond the rim of a surface with the vertices x, (vertices, 3)."""
        end = self._seen(surface, x, even, noise)
        return None if end is None else end._replace(beyond=end.beyond - self.offset)

    def _seen(
        self,
        surface: Deformable,
        x: NDArray[np.float64],
        even: Sequence[Lying],
        noise: Noise,
    ) -> DataEnd | None:
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


# Points in a square as wide as a sector: enough to tell a hole from chance.
_OF_SECTOR: Final = 16.0

# Squared distances from places of the surface to points, over those between points: 1 where they
# fall at random, less where they are spread, some 20 along contours.
_MOST_UNEVEN: Final = 3.0

# Of the rim, that the data show in the reference.
_MOST_OF_RIM: Final = 0.5


def with_endings(
    surface: Deformable, frames: Sequence[Frame], noise: Noise, known: int | None
) -> tuple[Frame, ...]:
    """Add to each frame what its data say of where the surface ends.

    Parameters
    ----------
    surface : Deformable
    frames : sequence of Frame
    noise : Noise
    known : int or None
        Frame whose surface the start is: there the end of the data and the rim are compared.

    Notes
    -----
    Frames that state points of an end say it better. Weighted points, profiles and contours do not
    lie evenly.
    """
    x, full = surface.template.vertices, list(frames)
    if known is None:
        return tuple(full)
    are_even = [_are_even(surface, x, frame) for frame in frames]
    for end in NAMED_PLACES:
        pairs = zip(frames, are_even, strict=True)
        kinds = [_kind(frame, end, is_even=is_even) for frame, is_even in pairs]
        kind = kinds[known]
        own = [k for k, name in enumerate(kinds) if kind is not None and name == kind]
        width = (surface.area / noise.n_values) ** 0.5
        if kind == "cloud":
            n = float(np.median([sum(map(len, frames[k])) for k in own]))
            width = max(width, (_OF_SECTOR * surface.area / n) ** 0.5)
        rim = rim_of(surface, end, float(width)) if own else None
        offset = None if rim is None else _offset(surface, rim, frames[known], noise)
        if rim is not None and offset is not None:
            for k in own:
                full[k] = (*full[k], replace(_ending(rim, frames[k]), offset=offset))
    return tuple(full)


def _kind(frame: Frame, end: str, *, is_even: bool) -> str | None:
    """Tell what may show an end in a frame: the border of a mesh, an even cloud, or nothing."""
    if any(part.end == end for part in frame):
        return None
    if any(part.border is not None for part in frame):
        return "mesh"
    return "cloud" if is_even else None


def _are_even(surface: Deformable, x: NDArray[np.float64], frame: Frame) -> bool:
    """Tell points all over a surface from those along lines on it."""
    if any(len(part) and not part.is_landmark and not lies_evenly(part) for part in frame):
        return False
    even = [part.points for part in frame if lies_evenly(part)]
    if sum(map(len, even)) < _OF_SECTOR or surface.cells.shape[1] != 3:
        return False
    feet = closest_points(np.concatenate(even), x, surface.cells).feet
    tree = scipy.spatial.cKDTree(feet)
    between = tree.query(feet, k=2)[0][:, 1]
    away, nearest = tree.query(x[surface.cells].mean(axis=1))
    # Beside the points of the same place: they may be denser here than there.
    ratios = away / np.maximum(between[nearest], 1e-6 * away.max())
    order, areas = np.argsort(ratios, kind="stable"), face_areas(x, surface.cells)
    middle = order[np.searchsorted(np.cumsum(areas[order]), areas.sum() / 2.0)]
    return float(ratios[middle]) ** 2 <= _MOST_UNEVEN


def _ending(rim: Rim, frame: Frame) -> Ending:
    """Middles of a mesh's border and the lengths they represent; no points of a cloud."""
    borders = [part.border for part in frame if part.border is not None]
    if not borders:
        return Ending(np.zeros((0, 3)), end=rim.end, rim=rim)
    sides = np.concatenate(borders)
    lengths = np.linalg.norm(sides[:, 1] - sides[:, 0], axis=1)
    return Ending(sides.mean(axis=1), weights=lengths, end=rim.end, rim=rim)


def _offset(surface: Deformable, rim: Rim, frame: Frame, noise: Noise) -> float | None:
    """Measure how far beyond a rim that is known the data end; None if it cannot be seen.

    As far as it is more than chance: mean squares are shared between both.
    """
    x = surface.template.vertices
    ending = _ending(rim, frame)
    even = [
        Lying(part, closest_points(part.points, x, surface.cells))
        for part in frame
        if lies_evenly(part) and not len(ending)
    ]
    found = ending.found(surface, x, even, noise)
    if found is None or found.shown.mean() < _MOST_OF_RIM:
        return None
    kept = found.shown > 0.0
    chance = float(found.variances[kept].mean()) / kept.sum()
    mean = float(found.beyond[kept].mean())
    # Outward points are looked for twice as far as inward.
    if not -found.most <= mean - np.sign(mean) * 2.0 * chance**0.5 <= 2.0 * found.most:
        return None
    return mean * max(1.0 - chance / mean**2, 0.0) if mean else 0.0
