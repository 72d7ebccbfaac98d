"""The frame of a body, and the frame of each place on it.

Signatures of different patients are compared in the frame of the body: its axis, the direction
in which theta is 0, and the one across both. On a surface with an axis each place has a frame of
its own, too, in which amplitudes read as contraction, twist and shortening.
"""

from __future__ import annotations

from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import TopologyError
from modalmotion.numeric.products import along
from modalmotion.numeric.scale import lengths
from modalmotion.template import Landmarks, Template
from modalmotion.template.loose_vertices import nearest_in_use


class Components(StrEnum):
    """Directions of the three amplitudes of a mode."""

    CARTESIAN = "cartesian"
    CYLINDRICAL = "cylindrical"


def body_frame(landmarks: Landmarks) -> NDArray[np.float64]:
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


def local_frames(template: Template) -> NDArray[np.float64]:
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
        raise TopologyError(
            "The surface has no axis, so there are no radial, tangential and axial components.",
            remedy="Ask for Cartesian components.",
        )
    vertices = template.vertices
    if len(template.isolated):
        vertices = vertices.copy()
        vertices[template.isolated] = vertices[nearest_in_use(vertices, template.isolated)]
    offsets = vertices - landmarks.origin
    axis = landmarks.axis
    across = offsets - along(offsets, axis)[:, None] * axis
    # Twice, since at a small radius its rounding has a part along the axis.
    across -= along(across, axis)[:, None] * axis
    radius = lengths(across)
    on_axis = ~(radius > 1e-9 * radius.max(initial=0.0))
    radial = across / np.where(on_axis, 1.0, radius)[:, None]
    radial[on_axis] = landmarks.theta_zero
    tangential = np.cross(axis, radial)
    return np.stack([radial, tangential, np.broadcast_to(axis, radial.shape)], axis=1)


def to_local(u: NDArray[np.float64], frames: NDArray[np.float64]) -> NDArray[np.float64]:
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


def from_local(components: NDArray[np.float64], frames: NDArray[np.float64]) -> NDArray[np.float64]:
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
    vectors: NDArray[np.float64] = np.einsum("nij,fni->fnj", frames, components)
    return vectors
