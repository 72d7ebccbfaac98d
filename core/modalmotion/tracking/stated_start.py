"""A surface that a search in images starts from: as it is, or only its vertices and triangles."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.modes.topology import CUP
from modalmotion.template import Template, make_template
from modalmotion.tracking.closest import closest_points
from modalmotion.tracking.start import placed

Floats = NDArray[np.float64]

# A start as far as this times the spheroid's distance from the edges that were seen first is near.
_NEAR: Final = 1.5


def begun(
    start: MeshSequence | Template, points: Floats, landmarks: Mapping[str, Floats]
) -> MeshSequence:
    """Take a start where the first look meets it; else place its vertices between the landmarks.

    Parameters
    ----------
    start : MeshSequence or Template
    points : (n, 3) float64, mm
        Edges on the first rays from the axis.
    landmarks : mapping of "apex" and "base" to (3,) float64, mm

    Returns
    -------
    MeshSequence
        One frame. A cup that lies elsewhere, or has another size, is the spheroid that a search
        without a start begins with, in the start's own natural coordinates.
    """
    if isinstance(start, MeshSequence):
        own, template = start, make_template(start)
    else:
        template = start
        own = mesh_sequence(start.vertices[None], start.faces, topology=start.topology)
    coordinates = template.coordinates
    if template.surface != CUP or not np.isfinite(coordinates).all():
        return own
    anew = placed(CUP, coordinates, points, landmarks)
    here, there = (
        float(closest_points(points, x, template.faces).distances.mean())
        for x in (own.vertices[0].astype(np.float64), anew)
    )
    if here <= _NEAR * there:
        return own
    return mesh_sequence(anew[None], own.faces, grid=own.grid, topology=CUP)
