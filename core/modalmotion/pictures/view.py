"""Direction from which a surface is seen."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.mesh import face_normals, oriented_faces
from modalmotion.template.template import Template

# Angle of view from above, in radians.
_TILT: Final = 0.2


def upright(template: Template) -> NDArray[np.float64]:
    """Columns that make the axis upright, its end on top, and theta = 0 in front.

    Returns
    -------
    (3, 3) float64
        Of positions as rows: x to the right, y away from the viewer, z up.
    """
    landmarks = template.landmarks
    closed = () if template.surface is None else template.surface.closed_axes
    if landmarks is None:
        used = np.delete(template.vertices / size_of(template), template.isolated, axis=0)
        _, _, (first, second, third) = np.linalg.svd(used - used.mean(axis=0), full_matrices=False)
        # A torus is horizontal, a sheet is seen along its normal.
        axis, zero = (third, first) if len(closed) == 2 else (second, third)
    elif closed:
        axis, zero = landmarks.axis, landmarks.theta_zero
    else:
        axis, zero = landmarks.theta_zero, landmarks.axis
    return np.stack([np.cross(axis, zero), -zero, axis], axis=1)


def size_of(template: Template) -> float:
    """Largest coordinate: divisor of positions before drawing."""
    return float(np.abs(template.vertices).max()) or 1.0


def tilted(view: NDArray[np.float64], tilt: float = _TILT) -> NDArray[np.float64]:
    """View it slightly from above, by so many radians."""
    c, s = np.cos(tilt), np.sin(tilt)
    turned: NDArray[np.float64] = view @ np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])
    return turned


def faces_viewer(vertices: NDArray[np.float64], template: Template) -> NDArray[np.bool_]:
    """Triangles whose outside is visible: all of a sheet, which has no outside."""
    faces = oriented_faces(template.faces, len(vertices))
    if faces is None or not template.topology.closed_axes:
        return np.ones(len(template.faces), dtype=np.bool_)
    normals = face_normals(vertices, faces)
    centres = vertices[faces].mean(axis=1)
    outward = float(np.einsum("ij,ij->", normals, centres - centres.mean(axis=0)))
    towards: NDArray[np.bool_] = normals[:, 1] * np.sign(outward) < 0
    return towards
