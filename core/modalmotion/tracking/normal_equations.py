"""The normal equations of one frame: what its data say of the amplitudes, linear about a shape."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from modalmotion.mesh import geometry, triangles
from modalmotion.numeric.scales import gram
from modalmotion.representation import Array, Floats, Ints
from modalmotion.tracking.closest import Matches, closest_points
from modalmotion.tracking.deformable import Deformable, alike_over, place_on, rim_at
from modalmotion.tracking.ends_of_data import Ending, Lying, lies_evenly
from modalmotion.tracking.noise import Noise, robust_weights
from modalmotion.tracking.observation import Frame, Observation

# A point whose distance is not along the normal has its foot on the rim, which it would pull along:
# such points say nothing of where the rim is. Shares of the distance along the normal from which on
# points count, and from which on in full: what switches at once lets no iteration come to rest.
_ALONG: Final = (0.4, 0.8)

_ROWS_AT_ONCE: Final = 4096


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Quadratic data term a'Aa / 2 - b'a of one frame, and the residuals it comes from.

    Parameters
    ----------
    matrix : (3 modes, 3 modes) float64
        A; the column of mode j and direction i is 3 j + i.
    vector : (3 modes,) float64
        b.
    points : (n, 3) float64, length unit
    residuals : (n, 3) float64, length unit
        From the surface to each point, across it.
    weights : (n,) float64
        That they counted with, from 0 of a stray to 1.
    feet : (n, corners) int64
        Corners of the triangle next to each.
    truncated : (3 modes, 3 modes) float64
        Of the part of A that points make, the share of their variance that is no noise of theirs.
    """

    matrix: Floats
    vector: Floats
    points: Floats
    residuals: Floats
    weights: Floats
    feet: Ints
    truncated: Floats


def across_covariance(seen: Floats, info: NormalEquations) -> Floats:
    """Covariance of the amplitudes as far as it shows across the surface.

    Parameters
    ----------
    seen : (3 modes, 3 modes) float64, length unit squared
        C, of the amplitudes, as they were estimated.
    info : NormalEquations
        The part (1 - q) A of what it comes from that is no noise of points.

    Notes
    -----
    Noise, and truncation, reach the amplitudes through C A C. Along the surface nothing shows it.
    Across, what truncation does to the amplitudes is in the residuals already, from which T is
    taken: there only the share of the noise counts, C - (1 - q) C A C.
    """
    return seen - ((seen @ info.truncated) @ seen)


def normal_equations(
    surface: Deformable, amplitudes: Floats, frame: Frame, noise: Noise
) -> NormalEquations:
    """Linearise the data term about amplitudes, (modes, 3) float64."""
    x = surface.positions(amplitudes)
    of_points, marks = _Sum(len(surface)), _Sum(len(surface))
    seen: list[tuple[Array, ...]] = []
    own = total = 0.0
    even: list[Lying] = []
    for part in frame:
        if isinstance(part, Ending) or not len(part):
            continue
        if part.is_landmark:
            _add_marks(marks, surface, x, part, noise)
            continue
        found = _profile_feet(part, x) or closest_points(part.points, x, surface.cells)
        if lies_evenly(part):
            even.append(Lying(part, found))
        r, w, variance = _add_points(of_points, surface, x, part, found, noise)
        own += float((w * noise.own(part.sd)).sum())
        total += float((w * variance).sum())
        seen.append((part.points, r, w, found.corners))
    for part in frame:
        end = part.found(surface, x, even, noise) if isinstance(part, Ending) else None
        if isinstance(part, Ending) and part.rim is not None and end is not None:
            rows, alike = part.rim.rows(surface, x, noise.n_values)
            marks.add(rows, end.beyond, end.shown / (end.variances + noise.truncation**2 * alike))
    matrix = of_points.matrix + marks.matrix
    # (y - x(a)) is what b came from: the target is that much beyond a.
    vector = of_points.vector + marks.vector + (matrix @ amplitudes.reshape(-1, 1))[:, 0]
    none = np.zeros((0, 3))
    seen = seen or [(none, none, none[:, 0], np.zeros((0, surface.cells.shape[1]), np.int64))]
    points, residuals, weights, feet = (np.concatenate(each) for each in zip(*seen, strict=True))
    truncated = (1.0 - own / total if total > 0 else 0.0) * of_points.matrix
    return NormalEquations(matrix, vector, points, residuals, weights, feet, truncated)


