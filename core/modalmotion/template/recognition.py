"""Recognition of a mesh's topology from its connectivity and its openings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from modalmotion.errors import TopologyError
from modalmotion.mesh.triangles import corners_of
from modalmotion.modes.topology import CUP, CYLINDER, PLANE, SPHERE, TORUS, Topology
from modalmotion.template.axial_coordinates import FAINT_AXIS, axis_strength, is_flat
from modalmotion.template.surface import Surface

# Triangles of a hemisphere miss at least this share of its area.
_HEMISPHERE = 0.05


@dataclass(frozen=True)
class Recognition:
    """Topology recognised on a mesh, and the reason.

    Parameters
    ----------
    topology : Topology or None
        None without known natural coordinates.
    reason : str
        Why none are known, or which doubt was decided; empty if there was none.
    """

    topology: Topology | None
    reason: str = ""


def recognise(surface: Surface) -> Recognition:
    """Find the topology of a mesh.

    Parameters
    ----------
    surface : Surface

    Returns
    -------
    Recognition
    """
    reason = _obstacle(surface)
    if reason:
        return Recognition(None, reason)
    connectivity = surface.connectivity
    openings, genus = surface.openings, connectivity.genus
    if not openings and genus in (0.0, 1.0):
        return Recognition(SPHERE if genus == 0.0 else TORUS)
    if genus != 0.0:
        return Recognition(None, f"The surface has handles ({connectivity.describe()}).")
    if len(openings) == 1:
        if is_flat(surface):
            return Recognition(
                PLANE, "The surface is nearly flat and was taken for a plane; state cup otherwise."
            )
        if _is_shallow(surface):
            return Recognition(
                CUP,
                "The surface is open wider than a hemisphere and was taken for a cup; state plane "
                "if it is a sheet that encloses nothing.",
            )
        return Recognition(CUP)
    towards = [opening.centre - surface.centroid for opening in openings]
    if len(openings) == 2 and towards[0] @ towards[1] < 0:
        return Recognition(CYLINDER)
    base = surface.base - surface.centroid
    if axis_strength(surface) < FAINT_AXIS or any(arm @ base <= 0 for arm in towards):
        return Recognition(None, f"Its {len(openings)} openings are not at one end.")
    return Recognition(CUP)


def require_fit(surface: Surface, stated: Topology) -> None:
    """Check that a stated topology is possible on a mesh.

    Raises
    ------
    TopologyError
        Naming the actual connectivity and the topologies that fit it.
    """
    if not len(surface.faces):
        raise TopologyError(
            f"A {stated} was stated, but nothing joins the {len(surface.vertices)} vertices.",
            remedy="Send triangles, or the shape of the lattice that the vertices form (grid).",
            details={"stated": stated.name},
        )
    connectivity = surface.connectivity
    n = len(surface.openings)
    reason = _obstacle(surface)
    possible: tuple[Topology, ...] = ()
    if not reason:
        if connectivity.genus == 0.0:
            possible = {0: (SPHERE,), 1: (CUP, PLANE), 2: (CYLINDER, CUP)}.get(n, (CUP,))
        elif connectivity.genus == 1.0 and n == 0:
            possible = (TORUS,)
    if stated in possible:
        return
    names = " or ".join(topology.name for topology in possible)
    raise TopologyError(
        f"A {stated} was stated, but the mesh has {connectivity.describe()}. {reason}".strip(),
        remedy=f"State {names}, or leave the topology out."
        if possible
        else "Leave the topology out: the mesh then gets the spring modes of its own connectivity.",
        details={"stated": stated.name, **connectivity.details()},
    )


def _is_shallow(surface: Surface) -> bool:
    """Whether the area is less than twice the span of the opening; a hemisphere's is twice.

    An opening spans the length of its vector area, which all surfaces that fill it share.
    """
    wound = surface.wound_faces
    if wound is None:
        return False
    a, b, c = corners_of(surface.vertices, wound)
    twice = np.cross(b - a, c - a).sum(axis=0)
    span = float(np.linalg.norm(twice)) / 2.0
    return surface.area < 2.0 * span * (1.0 - _HEMISPHERE)


def _obstacle(surface: Surface) -> str:
    """Why a mesh is not one surface with area; empty if it is."""
    connectivity = surface.connectivity
    if not len(surface.faces):
        return "There are no triangles."
    if len(connectivity.non_manifold_edges):
        a, b = connectivity.non_manifold_edges[0]
        return (
            f"{len(connectivity.non_manifold_edges)} edges belong to more than two triangles, the "
            f"first between vertices {a} and {b}."
        )
    if connectivity.n_components != 1:
        return f"The mesh falls into {connectivity.n_components} pieces."
    if len(connectivity.pinched):
        pinched = connectivity.pinched
        return f"Boundaries touch in {len(pinched)} vertices, the first {pinched[0]}."
    if connectivity.genus != int(connectivity.genus):
        return "The surface has one side only."
    if not surface.area > 0:
        return "The surface has no area in the reference frame."
    return ""
