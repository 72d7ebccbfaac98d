"""The normal equations of one frame: what its data say of the amplitudes, linear about a shape."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.mesh.normal_lines import vertex_normals
from modalmotion.mesh.triangles import face_normals
from modalmotion.tracking.closest import Matches, closest_points
from modalmotion.tracking.deformable import Deformable
from modalmotion.tracking.ends_of_data import Ending, Lying, lies_evenly
from modalmotion.tracking.noise import Noise, robust_weights
from modalmotion.tracking.observation import Frame, Observation
from modalmotion.tracking.rim import alike_over, place_on, rim_at

# A foot whose distance is not along the normal is on the rim, and pulls along it: such points say
# nothing of where the rim is. Least share of the distance along the normal.
_ALONG: Final = 0.6

_ROWS_AT_ONCE: Final = 4096

# Places of the six entries of a symmetric 3 x 3 matrix.
_UPPER: Final = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


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

    matrix: NDArray[np.float64]
    vector: NDArray[np.float64]
    points: NDArray[np.float64]
    residuals: NDArray[np.float64]
    weights: NDArray[np.float64]
    feet: NDArray[np.int64]
    truncated: NDArray[np.float64]


def across_covariance(seen: NDArray[np.float64], info: NormalEquations) -> NDArray[np.float64]:
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
    surface: Deformable, amplitudes: NDArray[np.float64], frame: Frame, noise: Noise
) -> NormalEquations:
    """Linearise the data term about amplitudes, (modes, 3) float64."""
    m = len(surface)
    A, marks, b = np.zeros((3, 3, m, m)), np.zeros((3, 3, m, m)), np.zeros((m, 3))
    x = surface.positions(amplitudes)
    residuals, weights, feet = [np.zeros((0, 3))], [np.zeros(0)], []
    own = total = 0.0
    even: list[Lying] = []
    for part in frame:
        if isinstance(part, Ending):
            continue
        if part.end is not None:
            _add_end(surface, x, part, part.end, noise, marks, b)
        elif part.is_landmark:
            _add_landmarks(surface, x, part, noise, marks, b)
        elif len(part):
            found = _profile_feet(part, x) or closest_points(part.points, x, surface.cells)
            if lies_evenly(part):
                even.append(Lying(part, found))
            r, w, corners, variance = _add_points(surface, x, part, found, noise, A, b)
            own += float((w * noise.own(part.sd)).sum())
            total += float((w * variance).sum())
            residuals.append(r)
            weights.append(w)
            feet.append(corners)
    for part in frame:
        if isinstance(part, Ending):
            _add_ending(surface, x, part, even, noise, marks, b)
    of_points, matrix = (
        np.ascontiguousarray(own.transpose(2, 0, 3, 1).reshape(3 * m, 3 * m))
        for own in (A, A + marks)
    )
    # (y - x(a)) is what b came from: the target is that much beyond a.
    vector = b.ravel() + (matrix @ amplitudes.reshape(-1, 1))[:, 0]
    points = [part.points for part in frame if not part.is_landmark and len(part)]
    return NormalEquations(
        matrix,
        vector,
        np.concatenate([np.zeros((0, 3)), *points]),
        np.concatenate(residuals),
        np.concatenate(weights),
        np.concatenate(feet) if feet else np.zeros((0, surface.cells.shape[1]), dtype=np.int64),
        (1.0 - own / total if total > 0 else 0.0) * of_points,
    )


def _add_points(
    surface: Deformable,
    x: NDArray[np.float64],
    part: Observation,
    found: Matches,
    noise: Noise,
    A: NDArray[np.float64],
    b: NDArray[np.float64],
) -> tuple[
    NDArray[np.float64],
    NDArray[np.float64],
    NDArray[np.int64],
    NDArray[np.float64] | float,
]:
    normals = found.normals if part.normals is None else part.normals[:, None]
    gap = part.points - found.feet
    along = (normals * gap[:, None]).sum(axis=-1)
    size = np.linalg.norm(along, axis=1)
    # Of two triangles as near a foot between them is on neither more than on the other.
    at_rim = (surface.rim[found.corners] & (found.shares > 0.0)).any(axis=1)
    on_rim = at_rim & (size < _ALONG * found.distances) & (part.feet is None)
    if part.normals is None and surface.cells.shape[1] == 3:
        # Across a ridge the force turns with the point, and does not jump from side to side.
        ridge = (found.shares.min(axis=1) <= 0.0) & ~at_rim & (found.distances > 0.0)
        lift = bulge(found, x, surface.cells, noise.own(part.sd))
        lift[ridge] *= np.sign(along[ridge, 0])
        normals[ridge, 0] = gap[ridge] / found.distances[ridge, None]
        along[ridge, 0] = found.distances[ridge]
        along[:, 0] -= lift
        size = np.abs(along[:, 0])
    kept = ~on_rim
    weights = np.zeros(len(part))
    weights[kept] = robust_weights(size[kept], noise.total)
    counted = weights if part.weights is None else weights * part.weights
    variance = noise.variances(part.sd, float(counted.sum()))
    strength = counted / variance
    _accumulate(surface, found, normals, along, strength, A, b)
    return (normals * along[:, :, None]).sum(axis=1), weights, found.corners, variance


def bulge(
    found: Matches,
    x: NDArray[np.float64],
    cells: NDArray[np.int64],
    variance: NDArray[np.float64] | float,
) -> NDArray[np.float64]:
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
    N = face_normals(x, cells)
    size = (N * N).sum(axis=1)
    normals = vertex_normals(x, cells)
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
    lifted: NDArray[np.float64] = np.clip(heights, -most, most)
    return lifted


def _accumulate(
    surface: Deformable,
    found: Matches,
    normals: NDArray[np.float64],
    along: NDArray[np.float64],
    strength: NDArray[np.float64],
    A: NDArray[np.float64],
    b: NDArray[np.float64],
) -> None:
    """Add Q = n n' of each point: A += phi phi' (x) Q, b += phi (x) Q (y - x)."""
    m = len(surface)
    for start in range(0, len(strength), _ROWS_AT_ONCE):
        rows = slice(start, start + _ROWS_AT_ONCE)
        phi = (found.shares[rows, :, None] * surface.shapes[found.corners[rows]]).sum(axis=1)
        n, s = normals[rows], strength[rows]
        pull = s[:, None] * (n * along[rows][:, :, None]).sum(axis=1)
        sided = np.empty((len(phi), 6 * m + 3))
        for k, (i, j) in enumerate(_UPPER):
            q = s * (n[:, :, i] * n[:, :, j]).sum(axis=1)
            np.multiply(phi, q[:, None], out=sided[:, k * m : (k + 1) * m])
        sided[:, 6 * m :] = pull
        sums = phi.T @ sided
        for k, (i, j) in enumerate(_UPPER):
            block = sums[:, k * m : (k + 1) * m]
            A[i, j] += block
            if i != j:
                A[j, i] += block
        b += sums[:, 6 * m :]


def _add_end(
    surface: Deformable,
    x: NDArray[np.float64],
    part: Observation,
    end: str,
    noise: Noise,
    A: NDArray[np.float64],
    b: NDArray[np.float64],
) -> None:
    """Add points that the rim of an end passes through: their distance counts across the rim.

    Of an end without an opening their middle is a landmark.
    """
    if not len(part):
        return
    sides = rim_at(surface, end)
    if not len(sides):
        sd = None if part.sd is None else float(np.sqrt(np.mean(np.square(part.sd))))
        middle = Observation(part.points.mean(axis=0)[None], sd=sd, places=(end,))
        _add_landmarks(surface, x, middle, noise, A, b)
        return
    found = closest_points(part.points, x, sides)
    normals = found.normals if part.normals is None else part.normals[:, None]
    along = (normals * (part.points - found.feet)[:, None]).sum(axis=-1)
    weights = robust_weights(np.linalg.norm(along, axis=1), noise.total)
    counted = weights if part.weights is None else weights * part.weights
    _accumulate(surface, found, normals, along, counted / noise.variances(part.sd, 1.0), A, b)


def _add_ending(
    surface: Deformable,
    x: NDArray[np.float64],
    part: Ending,
    even: Sequence[Lying],
    noise: Noise,
    A: NDArray[np.float64],
    b: NDArray[np.float64],
) -> None:
    """Add where the data end, one row for each sector of the rim, outward along the surface."""
    found = part.found(surface, x, even, noise)
    if found is None or part.rim is None:
        return
    there = part.rim.at(x)
    variances = found.variances + noise.truncation**2 * there.alike(surface, noise.n_values)
    rows, strength = there.rows(surface), found.shown / variances
    for i in range(3):
        left = np.ascontiguousarray(rows[:, :, i].T)
        b[:, i] += (left @ (strength * found.beyond)[:, None])[:, 0]
        for j in range(3):
            A[i, j] += left @ (strength[:, None] * rows[:, :, j])


def _profile_feet(part: Observation, x: NDArray[np.float64]) -> Matches | None:
    """Feet of profiles, which are known; None of other points."""
    if part.feet is None or part.shares is None or part.normals is None:
        return None
    feet = (part.shares[:, :, None] * x[part.feet]).sum(axis=1)
    distances = np.linalg.norm(part.points - feet, axis=1)
    return Matches(part.feet, part.shares, feet, part.normals[:, None], distances)


def _add_landmarks(
    surface: Deformable,
    x: NDArray[np.float64],
    part: Observation,
    noise: Noise,
    A: NDArray[np.float64],
    b: NDArray[np.float64],
) -> None:
    for row, place in enumerate(part.places or ()):
        vertices, shares = place_on(surface, place)
        phi = (shares[:, None] * surface.shapes[vertices]).sum(axis=0)
        gap = part.points[row] - (shares[:, None] * x[vertices]).sum(axis=0)
        sd = part.sd[row] if isinstance(part.sd, np.ndarray) else None
        weight = 1.0 if part.weights is None else float(part.weights[row])
        alike = alike_over(surface, vertices, shares, noise.n_values)
        strength = weight / float(noise.own(sd) + noise.truncation**2 * alike)
        if part.normals is not None:
            n = part.normals[row]
            for i, j in np.ndindex(3, 3):
                A[i, j] += strength * n[i] * n[j] * phi[:, None] * phi
            b += strength * phi[:, None] * (n @ gap) * n
            continue
        for i in range(3):
            A[i, i] += strength * phi[:, None] * phi
        b += strength * phi[:, None] * gap
