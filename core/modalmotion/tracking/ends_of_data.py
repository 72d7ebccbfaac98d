"""Where the data of frames end, and whether the surface ends there."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import scipy

from modalmotion.mesh import face_areas, vertex_areas
from modalmotion.representation import Floats
from modalmotion.tracking.closest import Matches, closest_points
from modalmotion.tracking.deformable import NEAR_END, Deformable, Rim, rim_at, rim_of
from modalmotion.tracking.noise import Noise
from modalmotion.tracking.observation import NAMED_PLACES, Frame, Observation

# Of the noise: the strip in which points are missed, or too many, reaches so far inward.
_REACH: Final = 4.0

# Points of a sector that the strip has at least: as well is an end known without noise.
_FEWEST: Final = 4.0

# Standard deviation of Gaussian residuals over their median size.
_PER_MEDIAN: Final = 1.4826

# Of the strip's own width beyond it: where the density is counted.
_INSIDE: Final = 4.0

# Points count for the surface up to so many deviations across it, and against it farther out: what
# fills space, as strays do, has as many in both.
_ACROSS: Final = ((2.0, 4.0, 5.5, 6.5), (1.0, -1.0, -1.0, 0.0))

# Points farther than so many deviations from the surface are not on it.
_LYING: Final = 3.0

# Of the density next to it: with less inside a sector has a hole, with more beyond it goes on; with
# less of that all over next to the rim the data end before it.
_LEAST_DENSE: Final = 0.5

# Shares of the corners in places that are all over a triangle alike.
_U, _V = (np.indices((6, 6)).reshape(2, -1) + 0.5) / 6.0
_PLACES: Final = np.stack([1.0 - _U**0.5, _U**0.5 * (1.0 - _V), _U**0.5 * _V], axis=1)


class DataEnd(NamedTuple):
    """Where the data of a frame end.

    Parameters
    ----------
    beyond : (sectors,) float64, length unit
        How far it is outward of the rim.
    variances : (sectors,) float64, length unit squared
        Of that by chance.
    shown : (sectors,) float64
        From 0 where the data do not come up to the rim, or go on beyond it, to 1.
    most: float, length unit
        That it can be found inward of the rim at once.
    """

    beyond: Floats
    variances: Floats
    shown: Floats
    most: float


def end_of_cloud(
    surface: Deformable, rim: Rim, x: Floats, points: Sequence[tuple[Floats, Matches]], noise: float
) -> DataEnd | None:
    """Find where points end that lie evenly on a surface up to its rim.

    Parameters
    ----------
    surface : Deformable
    rim : Rim
    x : (vertices, 3) float64, length unit
        Of the surface.
    points : sequence of ((n, 3) float64, Matches)
        Points, and their feet on it.
    noise : float, length unit
        That points are beside the surface by.

    Returns
    -------
    DataEnd or None
        None if there are too few points.

    Notes
    -----
    With the density rho a strip of the area S and the length w has rho (S + w e) points, e being
    how far their end is beyond the surface's: those beyond are counted with those within. A point
    counts by psi, 1 at the rim and falling evenly to 0 over the strip; rho is that of what is
    behind. Noise along the surface leaves the number alone, but for the kink of psi: s^2 / 8 L,
    L the mean width.

    Under even noise the most likely end has the variance 1.11 s / (rho w). A strip of 4 s leaves
    1.33 s / (rho w), and needs no more of the noise than its rough size.
    """
    n, sector, d = rim.n_sectors, rim.sectors, rim.distances
    areas, of_faces = vertex_areas(x, surface.cells), face_areas(x, surface.cells)
    total = rim.at(x)[1]
    n_lying = sum(int((found.distances < _LYING * noise).sum()) for _, found in points)
    usual = n_lying / float(areas.sum())
    if not usual > 0 or not (total > 0).all():
        return None
    least = _FEWEST / (usual * float(total.mean()))
    reach = max(_REACH * noise, least)
    # Of the strip triangles have parts only.
    cells = d[surface.cells].min(axis=1) < reach
    psi = np.clip(1.0 - d[surface.cells[cells]] @ _PLACES.T / reach, 0.0, 1.0).mean(axis=1)
    thirds = np.repeat(psi * of_faces[cells] / 3.0, 3)
    strip = np.bincount(sector[surface.cells[cells]].ravel(), thirds, minlength=n)
    wide = float(strip.sum() / total.sum())
    # These are linear on each triangle, so that points and areas are taken the same way.
    nearly = np.clip(d / reach, 0.0, 1.0)
    inside = nearly * np.clip(2.0 - d / (reach + _INSIDE * wide), 0.0, 1.0)
    next_to = nearly * np.clip(2.0 - d / max(reach, 0.5 * total.mean()), 0.0, 1.0)
    back = np.bincount(sector, areas * inside, minlength=n)
    beside = np.bincount(sector, areas * next_to, minlength=n)
    if not (back > 0).all() or not (beside > 0).all():
        return None
    ratio, farthest = strip / back, 2.0 * reach
    counted = np.zeros((5, n))
    on_rim = d <= 0.0
    for places, found in points:
        kept = ((inside + next_to + (d < reach))[found.corners] * found.shares > 0).any(axis=1)
        if not kept.any():
            continue
        corners, shares = found.corners[kept], found.shares[kept]
        across, far = _apart(places[kept] - found.feet[kept], x[corners])
        at_edge = (on_rim[corners] | (shares <= 0.0)).all(axis=1)
        far, across = far * at_edge, np.where(at_edge, across, found.distances[kept])
        size = max(noise, 0.5 * least, _PER_MEDIAN * float(np.median(across)))
        counts = np.interp(across / size, *_ACROSS)
        weights = counts * np.clip(2.0 - far / farthest, 0.0, 1.0)
        distant = counts * np.clip(far / farthest - 1.0, 0.0, 1.0) * (far < 3.0 * farthest)
        own = sector[corners].ravel()
        away = (d[corners] * shares).sum(axis=1)
        psi = np.clip(1.0 - away / reach, 0.0, 1.0)[:, None] * shares
        phi, rho = inside[corners] * shares, next_to[corners] * shares
        each = weights * (psi - ratio[sector[corners]] * phi).sum(axis=1)
        sums = [
            np.bincount(own, (values[:, None] * parts).ravel(), minlength=n)
            for values, parts in (
                (weights, psi),
                (weights, phi),
                (weights, rho),
                (distant, shares),
                (each**2, shares),
            )
        ]
        counted += np.array(sums)
    at_rim, within, before, after, squares = counted
    density = float(np.median(within / back))
    if not density > _LEAST_DENSE * usual:
        return None
    shown = np.clip(2.0 * before / (density * beside) - _LEAST_DENSE, 0.0, 1.0)
    shown *= np.clip(1.0 + _LEAST_DENSE - 2.0 * after / (density * total * farthest), 0.0, 1.0)
    if not shown.any():
        return None
    beyond = (at_rim - ratio * within) / (density * total) - noise**2 / (8.0 * wide)
    per_length = float((shown * squares).sum() / (shown * total).sum()) / density**2
    return DataEnd(beyond, per_length / total, shown, wide)


def _apart(gap: Floats, corners: Floats) -> tuple[Floats, Floats]:
    """Parts of gaps across and along the planes of triangles, two (n,)."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    across = np.abs((gap * normal).sum(axis=1))
    return across, np.sqrt(np.maximum((gap**2).sum(axis=1) - across**2, 0.0))


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
    """A cloud ends at a rim: where, is found anew wherever the surface is; it has no points.

    Parameters
    ----------
    rim : Rim
    offset : float, length unit
        How far beyond the rim clouds end where it is known: points that represent what is around
        them, such as the vertices of a mesh, end farther out.
    """

    rim: Rim | None = None
    offset: float = 0.0

    def found(
        self, surface: Deformable, x: Floats, even: Sequence[Lying], noise: Noise
    ) -> DataEnd | None:
        """How far the data end beyond the rim of a surface with the vertices x, (vertices, 3)."""
        if self.rim is None or not even:
            return None
        own = np.concatenate([np.broadcast_to(noise.own(part.sd), len(part)) for part, _ in even])
        beside = float(np.sqrt(own.mean() + noise.truncation**2))
        points = [(part.points, found) for part, found in even]
        end = end_of_cloud(surface, self.rim, x, points, beside)
        return None if end is None else end._replace(beyond=end.beyond - self.offset)


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
    patch = float((surface.area / noise.n_values) ** 0.5)
    for end in NAMED_PLACES:
        pairs = zip(frames, are_even, strict=True)
        kinds = [_kind(frame, end, is_even=is_even) for frame, is_even in pairs]
        own = [k for k, kind in enumerate(kinds) if kind is not None and kind == kinds[known]]
        if kinds[known] == "mesh" and len(rim_at(surface, end)[0]):
            for k in own:
                full[k] = (*full[k], *_border(surface, frames[k], end, patch))
        if kinds[known] == "cloud":
            n = float(np.median([sum(map(len, frames[k])) for k in own]))
            rim = rim_of(surface, end, max(patch, (_OF_SECTOR * surface.area / n) ** 0.5))
            offset = None if rim is None else _offset(surface, rim, frames[known], noise)
            if offset is not None:
                ending = Ending(np.zeros((0, 3)), end=end, rim=rim, offset=offset)
                for k in own:
                    full[k] = (*full[k], ending)
    return tuple(full)


