"""Whether the data of frames end where the surface does, and so say where its rim is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from modalmotion.mesh import face_areas
from modalmotion.mesh.connectivity import grouped_edges
from modalmotion.tracking.closest import closest_points
from modalmotion.tracking.deformable import Deformable
from modalmotion.tracking.ending import Ending, Lying, lies_evenly
from modalmotion.tracking.noise import Noise
from modalmotion.tracking.observation import NAMED_PLACES, Frame
from modalmotion.tracking.rim import Rim, rim_at, rim_of

# Points in a square as wide as a sector: enough to tell a hole from chance.
_OF_SECTOR: Final = 16.0

# Squared distances from places of the surface to points, over those between points: 1 where they
# fall at random, less where they are spread, some 20 along contours.
_MOST_UNEVEN: Final = 3.0

# Part of an opening, by its width, over which points are looked for: nearer than so many deviations
# and so much of the root of its area.
_OF_LID: Final = 0.5
_LYING: Final = 3.0
_BULGE: Final = 0.1

# Of the rim, that the data show in the reference; and of what can be found, that they are off by.
_MOST_OF_RIM: Final = 0.5
_FAR: Final = 0.5


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
    lie evenly. A cloud that lies over the opening, too, is that of a closed surface.
    """
    x, full = surface.template.vertices, list(frames)
    if known is None:
        return tuple(full)
    are_even = [_are_even(surface, x, frame) for frame in frames]
    for end in NAMED_PLACES:
        pairs = zip(frames, are_even, strict=True)
        kinds = [_kind(frame, end, is_even=is_even) for frame, is_even in pairs]
        kind = kinds[known]
        if kind == "cloud" and _has_lid(surface, x, frames[known], end, noise):
            continue
        own = [k for k, name in enumerate(kinds) if kind is not None and name == kind]
        width = (surface.area / noise.n_values) ** 0.5
        if kind == "cloud":
            n = float(np.median([sum(map(len, frames[k])) for k in own]))
            width = max(width, (_OF_SECTOR * surface.area / n) ** 0.5)
        rim = rim_of(surface, end, float(width)) if own else None
        doubt = None if rim is None else _doubt(surface, rim, frames[known], noise)
        if rim is not None and doubt is not None:
            for k in own:
                full[k] = (*full[k], replace(_ending(rim, frames[k]), doubt=doubt))
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
    between = float(np.median(tree.query(feet, k=2)[0][:, 1]))
    away = tree.query(x[surface.cells].mean(axis=1))[0]
    order, areas = np.argsort(away, kind="stable"), face_areas(x, surface.cells)
    middle = order[np.searchsorted(np.cumsum(areas[order]), areas.sum() / 2.0)]
    return float(away[middle]) ** 2 <= _MOST_UNEVEN * between**2


def _has_lid(
    surface: Deformable, x: NDArray[np.float64], frame: Frame, end: str, noise: Noise
) -> bool:
    """Tell whether points lie over an opening as densely as on the surface."""
    points = np.concatenate([part.points for part in frame if lies_evenly(part)])
    for sides in grouped_edges(rim_at(surface, end), len(x)):
        middle = x[sides].mean(axis=(0, 1))
        # Away from the rim, next to which the wall is.
        ends = middle + _OF_LID * (x[sides] - middle)
        corners = np.concatenate([ends, np.broadcast_to(middle, (len(ends), 1, 3))], axis=1)
        cells = np.arange(3 * len(ends)).reshape(-1, 3)
        lid = corners.reshape(-1, 3)
        area = float(face_areas(lid, cells).sum())
        near = closest_points(points, lid, cells).distances
        # Half-way to the wall at most, whose points are not over a small opening.
        apart = float(np.linalg.norm(x[sides] - middle, axis=2).min()) * (1.0 - _OF_LID) / 2.0
        n = int((near < min(_LYING * noise.sd + _BULGE * area**0.5, apart)).sum())
        if area > 0 and n * surface.area > _MOST_OF_RIM * len(points) * area:
            return True
    return False


def _ending(rim: Rim, frame: Frame) -> Ending:
    """Middles of a mesh's border and the lengths they stand for; no points of a cloud."""
    borders = [part.border for part in frame if part.border is not None]
    if not borders:
        return Ending(np.zeros((0, 3)), end=rim.end, rim=rim)
    sides = np.concatenate(borders)
    lengths = np.linalg.norm(sides[:, 1] - sides[:, 0], axis=1)
    return Ending(sides.mean(axis=1), weights=lengths, end=rim.end, rim=rim)


def _doubt(surface: Deformable, rim: Rim, frame: Frame, noise: Noise) -> float | None:
    """Variance of a sector's end, by how far data end from a rim that is known; None if too far.

    The mean square by which they do, less what chance makes, is taken for all frames; that of the
    whole rim is common to its sectors.
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
    e, chance = found.beyond[kept], float(found.variances[kept].mean())
    mean = float(e.mean())
    if abs(mean) > _FAR * found.most + 2.0 * (chance / len(e)) ** 0.5:
        return None
    of_sectors = max(float((e**2).mean()) - chance, 0.0)
    return of_sectors + rim.n_sectors * max(mean**2 - chance / len(e), 0.0)
