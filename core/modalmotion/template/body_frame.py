"""The frame of a body, directions on its surface, and its affine motions.

Signatures of different patients are compared in the frame of the body: its axis, the direction
in which theta is 0, and the one across both. On a surface with an axis each place has a frame of
its own, too, in which amplitudes read as contraction, twist and shortening.

A heart that contracts evenly moves by an affine map. Modes leave a part of that, which points
outward at the ends and biases volumes to one side. The amplitudes of every affine map are known
from the reference alone, though, so what the modes leave of it can go with them.
"""

from enum import StrEnum
from typing import Final

import numpy as np

from modalmotion import errors, mesh
from modalmotion.mesh.geometry import vertex_normals as normals_of
from modalmotion.numeric.scales import gram, inverse_of_cholesky, lengths
from modalmotion.representation import Floats
from modalmotion.template.landmarks import Landmarks
from modalmotion.template.template import Template, carried_over


class Components(StrEnum):
    """Directions of the three amplitudes of a mode."""

    CARTESIAN = "cartesian"
    CYLINDRICAL = "cylindrical"


def body_frame(landmarks: Landmarks) -> Floats:
    """Rotation from the coordinates of the input to those of the body.

    Parameters
    ----------
    landmarks : Landmarks

    Returns
    -------
    (3, 3) float64
        Its rows are theta_zero, axis x theta_zero, axis: vector in the body = frame @ vector.
    """
    axis, zero = landmarks.axis.tolist(), landmarks.theta_zero.tolist()
    # numpy's vector product takes twenty times as long on one pair.
    across = [axis[i] * zero[j] - axis[j] * zero[i] for i, j in ((1, 2), (2, 0), (0, 1))]
    return np.array([zero, across, axis])


def local_frames(template: Template) -> Floats:
    """Radial, tangential and axial direction at each vertex of the reference.

    Parameters
    ----------
    template : Template

    Returns
    -------
    (vertices, 3, 3) float64
        In the rows of each matrix: away from the axis, in the sense of growing theta, along
        the axis. On the axis itself radial is theta_zero. Vertices in no triangle have those
        of the nearest vertex of the surface.

    Raises
    ------
    TopologyError
        If the surface has no axis.
    """
    landmarks = template.landmarks
    if landmarks is None:
        raise errors.TopologyError(
            "The surface has no axis, so there are no radial, tangential and axial components.",
            remedy="Ask for Cartesian components.",
        )
    vertices = carried_over(template.vertices, template.vertices, template.isolated)
    offsets = vertices - landmarks.origin
    axis = landmarks.axis
    across = offsets - (offsets @ axis)[:, None] * axis
    # Twice, since at a small radius its rounding has a part along the axis.
    across -= (across @ axis)[:, None] * axis
    radius = lengths(across)
    on_axis = ~(radius > 1e-9 * radius.max(initial=0.0))
    radial = across / np.where(on_axis, 1.0, radius)[:, None]
    radial[on_axis] = landmarks.theta_zero
    tangential = np.cross(axis, radial)
    return np.stack([radial, tangential, np.broadcast_to(axis, radial.shape)], axis=1)


def to_local(u: Floats, frames: Floats) -> Floats:
    """Local components of vectors, both with vertices along the memory.

    Parameters
    ----------
    u : (frames, 3, vertices) float64, length unit
        In the coordinates of the input.
    frames : (vertices, n, 3) float64
        From `local_frames`, or other directions at each vertex.

    Returns
    -------
    (frames, n, vertices) float64, length unit
        Radial, tangential, axial.
    """
    E = np.ascontiguousarray(np.moveaxis(frames, 0, 2))
    components = np.empty((len(u), len(E), u.shape[2]))
    for i in range(len(E)):
        np.multiply(u[:, 0], E[i, 0], out=components[:, i])
        for j in (1, 2):
            components[:, i] += u[:, j] * E[i, j]
    return components


def from_local(components: Floats, frames: Floats) -> Floats:
    """Vectors in the coordinates of the input from their local components.

    Parameters
    ----------
    components : (frames, vertices, n) float64, length unit
        Radial, tangential, axial.
    frames : (vertices, n, 3) float64
        From `local_frames`, or other directions at each vertex.

    Returns
    -------
    (frames, vertices, 3) float64, length unit
    """
    return np.asarray(np.einsum("nij,fni->fnj", frames, components))


class Direction(StrEnum):
    """Direction along which the vertices move."""

    NORMAL = "normal"
    X = "x"
    Y = "y"
    Z = "z"
    RADIAL = "radial"
    TANGENTIAL = "tangential"
    AXIAL = "axial"


