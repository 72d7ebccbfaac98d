"""Directions in which a surface is moved: its normals, those of its axis, or x, y, z."""

from __future__ import annotations

from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import TopologyError
from modalmotion.mesh import connectivity_of, face_normals, oriented_faces
from modalmotion.numeric.scale import lengths
from modalmotion.template.body_frame import local_frames
from modalmotion.template.template import Template


class Direction(StrEnum):
    """Direction along which the vertices move."""

    NORMAL = "normal"
    X = "x"
    Y = "y"
    Z = "z"
    RADIAL = "radial"
    TANGENTIAL = "tangential"
    AXIAL = "axial"


def directions_on(template: Template, direction: Direction) -> NDArray[np.float64]:
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
    directions: NDArray[np.float64] = frames[:, number]
    return directions


def vertex_normals(template: Template) -> NDArray[np.float64]:
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
    proper = np.delete(template.faces, connectivity_of(template.faces, n).left_out, axis=0)
    faces = oriented_faces(proper, n) if len(proper) else None
    if faces is None:
        raise TopologyError(
            "A surface with one side has no normals."
            if len(template.faces)
            else "Vertices without triangles have no normals.",
            remedy="Move it along x, y or z.",
        )
    # At any size: squares of very large or very small numbers overflow or vanish.
    vertices = template.vertices / (float(np.abs(template.vertices).max()) or 1.0)
    of_faces = face_normals(vertices, faces)
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], of_faces)
    offsets = vertices - template.weights @ vertices
    # The flux of the offsets is three times the volume inside, signed by the winding.
    if float(np.einsum("vi,vi->", normals, offsets)) < 0 and _has_inside(template):
        normals = -normals
    size = lengths(normals)
    normals /= np.where(size > 0, size, 1.0)[:, None]
    return normals[template.representatives]


def _has_inside(template: Template) -> bool:
    return template.surface is None or bool(template.surface.closed_axes)
