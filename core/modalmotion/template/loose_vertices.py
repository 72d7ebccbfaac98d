"""Vertices in no triangle: each is moved as the vertex of the surface that is nearest to it."""

from __future__ import annotations

from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from modalmotion.modes import Modes
from modalmotion.numeric.scale import power_of_two
from modalmotion.template.template import Template

# Extents of the surface; farther vertices are looked for from here, where squares are usual.
_FARTHEST: Final = 1e6


def nearest_in_use(vertices: NDArray[np.float64], isolated: NDArray[np.int64]) -> NDArray[np.int64]:
    """Vertex of the surface nearest to each isolated one.

    Parameters
    ----------
    vertices : (vertices, 3) float64, length unit
        Isolated ones may lie anywhere.
    isolated : (n,) int64

    Returns
    -------
    (n,) int64
        Itself where no vertex is in use.
    """
    used = np.delete(np.arange(len(vertices)), isolated)
    if not len(used):
        return isolated
    corner = vertices[used[0]]
    surface = vertices[used] - corner
    scale = power_of_two(float(np.abs(surface).max(initial=0.0)))
    with np.errstate(over="ignore"):
        apart = np.clip((vertices[isolated] - corner) / scale, -_FARTHEST, _FARTHEST)
    nearest: NDArray[np.int64] = used[scipy.spatial.cKDTree(surface / scale).query(apart)[1]]
    return nearest


def shapes_of(modes: Modes, template: Template) -> NDArray[np.float64]:
    """Mode shapes at all vertices of a template, isolated ones as their nearest in use.

    Returns
    -------
    (vertices, modes) float64
    """
    shapes = modes.shapes_on(template)
    if len(template.isolated):
        shapes = shapes.copy()
        shapes[template.isolated] = shapes[nearest_in_use(template.vertices, template.isolated)]
    return shapes
