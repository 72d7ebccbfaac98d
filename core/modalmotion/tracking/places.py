"""Places of landmarks on a surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ParameterError
from modalmotion.tracking.deformable import Deformable
from modalmotion.tracking.observation import Place
from modalmotion.tracking.rim import NEAR_END


def place_on(surface: Deformable, place: Place) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Vertices of a landmark's place, and their shares in it.

    Raises
    ------
    ParameterError
        If the surface has no such place.
    """
    template = surface.template
    if isinstance(place, str):
        vertices, shares = _named(surface, place)
    else:
        vertices = np.atleast_1d(np.asarray(place, dtype=np.int64))
        shares = np.full(len(vertices), 1.0 / max(1, len(vertices)))
    if not len(vertices) or not 0 <= vertices.min() <= vertices.max() < template.n_vertices:
        raise ParameterError(
            f"The landmark {place!r:.60} is no place of the surface, which is a "
            f"{template.topology} of {template.n_vertices} vertices.",
            remedy="Name apex or base where the surface has such an end, or vertices of the start.",
        )
    return vertices, shares


def _named(surface: Deformable, name: str) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Mean of the vertices at an end of the axis: of a rim by length, of a pole alike."""
    template = surface.template
    none = np.zeros(0, dtype=np.int64)
    if name not in ("apex", "base") or not template.coordinates.shape[1]:
        return none, np.zeros(0)
    s = template.coordinates[:, 0]
    at_end = surface.rim & (np.abs(s - (0.0 if name == "apex" else 1.0)) < NEAR_END)
    if surface.cells.shape[1] == 3 and at_end.any():
        sides = surface.cells[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        sides = sides[at_end[sides].all(axis=1)]
        x = template.vertices
        length = np.linalg.norm(x[sides[:, 0]] - x[sides[:, 1]], axis=1)
        total = np.bincount(sides.ravel(), np.repeat(length, 2), minlength=len(x))
        vertices = np.flatnonzero(total)
        return vertices, total[vertices] / total.sum()
    end = s.min() if name == "apex" else s.max()
    vertices = np.flatnonzero(np.abs(s - end) <= 1e-9)
    return vertices, np.full(len(vertices), 1.0 / len(vertices))