def _kind(frame: Frame, end: str, *, is_even: bool) -> str | None:
    """Return what may show an end in a frame: the border of a mesh, an even cloud, or nothing."""
    if any(part.end == end for part in frame):
        return None
    if any(part.border is not None for part in frame):
        return "mesh"
    return "cloud" if is_even else None


def _border(surface: Deformable, frame: Frame, end: str, patch: float) -> tuple[Observation, ...]:
    """Middles of the sides of a mesh's border near an end, one in all for each patch of it."""
    sides = np.concatenate([part.border for part in frame if part.border is not None])
    middles = sides.mean(axis=1)
    # Holes have borders, too, and other ends.
    feet = closest_points(middles, surface.template.vertices, surface.cells)
    s = (feet.shares * surface.template.coordinates[feet.corners, 0]).sum(axis=1)
    near = np.abs(s - (0.0 if end == "apex" else 1.0)) < NEAR_END
    lengths = np.linalg.norm(sides[:, 1] - sides[:, 0], axis=1)
    if not near.any():
        return ()
    return (Observation(middles[near], weights=lengths[near] / patch, end=end),)


def _are_even(surface: Deformable, x: Floats, frame: Frame) -> bool:
    """Return whether the points cover a surface, rather than lines on it."""
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
    middle = np.quantile(ratios, 0.5, weights=face_areas(x, surface.cells), method="inverted_cdf")
    return float(middle) ** 2 <= _MOST_UNEVEN


def _offset(surface: Deformable, rim: Rim, frame: Frame, noise: Noise) -> float | None:
    """Measure how far beyond a rim that is known the data end; None if it cannot be seen.

    As far as it is more than chance: mean squares are shared between both.
    """
    x = surface.template.vertices
    even = [
        Lying(part, closest_points(part.points, x, surface.cells))
        for part in frame
        if lies_evenly(part)
    ]
    found = Ending(np.zeros((0, 3)), rim=rim).found(surface, x, even, noise)
    if found is None or found.shown.mean() < _MOST_OF_RIM:
        return None
    kept = found.shown > 0.0
    chance = float(found.variances[kept].mean()) / kept.sum()
    mean = float(found.beyond[kept].mean())
    # Outward points are looked for twice as far as inward.
    if not -found.most <= mean - np.sign(mean) * 2.0 * chance**0.5 <= 2.0 * found.most:
        return None
    return mean * max(1.0 - chance / mean**2, 0.0) if mean else 0.0
