"""Potentials on a surface: smooth functions that become natural coordinates."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from modalmotion.mesh import cotangent_laplacian, graph_laplacian, solve_positive_definite
from modalmotion.progress import ShareReport, silent
from modalmotion.template.surface import Surface

# Springs this weak join vertices that no triangle with area joins.
_GLUE = 1e-12


def potential(
    surface: Surface,
    sources: NDArray[np.float64],
    held: NDArray[np.int64],
    values: NDArray[np.float64],
    report: ShareReport = silent,
) -> NDArray[np.float64] | None:
    """Solve -Laplace u = sources with u fixed on some vertices, by linear elements.

    Parameters
    ----------
    surface : Surface
        In one piece.
    sources : (vertices,) float64
        Integrated over each vertex's cell.
    held : (n,) int64
        Vertices with a fixed value; if there are none, the sources must add up to zero and
        the mean of u over the surface is zero.
    values : (n,) float64
    report : callable, optional
        Told the share of the solution that is there.

    Returns
    -------
    (vertices,) float64, or None
        None where the triangles are too thin for a solution. Isolated vertices get zero.
    """
    n = len(surface.vertices)
    u = np.zeros(n)
    u[held] = values
    is_free = np.ones(n, dtype=np.bool_)
    is_free[held] = False
    is_free[surface.connectivity.isolated] = False
    free = np.flatnonzero(is_free)
    if not len(held):
        # Without held values u is known up to a constant: one vertex is held, the mean
        # taken off afterwards.
        free = free[1:]
    if len(free):
        found = _solved(surface, sources, u, free, report)
        if found is None:
            return None
        u[free] = found
    if not np.isfinite(u).all():
        return None
    if not len(held):
        u -= (surface.areas * u).sum() / surface.area
    return u


def _solved(
    surface: Surface,
    sources: NDArray[np.float64],
    u: NDArray[np.float64],
    free: NDArray[np.int64],
    report: ShareReport,
) -> NDArray[np.float64] | None:
    stiffness = _stiffness(surface)
    right = sources[free] - (stiffness @ u)[free]
    try:
        return solve_positive_definite(
            scipy.sparse.csc_array(stiffness[free][:, free]),
            right,
            surface.vertices[free],
            report,
        )
    except RuntimeError:
        return None


def _has_area_everywhere(surface: Surface) -> bool:
    used = np.ones(len(surface.vertices), dtype=np.bool_)
    used[surface.connectivity.isolated] = False
    return bool((surface.areas[used] > 0).all())


def _stiffness(surface: Surface) -> scipy.sparse.csc_array:
    stiffness = cotangent_laplacian(surface.vertices, surface.faces)
    if _has_area_everywhere(surface):
        return stiffness
    diagonal = stiffness.diagonal()
    springs = graph_laplacian(surface.connectivity.edges, len(surface.vertices))
    return scipy.sparse.csc_array(stiffness + _GLUE * float(diagonal.max(initial=1.0)) * springs)