class _Sum:
    """Sum over rows of s r' r and of s r' g, with the gap g along a row r of amplitudes."""

    def __init__(self, n_modes: int) -> None:
        self.matrix = np.zeros((3 * n_modes, 3 * n_modes))
        self.vector = np.zeros(3 * n_modes)

    def add(self, rows: Floats, gaps: Floats, strengths: Floats) -> None:
        """Add rows (n, modes, 3), gaps (n,) and strengths (n,)."""
        flat = rows.reshape(len(rows), -1) * np.sqrt(strengths)[:, None]
        self.matrix += gram(flat)
        self.vector += (flat.T @ (np.sqrt(strengths) * gaps)[:, None])[:, 0]

    def add_feet(
        self, surface: Deformable, found: Matches, normals: Floats, along: Floats, strengths: Floats
    ) -> None:
        """Add distances (n, directions) along normals (n, directions, 3) at the feet of points."""
        for start in range(0, len(strengths), _ROWS_AT_ONCE):
            own = slice(start, start + _ROWS_AT_ONCE)
            phi = (found.shares[own, :, None] * surface.shapes[found.corners[own]]).sum(axis=1)
            for k in range(normals.shape[1]):
                rows = phi[:, :, None] * normals[own, k, None, :]
                self.add(rows, along[own, k], strengths[own])


def _add_points(
    total: _Sum, surface: Deformable, x: Floats, part: Observation, found: Matches, noise: Noise
) -> tuple[Floats, Floats, Floats | float]:
    """Add points; their residuals, weights and variances."""
    normals = found.normals if part.normals is None else part.normals[:, None]
    is_surface = part.normals is None and surface.cells.shape[1] == 3
    if is_surface:
        # These turn as evenly as the surface, and not at the sides of triangles, where forces
        # would jump as often as points slide across.
        at_corners = geometry.vertex_normals(x, surface.cells)[found.corners]
        turned = (found.shares[:, :, None] * at_corners).sum(axis=1)
        size = np.linalg.norm(turned, axis=1, keepdims=True)
        normals = np.where(size > 0, turned / np.where(size > 0, size, 1.0), normals[:, 0])[:, None]
    along = (normals * (part.points - found.feet)[:, None]).sum(axis=-1)
    weights = np.ones(len(part))
    if part.feet is None:
        share = np.linalg.norm(along, axis=1) / np.where(found.distances > 0, found.distances, 1.0)
        at_rim = (surface.rim[found.corners] & (found.shares > 0.0)).any(axis=1)
        at_rim &= found.distances > 0
        least, full = _ALONG
        weights[at_rim] = np.clip((share[at_rim] - least) / (full - least), 0.0, 1.0)
    if is_surface:
        along[:, 0] -= bulge(found, x, surface.cells, noise.own(part.sd))
    kept = weights > 0
    weights[kept] *= robust_weights(np.linalg.norm(along[kept], axis=1), noise.total)
    counted = weights if part.weights is None else weights * part.weights
    variance = noise.variances(part.sd, float(counted.sum()))
    total.add_feet(surface, found, normals, along, counted / variance)
    return (normals * along[:, :, None]).sum(axis=1), weights, variance