def directions_on(template: Template, direction: Direction) -> Floats:
    """Point along a direction at each vertex, by a unit vector.

    Parameters
    ----------
    template : Template
    direction : Direction
        Normals point outward; radial, tangential and axial are those of the surface's axis.

    Returns
    -------
    (vertices, 3) float64
        Zero at vertices in no triangle, which have no normal.

    Raises
    ------
    TopologyError
        If the surface has no such direction.
    """
    if direction == Direction.NORMAL:
        return vertex_normals(template)
    if direction in (Direction.X, Direction.Y, Direction.Z):
        along = np.eye(3)["xyz".index(direction.value)]
        return np.broadcast_to(along, (template.n_vertices, 3))
    frames = local_frames(template)
    number = (Direction.RADIAL, Direction.TANGENTIAL, Direction.AXIAL).index(direction)
    return np.asarray(frames[:, number])


def vertex_normals(template: Template) -> Floats:
    """Mean normal, by area, of the triangles around each vertex, outward.

    Parameters
    ----------
    template : Template

    Returns
    -------
    (vertices, 3) float64
        Of a sheet, which has no outside, in the sense of its triangles.

    Raises
    ------
    TopologyError
        If there are no triangles, or the surface has one side only.
    """
    n = template.n_vertices
    proper = np.delete(template.faces, mesh.connectivity_of(template.faces, n).left_out, axis=0)
    faces = mesh.oriented_faces(proper, n) if len(proper) else None
    if faces is None:
        raise errors.TopologyError(
            "A one-sided surface has no consistent normals."
            if len(template.faces)
            else "Vertices without triangles have no normals.",
            remedy="Move it along x, y or z.",
        )
    # At any size: squares of very large or very small numbers overflow or vanish.
    vertices = template.vertices / (float(np.abs(template.vertices).max()) or 1.0)
    normals: Floats = normals_of(vertices, faces)
    offsets = vertices - template.weights @ vertices
    outward = template.weights @ np.einsum("vi,vi->v", normals, offsets)
    # The flux of the offsets is three times the volume inside, signed by the winding.
    if outward < 0 and (template.surface is None or template.surface.closed_axes):
        normals = -normals
    return normals[template.representatives]


HELD: Final = 0.5
"""Share of an affine motion's RMS: motions of which the modes hold less are left to the modes,
whose amplitudes say too little about them."""

# Of the longest axis: a surface thinner than this has no extent in that direction.
_THIN: Final = 1e-6

# Of the mean of the diagonal: keeps shapes apart that few vertices cannot resolve.
_RIDGE: Final = 1e-12


def unit_coordinates(rest: Floats, weights: Floats) -> Floats:
    """Coordinates along the principal axes and 1, each with mean square 1 and uncorrelated.

    Parameters
    ----------
    rest : (vertices, 3) float64
        In a unit in which they are of size 1, or nearly so.
    weights : (vertices,) float64
        Their sum is 1.

    Returns
    -------
    (vertices, 4) float64, 1
        Fewer columns where the surface has no extent in a direction.
    """
    y = rest - (weights @ rest)
    squares, axes = np.linalg.eigh((y * weights[:, None]).T @ y)
    wide = squares > _THIN**2 * squares[-1]
    along = y @ (axes[:, wide] / np.sqrt(squares[wide]))
    return np.concatenate([along, np.ones((len(y), 1))], axis=1)


def affine_shapes(shapes: Floats, template: Template) -> Floats:
    """Mode shapes whose superposition is exact for affine motions.

    Parameters
    ----------
    shapes : (vertices, modes) float64
        Phi, with mean square 1.
    template : Template

    Returns
    -------
    (vertices, modes) float64
        What is superposed has the same amplitudes, by weighted least squares, as before.

    Notes
    -----
    A motion moves each direction by a combination c of the unit coordinates q, with the amplitudes
    P q c, P the projector on the modes. The other way round amplitudes a belong to c = (P q)^+ a,
    of which the modes leave (q - Phi P q) c. That is added: Phi + (q - Phi P q) (P q)^+. As P of
    what is left is zero, the amplitudes stay. The same holds in each direction, so that one
    matrix serves all three.
    """
    w, size = template.weights, float(np.abs(template.vertices).max(initial=0.0))
    if not size > 0:
        return shapes
    q = unit_coordinates(template.vertices / size, w)
    weighted = np.ascontiguousarray((w[:, None] * shapes).T)
    G = weighted @ shapes
    G[np.diag_indices(len(G))] += _RIDGE * np.trace(G) / len(G)
    held = gram(inverse_of_cholesky(G)) @ (weighted @ q)
    # (P q)^+ over the combinations that the modes hold: S^2 are the eigenvalues of (P q)' P q.
    squares, V = np.linalg.eigh(held.T @ held)
    V, squares = V[:, squares > HELD**2], squares[squares > HELD**2]
    if not len(squares):
        return shapes
    inverse = ((V / squares) @ V.T) @ held.T
    whole = shapes + ((q - (shapes @ held)) @ inverse)
    return carried_over(whole, template.vertices, template.isolated)
