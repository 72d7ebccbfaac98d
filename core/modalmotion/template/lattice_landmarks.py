"""Landmarks of a lattice, which has coordinates but no stated axis."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from modalmotion.modes.topology import CLOSED, Topology
from modalmotion.numeric.products import weighted_sum
from modalmotion.template.landmarks import Landmarks
from modalmotion.template.surface import Surface


def lattice_landmarks(
    surface: Surface, topology: Topology, coordinates: NDArray[np.float64]
) -> Landmarks | None:
    """Axis along which s grows, and the direction in which theta is 0.

    Parameters
    ----------
    surface : Surface
        Nodes and the triangles between them.
    topology : Topology
    coordinates : (nodes, axes) float64

    Returns
    -------
    Landmarks or None
        None for lattices without one closed axis around another, or without area.

    Notes
    -----
    Theta runs as the columns do. Where that is left-handed about the axis, "theta_zero" is as
    the columns say and sines have the other sign than on a mesh.
    """
    if topology.n_axes != 2 or topology.ends[1] != CLOSED or topology.ends[0] == CLOSED:
        return None
    if not surface.area > 0:
        return None
    s, theta = coordinates.T
    share = surface.areas / surface.area
    centre = surface.centroid
    # The slope of position on s, and the first circular moment of position.
    slope = weighted_sum(share * (s - (share * s).sum()), surface.offsets)
    length = float(np.linalg.norm(slope))
    spread = float(np.sqrt((share * (surface.offsets**2).sum(axis=1)).sum()))
    if not length > 1e-9 * spread:
        return None
    axis = slope / length
    zero = weighted_sum(share * np.cos(2 * np.pi * theta), surface.offsets)
    zero = zero - (zero @ axis) * axis
    reach = float(np.linalg.norm(zero))
    if not reach > 1e-9 * spread:
        return None
    low, high = s <= s.min(), s >= s.max()
    return Landmarks(
        origin=centre,
        axis=axis,
        theta_zero=zero / reach,
        apex=surface.vertices[low].mean(axis=0),
        base=surface.vertices[high].mean(axis=0),
        strengths={"axis": 1.0, "apex": 1.0, "base": 1.0, "theta_zero": 1.0},
        n_loops=len(surface.openings),
        given=("grid",),
    )
