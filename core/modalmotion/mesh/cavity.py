"""Cavities: the volume inside a surface whose openings are closed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import TopologyError
from modalmotion.mesh.triangles import connectivity_of, grouped_edges, oriented_faces
from modalmotion.representation import shown


@shown()
@dataclass(frozen=True, eq=False)
class Cavity:
    """The cavity inside a surface's triangles, its openings closed by fans.

    For unchecked faces use `cavity_of`.

    Parameters
    ----------
    faces : (faces, 3) int64
        Consistently wound; outward for a positive volume.
    """

    faces: NDArray[np.int64]

    def volume(self, vertices: NDArray[np.float64]) -> NDArray[np.float64]:
        """Volume enclosed by vertices in these positions.

        Parameters
        ----------
        vertices : (..., vertices, 3) float64, length unit
            Those in no triangle are not read.

        Returns
        -------
        (...) float64, length unit cubed

        Notes
        -----
        Divergence theorem: V = 1/6 sum a . (b x c) over the triangles of the closed surface.
        Each opening is closed by triangles from its edges to the mean of its vertices.
        """
        if not len(self.faces):
            return np.zeros(vertices.shape[:-2])
        # About a point nearby, so that a distant origin costs no digits.
        near = self.faces[0, :1]
        vertices = vertices - vertices[..., near, :]
        six_fold = _triple(*(vertices[..., self.faces[:, i], :] for i in range(3)))
        for edges in self.openings:
            start, end = vertices[..., edges[:, 0], :], vertices[..., edges[:, 1], :]
            centre = start.mean(axis=-2, keepdims=True)
            # An edge a -> b of a face is b -> a in the lid.
            six_fold += _triple(centre, end, start)
        volume: NDArray[np.float64] = six_fold / 6.0
        return volume

    @cached_property
    def openings(self) -> tuple[NDArray[np.int64], ...]:
        """Edges around each opening, each from start to end as its triangle runs along it.

        Edges of openings that touch in a vertex are one opening: a fan over them closes both.
        """
        if not len(self.faces):
            return ()
        start, end = self.faces[:, [0, 1, 2]].ravel(), self.faces[:, [1, 2, 0]].ravel()
        n = int(self.faces.max()) + 1
        smaller, larger = np.minimum(start, end), np.maximum(start, end)
        _, first, counts = np.unique(smaller * n + larger, return_index=True, return_counts=True)
        border = np.sort(first[counts == 1])
        return tuple(grouped_edges(np.stack([start[border], end[border]], axis=1), n))


def cavity_of(faces: NDArray[np.int64], n_vertices: int) -> Cavity:
    """Check that a surface can enclose something, and wind its triangles alike.

    Parameters
    ----------
    faces : (faces, 3) int64
        In any winding; triangles that name a vertex twice or repeat another are left out.
    n_vertices : int

    Returns
    -------
    Cavity
        Wound as the first triangle is, so its volumes may be negative.

    Raises
    ------
    TopologyError
        If there are no triangles, if they form several pieces or not a surface, or if the
        surface has one side only.
    """
    connectivity = connectivity_of(faces, n_vertices)
    proper = np.delete(faces, connectivity.left_out, axis=0)
    if not len(proper):
        raise TopologyError(
            "There are no triangles, so nothing is enclosed.",
            remedy="Send a surface: triangles, or a lattice of two axes with its topology.",
        )
    if len(connectivity.non_manifold_edges):
        vertex = int(connectivity.non_manifold_edges[0, 0])
        raise TopologyError(
            f"{len(connectivity.non_manifold_edges)} edges belong to three triangles or more "
            f"(one of them at vertex {vertex}): such a surface has no inside.",
            remedy="Send the wall of the cavity alone, without inner sheets.",
            vertex=vertex,
            details=connectivity.details(),
        )
    if connectivity.n_components > 1:
        raise TopologyError(
            f"The triangles are {connectivity.n_components} separate pieces: which of them bound "
            "the cavity, and whether one is inside another, is unknown.",
            remedy="Send the surface of one cavity at a time.",
            details=connectivity.details(),
        )
    wound = oriented_faces(proper, n_vertices)
    if wound is None:
        raise TopologyError(
            "The surface has one side only, so it has no inside.",
            remedy="Send a surface with two sides.",
            details=connectivity.details(),
        )
    return Cavity(wound)


def _triple(
    a: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Sum of a . (b x c)."""
    total: NDArray[np.float64] = (
        a[..., 0] * (b[..., 1] * c[..., 2] - b[..., 2] * c[..., 1])
        + a[..., 1] * (b[..., 2] * c[..., 0] - b[..., 0] * c[..., 2])
        + a[..., 2] * (b[..., 0] * c[..., 1] - b[..., 1] * c[..., 0])
    ).sum(axis=-1)
    return total


def volume_gradient(cavity: Cavity, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Differentiate the volume by each vertex, (vertices, 3) float64, length unit squared."""
    x = x - x[cavity.faces[0, 0]]
    total = np.zeros_like(x)
    for k in range(3):
        b, c = (x[cavity.faces[:, (k + i) % 3]] for i in (1, 2))
        np.add.at(total, cavity.faces[:, k], np.cross(b, c) / 6.0)
    return total + _of_lids(cavity, x)


def lid_gradient(cavity: Cavity, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Differentiate the volume by where the lids of openings are, (vertices, 3) float64.

    As if the wall went along: what is swept by each lid where its rim moves.
    """
    total = np.zeros_like(x)
    for edges in cavity.openings:
        middle = x[edges[:, 0]].mean(axis=0)
        start, end = x[edges[:, 0]] - middle, x[edges[:, 1]] - middle
        # A triangle sweeps its area vector times the mean of what its corners move by.
        areas = np.cross(end, start) / 6.0
        np.add.at(total, edges[:, 0], areas)
        np.add.at(total, edges[:, 1], areas)
        total[edges[:, 0]] += areas.sum(axis=0) / len(edges)
    return total


def _of_lids(cavity: Cavity, x: NDArray[np.float64]) -> NDArray[np.float64]:
    total = np.zeros_like(x)
    for edges in cavity.openings:
        start, end = x[edges[:, 0]], x[edges[:, 1]]
        centre = start.mean(axis=0)
        np.add.at(total, edges[:, 1], np.cross(start, centre) / 6.0)
        np.add.at(total, edges[:, 0], np.cross(centre, end) / 6.0)
        total[edges[:, 0]] += np.cross(end, start).sum(axis=0) / 6.0 / len(edges)
    return total
