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
_LEAST: Final = 0.5


def _middles(n: int) -> NDArray[np.float64]:
    """Shares of the corners in the middles of the n^2 equal parts of a triangle, (n^2, 3)."""
    rows = []
    for i in range(n):
        for j in range(n - i):
            rows.append((3 * i + 1, 3 * j + 1))
            if i + j < n - 1:
                rows.append((3 * i + 2, 3 * j + 2))
    u, v = np.array(rows, dtype=np.float64).T / (3 * n)
    return np.stack([1.0 - u - v, u, v], axis=1)


_MIDDLES: Final = _middles(6)


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
        That points are beside the surface by.
    blur : float, length unit
        That they are beside their places along it by.

    Returns
    -------
    DataEnd or None
        None if there are too few points.

    Notes
    -----
    With the density rho a strip of the area S and the length w has rho (S + w e) points, e being
    how far their end is beyond the surface's: those beyond are counted with those within. A point
    counts by psi, 1 at the rim and falling evenly to 0 over the strip; rho is that of what is
    behind. Noise along the surface leaves the number alone, but for the kink of psi: s^2 / 8 L, L
    the mean width.

    Under even noise the most likely end has the variance 1.11 s / (rho w). A strip of 4 s leaves
    1.33 s / (rho w), and needs no more of the noise than its rough size.
    """
    of_faces = face_areas(x, surface.cells)
    areas = np.bincount(surface.cells.ravel(), np.repeat(of_faces / 3.0, 3), minlength=len(x))
    there, n, sector, d = rim.at(x), rim.n_sectors, rim.sectors, rim.distances
    total = there.totals
    n_lying = sum(int((found.distances < _LYING * noise).sum()) for _, found in points)
    usual = n_lying / float(areas.sum())
    if not usual > 0 or not (total > 0).all():
        return None
    least = _FEWEST / (usual * float(total.mean()))
    reach = max(_REACH * noise, least)
    strip = _areas_of_strip(surface, rim, of_faces, reach)
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
    at_rim, within, before, after, squares = np.zeros((5, n))
    on_rim = np.zeros(len(x), dtype=np.bool_)
    on_rim[there.vertices] = True
    for places, found in points:
        kept = ((inside + next_to + on_rim)[found.corners] * found.shares > 0).any(axis=1)
        if not kept.any():
            continue
        corners, shares = found.corners[kept], found.shares[kept]
        own = sector[corners]
        across, far = _apart(places[kept] - found.feet[kept], x[corners])
        at_edge = (on_rim[corners] | (shares <= 0.0)).all(axis=1)
        far[~at_edge], across[~at_edge] = 0.0, found.distances[kept][~at_edge]
        size = max(noise, 0.5 * least, _PER_MEDIAN * float(np.median(across)))
        counts = np.interp(across / size, *_ACROSS)
        close = np.clip(2.0 - far / farthest, 0.0, 1.0)
        psi = np.clip(1.0 - (shares * d[corners]).sum(axis=1) / reach, 0.0, 1.0)
        weights = (counts * close)[:, None] * shares

        def summed(
            values: NDArray[np.float64], own: NDArray[np.int64] = own
        ) -> NDArray[np.float64]:
            sums = np.bincount(own.ravel(), values.ravel(), minlength=n)
            return sums.astype(np.float64)

        at_rim += summed(weights * psi[:, None])
        within += summed(weights * inside[corners])
        before += summed(weights * next_to[corners])
        distant = counts * np.clip(far / farthest - 1.0, 0.0, 1.0) * (far < 3.0 * farthest)
        after += summed(distant[:, None] * shares)
        each = (weights * (psi[:, None] - ratio[own] * inside[corners])).sum(axis=1)
        squares += summed(each[:, None] ** 2 * shares)
    density = float(np.median(within / back))
    if not density > _LEAST * usual:
        return None
    shown = np.clip(2.0 * before / (density * beside) - _LEAST, 0.0, 1.0)
    shown *= np.clip(1.0 + _LEAST - 2.0 * after / (density * total * farthest), 0.0, 1.0)
    if not shown.any():
        return None
    beyond = (at_rim - ratio * within) / (density * total) - blur**2 / (8.0 * wide)
    per_length = float((shown * squares).sum() / (shown * total).sum()) / density**2
    return DataEnd(beyond, per_length / total, shown, wide)


def _areas_of_strip(
    surface: Deformable, rim: Rim, areas: NDArray[np.float64], reach: float
) -> NDArray[np.float64]:
    """Integral of psi next to each sector, (sectors,): triangles are cut in small ones."""
    d = rim.distances[surface.cells]
    near = d.min(axis=1) < reach
    psi = np.clip(1.0 - d[near] @ _MIDDLES.T / reach, 0.0, 1.0)
    # Of each piece its corners' sectors have the shares of its middle.
    parts = psi @ _MIDDLES * (areas[near] / len(_MIDDLES))[:, None]
    own = rim.sectors[surface.cells[near]]
    sums = np.bincount(own.ravel(), parts.ravel(), minlength=rim.n_sectors)
    return sums.astype(np.float64)


def _apart(
    gap: NDArray[np.float64], corners: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Parts of gaps across and along the planes of triangles, two (n,)."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    across = np.abs((gap * normal).sum(axis=1))
    return across, np.sqrt(np.maximum((gap**2).sum(axis=1) - across**2, 0.0))
