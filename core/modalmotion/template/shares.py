"""Share of each vertex in a surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from modalmotion.mesh.sequence import MeshSequence
from modalmotion.mesh.triangles import curve_weights
from modalmotion.modes.topology import Topology
from modalmotion.template.surface import Surface
from modalmotion.template.template import Weights


def shares_of(
    surface: Surface,
    sequence: MeshSequence,
    topology: Topology | None,
    weights: Weights,
    notes: list[str],
    first: NDArray[np.int64],
) -> NDArray[np.float64]:
    """Shares of vertices in rotation, fit and error, (vertices,) float64; they add up to 1.

    Parameters
    ----------
    surface : Surface
    sequence : MeshSequence
    topology : Topology or None
    weights : Weights
    notes : list of str
        Told where there are no areas to weigh by.
    first : (vertices,) int64
        The vertex that stands for each.
    """
    n = sequence.n_vertices
    is_curve = topology is not None and topology.n_axes == 1
    if weights == Weights.UNIFORM:
        counted = np.ones(n, dtype=np.bool_)
        if len(surface.faces):
            counted[surface.isolated] = False
        return np.where(counted, 1.0 / counted.sum(), 0.0)
    areas = surface.areas
    if is_curve and topology is not None:
        areas = curve_weights(surface.vertices, topology)
    elif not len(surface.faces):
        notes.append("There are no areas to weigh by; all vertices count alike.")
        return np.full(n, 1.0 / n)
    total = float(areas.sum())
    if not total > 0:
        notes.append("The surface has no area; all vertices count alike.")
        return np.full(n, 1.0 / n)
    # What stands for others has their weight too.
    weightless = int((areas[first] == 0).sum())
    if weightless:
        notes.append(f"{weightless} vertices belong to no area and have no weight in the fit.")
    shares: NDArray[np.float64] = areas / total
    return shares