def bulge(found: Matches, x: Floats, cells: Ints, variance: Floats | float) -> Floats:
    """Height that noise lifts points off a curved surface by, in the mean, (n,).

    Parameters
    ----------
    found : Matches
        Of each point on the surface.
    x : (vertices, 3) float64, length unit
    cells : (triangles, 3) int64
    variance : float or (n,) float64, length unit squared
        Of the noise in each direction.

    Notes
    -----
    Moved along a surface of the curvatures k1, k2 by e1, e2, a point is (k1 e1^2 + k2 e2^2) / 2
    beside it, on the outside of what is round: s^2 (k1 + k2) / 2 in the mean. k1 + k2 is the
    divergence of the normals, on a triangle sum n_i . grad phi_i. It holds for noise smaller than
    the radius; no more than half a deviation is taken.
    """
    corners = x[cells]
    N = triangles.face_normals(x, cells)
    size = (N * N).sum(axis=1)
    normals = geometry.vertex_normals(x, cells)
    # 2 A grad phi_i = N / |N| x (the side opposite i), |N| = 2 A.
    total = np.zeros(len(cells))
    for i in range(3):
        side = corners[:, (i + 2) % 3] - corners[:, (i + 1) % 3]
        total += (normals[cells[:, i]] * np.cross(N, side)).sum(axis=1)
    divergence = total / np.where(size > 0, size, 1.0)
    areas = np.sqrt(size)
    near = np.bincount(cells.ravel(), np.repeat(areas, 3), minlength=len(x))
    sums = np.bincount(cells.ravel(), np.repeat(areas * divergence, 3), minlength=len(x))
    curvature = sums / np.where(near > 0, near, 1.0)
    most = 0.5 * np.sqrt(variance)
    heights = (found.shares * curvature[found.corners]).sum(axis=1) * variance / 2.0
    lifted: Floats = np.clip(heights, -most, most)
    return lifted


def _add_marks(
    total: _Sum, surface: Deformable, x: Floats, part: Observation, noise: Noise
) -> None:
    """Add landmarks, or points that the rim of an end passes through."""
    sides = np.zeros((0, 2), np.int64) if part.end is None else rim_at(surface, part.end)[0]
    if part.end is not None and len(sides):
        # Their distance counts across the rim.
        found = closest_points(part.points, x, sides)
        normals = found.normals if part.normals is None else part.normals[:, None]
        along = (normals * (part.points - found.feet)[:, None]).sum(axis=-1)
        weights = robust_weights(np.linalg.norm(along, axis=1), noise.total)
        counted = weights if part.weights is None else weights * part.weights
        strengths = counted / noise.variances(part.sd, 1.0)
        total.add_feet(surface, found, normals, along, np.asarray(strengths))
        return
    if part.end is not None:
        # Of an end without an opening their middle is a landmark.
        sd = None if part.sd is None else float(np.sqrt(np.mean(np.square(part.sd))))
        part = Observation(part.points.mean(axis=0)[None], sd=sd, places=(part.end,))
    for row, place in enumerate(part.places or ()):
        vertices, shares = place_on(surface, place)
        phi = (shares[:, None] * surface.shapes[vertices]).sum(axis=0)
        gap = part.points[row] - (shares[:, None] * x[vertices]).sum(axis=0)
        sd = part.sd[row] if isinstance(part.sd, np.ndarray) else None
        weight = 1.0 if part.weights is None else float(part.weights[row])
        alike = alike_over(surface, vertices, shares, noise.n_values)
        strength = weight / float(noise.own(sd) + noise.truncation**2 * alike)
        directions = np.eye(3) if part.normals is None else part.normals[row, None]
        rows = phi[None, :, None] * directions[:, None]
        total.add(rows, directions @ gap, np.full(len(rows), strength))


def _profile_feet(part: Observation, x: Floats) -> Matches | None:
    """Feet of profiles, which are known; None of other points."""
    if part.feet is None or part.shares is None or part.normals is None:
        return None
    feet = (part.shares[:, :, None] * x[part.feet]).sum(axis=1)
    distances = np.linalg.norm(part.points - feet, axis=1)
    return Matches(part.feet, part.shares, feet, part.normals[:, None], distances)
