"""Where a cloud of points ends: how far beyond the rim of a surface, sector by sector."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.mesh import face_areas
from modalmotion.tracking.closest import Matches
from modalmotion.tracking.deformable import Deformable
from modalmotion.tracking.rim import Rim

# Of the noise: the strip in which points are missed, or too many, reaches so far inward.
_REACH: Final = 4.0

# Of the strip's own width beyond it: where the density is counted.
_INSIDE: Final = 4.0

# Points count for the surface up to so many deviations across it, and against it farther out: what
# fills space, as strays do, has as many in both.
_ACROSS: Final = ((2.0, 4.0, 5.5, 6.5), (1.0, -1.0, -1.0, 0.0))

# Points farther than so many deviations from the surface are not on it.
_LYING: Final = 3.0

# Of the density next to it: with less inside a sector has a hole, with more beyond it goes on; with
# less of that all over next to the rim the data end before it.
_LEAST: Final = 0.5


class DataEnd(NamedTuple):
    """Where the data of a frame end.

    Parameters
    ----------
    beyond : (sectors,) float64, length unit
        How far it lies outward of the rim.
    variances : (sectors,) float64, length unit squared
        Of that by chance.
    shown : (sectors,) float64
        From 0 where the data do not come up to the rim, or go on beyond it, to 1.
    most: float, length unit
        That it can be found inward of the rim at once.
    """

    beyond: NDArray[np.float64]
    variances: NDArray[np.float64]
    shown: NDArray[np.float64]
    most: float


def end_of_cloud(
    surface: Deformable,
    rim: Rim,
    x: NDArray[np.float64],
    points: Sequence[tuple[NDArray[np.float64], Matches]],
    noise: float,
    blur: float,
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
        That points lie beside the surface by.
    blur : float, length unit
        That they lie beside their places along it by.

    Returns
    -------
    DataEnd or None
        None where there are too few points.

    Notes
    -----
    With the density rho a strip of the area S and the length w has rho (S + w e) points, e being
    how far their end lies beyond the surface's: those beyond are counted with those within. A point
    counts by psi, 1 at the rim and falling to 0 over the strip, which is linear on each triangle,
    so that points and areas are taken the same way; rho is that of the next strip. Noise along the
    surface leaves the number alone, but for the kink of psi: s^2 / (8 L), L the mean width.

    Under even noise the most likely end has the variance 1.11 s / (rho w); with a strip of 4 s this
    has 1.33 s / (rho w) and more, and needs no more of the noise than its rough size.
    """
    areas = np.bincount(
        surface.cells.ravel(),
        np.repeat(face_areas(x, surface.cells) / 3.0, 3),
        minlength=len(x),
    )
    n, sector, d = rim.n_sectors, rim.sectors, rim.distances
    reach = _REACH * noise
    near = np.clip(1.0 - d / reach, 0.0, 1.0)
    there = rim.at(x)
    near[there.vertices] = 1.0
    total = there.totals
    strip = np.bincount(sector, areas * near, minlength=n)
    wide = float(strip.sum() / total.sum())
    inside = (1.0 - near) * np.clip(2.0 - d / (reach + _INSIDE * wide), 0.0, 1.0)
    back = np.bincount(sector, areas * inside, minlength=n)
    if not (back > 0).all() or not (total > 0).all():
        return None
    ratio = strip / back
    next_to = (1.0 - near) * np.clip(2.0 - d / max(reach, 2.0 * wide, 0.5 * total.mean()), 0.0, 1.0)
    beside = np.bincount(sector, areas * next_to, minlength=n)
    farthest = 2.0 * max(reach, 2.0 * wide)
    at_rim, within, before, after = np.zeros((4, n))
    squares = np.zeros(n)
    on_rim = np.zeros(len(x), dtype=np.bool_)
    on_rim[there.vertices] = True
    for places, found in points:
        kept = ((near + inside)[found.corners] * found.shares > 0).any(axis=1)
        corners, shares = found.corners[kept], found.shares[kept]
        gap = places[kept] - found.feet[kept]
        own = x[corners]
        normal = np.cross(own[:, 1] - own[:, 0], own[:, 2] - own[:, 0])
        normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
        across = np.abs((gap * normal).sum(axis=1))
        outer = (on_rim[corners] | (shares <= 0.0)).all(axis=1)
        far = np.where(outer, np.sqrt(np.maximum((gap**2).sum(axis=1) - across**2, 0.0)), 0.0)
        across = np.where(outer, across, found.distances[kept])
        size = max(noise, 0.5 * wide, 1.4826 * float(np.median(across))) if len(across) else noise
        counts = np.interp(across / size, *_ACROSS)
        close = np.clip(2.0 - far / farthest, 0.0, 1.0)
        own_sector = sector[corners]
        weights = (counts * close)[:, None] * shares
        at_rim += np.bincount(own_sector.ravel(), (weights * near[corners]).ravel(), minlength=n)
        within += np.bincount(own_sector.ravel(), (weights * inside[corners]).ravel(), minlength=n)
        before += np.bincount(own_sector.ravel(), (weights * next_to[corners]).ravel(), minlength=n)
        distant = counts * np.clip(far / farthest - 1.0, 0.0, 1.0) * (far < 3.0 * farthest)
        after += np.bincount(own_sector.ravel(), (distant[:, None] * shares).ravel(), minlength=n)
        each = (weights * (near[corners] - ratio[own_sector] * inside[corners])).sum(axis=1)
        main = own_sector[np.arange(len(corners)), shares.argmax(axis=1)]
        squares += np.bincount(main, each**2, minlength=n)
    density = float(np.median(within / back))
    n_lying = sum(int((found.distances < _LYING * noise).sum()) for _, found in points)
    if not density > _LEAST * n_lying / float(areas.sum()):
        return None
    shown = np.clip(2.0 * before / (density * beside) - _LEAST, 0.0, 1.0)
    shown *= np.clip(1.0 + _LEAST - 2.0 * after / (density * total * farthest), 0.0, 1.0)
    if not shown.any():
        return None
    beyond = (at_rim - ratio * within) / (density * total) - blur**2 / (8.0 * wide)
    per_length = float((shown * squares).sum() / (shown * total).sum()) / density**2
    return DataEnd(beyond, per_length / total, shown, wide)
