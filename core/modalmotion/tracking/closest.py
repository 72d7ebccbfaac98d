"""Closest points of a surface or a curve to points in space."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from modalmotion.representation import Floats, Ints

# Triangles, by their centroids, among which the closest is looked for. The closest point is on
# another one only where triangles are much longer than wide; then the foot is a little farther.
_N_CANDIDATES: Final = 6


@dataclass(frozen=True, eq=False)
class Matches:
    """The closest point, the foot, of each of some points.

    Parameters
    ----------
    corners : (n, corners) int64
        Vertices of the triangle, or of the segment, that the foot is on.
    shares : (n, corners) float64
        Of each corner in the foot; they add up to 1.
    feet : (n, 3) float64, length unit
    normals : (n, rows, 3) float64
        Unit vectors in which a distance counts: of the triangle, or two across a segment.
    distances : (n,) float64, length unit
    """

    corners: Ints
    shares: Floats
    feet: Floats
    normals: Floats
    distances: Floats


def closest_points(points: Floats, positions: Floats, cells: Ints) -> Matches:
    """Find the foot of each point.

    Parameters
    ----------
    points : (n, 3) float64, length unit
    positions : (vertices, 3) float64, length unit
    cells : (cells, 3) or (cells, 2) int64
        Triangles of a surface, or segments of a curve.
    """
    x = positions[cells]
    tree = scipy.spatial.cKDTree(x.mean(axis=1))
    k = min(_N_CANDIDATES, len(cells))
    candidates = np.asarray(tree.query(points, k=k)[1]).reshape(len(points), k)
    c = x[candidates]
    p = points[:, None]
    if cells.shape[1] == 2:
        t, away = _on_segment(p, c[:, :, 0], c[:, :, 1])
        shares = np.stack([1.0 - t, t], axis=-1)
    else:
        shares, away = _on_triangle(p, c[:, :, 0], c[:, :, 1], c[:, :, 2])
    rows = np.arange(len(points))
    best = away.argmin(axis=1)
    shares, corners = shares[rows, best], cells[candidates[rows, best]]
    own = c[rows, best]
    feet = (shares[:, :, None] * own).sum(axis=1)
    if cells.shape[1] == 2:
        normals = across(own[:, 1] - own[:, 0])
    else:
        normals = unit_vectors(np.cross(own[:, 1] - own[:, 0], own[:, 2] - own[:, 0]))[:, None]
    return Matches(corners, shares, feet, normals, np.sqrt(away[rows, best]))


def _dot(a: Floats, b: Floats) -> Floats:
    total: Floats = a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]
    return total


def _on_segment(p: Floats, a: Floats, b: Floats) -> tuple[Floats, Floats]:
    """Share of b in the closest point of a segment, and its squared distance."""
    d, r = b - a, p - a
    length = _dot(d, d)
    t = np.clip(_dot(r, d) / np.where(length > 0, length, 1.0), 0.0, 1.0)
    away = r - t[..., None] * d
    return t, _dot(away, away)


def _on_triangle(p: Floats, a: Floats, b: Floats, c: Floats) -> tuple[Floats, Floats]:
    """Shares of the corners in the closest point of a triangle, and its squared distance."""
    u, v, r = b - a, c - a, p - a
    uu, uv, vv, ru, rv = _dot(u, u), _dot(u, v), _dot(v, v), _dot(r, u), _dot(r, v)
    det = uu * vv - uv * uv
    flat = det <= 1e-30 * uu * vv
    det = np.where(flat, 1.0, det)
    y, z = (vv * ru - uv * rv) / det, (uu * rv - uv * ru) / det
    inside = (y >= 0) & (z >= 0) & (y + z <= 1) & ~flat
    shares = np.stack([1.0 - y - z, y, z], axis=-1)
    away = r - y[..., None] * u - z[..., None] * v
    squared = np.where(inside, _dot(away, away), np.inf)
    # Outside, the closest point is on one of the sides.
    i = np.nonzero(~inside)
    corners = [x[i] for x in (a, b, c)]
    q = np.broadcast_to(p, a.shape)[i]
    best = np.full(len(i[0]), np.inf)
    on_side = np.zeros((len(best), 3))
    for k in range(3):
        t, distance = _on_segment(q, corners[k], corners[(k + 1) % 3])
        nearer = distance < best
        best = np.where(nearer, distance, best)
        side = np.zeros((len(best), 3))
        side[:, k], side[:, (k + 1) % 3] = 1.0 - t, t
        on_side[nearer] = side[nearer]
    shares[i], squared[i] = on_side, best
    return shares, squared


def unit_vectors(v: Floats) -> Floats:
    """Vectors (..., 3) of length 1; zero where they have none."""
    size = np.linalg.norm(v, axis=-1, keepdims=True)
    unit: Floats = v / np.where(size > 0, size, 1.0)
    return unit


def across(tangents: Floats) -> Floats:
    """Two unit vectors across each tangent, (..., 3): (..., 2, 3)."""
    t = unit_vectors(tangents)
    one = unit_vectors(np.cross(t, np.eye(3)[np.abs(t).argmin(axis=-1)]))
    return np.stack([one, np.cross(t, one)], axis=-2)
