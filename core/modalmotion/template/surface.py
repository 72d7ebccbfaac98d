"""A prepared reference surface: proper triangles, areas, moments, openings."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from modalmotion.mesh import Connectivity, connectivity_of, oriented_faces, vertex_areas
from modalmotion.mesh.near_order import near_order
from modalmotion.mesh.sides import Sides, sides_of
from modalmotion.numeric.products import second_moments, weighted_sum
from modalmotion.representation import shown


@shown("vertices", "faces")
@dataclass(frozen=True, eq=False)
class Surface:
    """One frame of a mesh, scaled so that squares of its coordinates are harmless.

    Parameters
    ----------
    vertices : (vertices, 3) float64, scaled
    faces : (faces, 3) int64
        Without those that name a vertex twice or repeat another.
    areas : (vertices,) float64, scaled
    connectivity : Connectivity
    order : (vertices,) int64, optional
        Of a large mesh, which is numbered anew: the vertex of the mesh that each one is.
    sides : Sides, optional
        Of a large mesh: for compiled kernels.
    weights : (edges,) float64, optional
        Entry of the stiffness at each of them.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    areas: NDArray[np.float64]
    connectivity: Connectivity
    order: NDArray[np.int64] | None = None
    sides: Sides | None = None
    weights: NDArray[np.float64] | None = None

    def moved_to(self, vertices: NDArray[np.float64]) -> Surface:
        """Give the same triangles at other places, (vertices, 3), in the order of the mesh."""
        if self.order is not None:
            vertices = np.take(vertices, self.order, axis=0)
        if self.sides is None:
            areas = vertex_areas(vertices, self.faces)
            return replace(self, vertices=vertices, areas=areas, weights=None)
        weights, areas = self.sides.stiffness(vertices)
        return replace(self, vertices=vertices, areas=areas, weights=weights)

    @property
    def area(self) -> float:
        """Total area."""
        return float(self.areas.sum())

    @cached_property
    def centroid(self) -> NDArray[np.float64]:
        """Area centroid, (3,)."""
        return weighted_sum(self.areas, self.vertices) / self.area

    @cached_property
    def offsets(self) -> NDArray[np.float64]:
        """Positions from the area centroid, (vertices, 3)."""
        return self.vertices - self.centroid

    @cached_property
    def covariance(self) -> NDArray[np.float64]:
        """Second moments of its area about the centroid, over the area, (3, 3)."""
        return second_moments(self.areas, self.offsets, self.offsets) / self.area

    @cached_property
    def wound_faces(self) -> NDArray[np.int64] | None:
        """Triangles wound the same way round: see `oriented_faces`."""
        if self.sides is not None and self.sides.is_wound:
            return self.faces
        return oriented_faces(self.faces, len(self.vertices))

    @property
    def isolated(self) -> NDArray[np.int64]:
        """Vertices of the mesh in no triangle."""
        isolated = self.connectivity.isolated
        return isolated if self.order is None else np.sort(self.order[isolated])

    def of_mesh(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Put values at the vertices of the surface, (vertices, ...), in the order of the mesh."""
        if self.order is None:
            return values
        found = np.empty_like(values)
        found[self.order] = values
        return found

    @cached_property
    def openings(self) -> tuple[Opening, ...]:
        """The boundary loops, the longest first."""
        openings = [Opening.of(self.vertices, loop) for loop in self.connectivity.loops]
        return tuple(sorted(openings, key=lambda opening: -opening.length))

    @cached_property
    def base(self) -> NDArray[np.float64]:
        """Centroid of all openings by length, (3,)."""
        return mean_of(self.openings)


@dataclass(frozen=True, eq=False)
class Opening:
    """One boundary loop.

    Parameters
    ----------
    vertices : (n,) int64
    centre : (3,) float64
        Centroid of its edges by length.
    length : float
    edges : (edges, 2) int64
    """

    vertices: NDArray[np.int64]
    centre: NDArray[np.float64]
    length: float
    edges: NDArray[np.int64]

    @staticmethod
    def of(vertices: NDArray[np.float64], loop: NDArray[np.int64]) -> Opening:
        """Measure a loop of edges, (edges, 2)."""
        a, b = vertices[loop[:, 0]], vertices[loop[:, 1]]
        lengths = np.linalg.norm(b - a, axis=1)
        total = float(lengths.sum())
        centre = weighted_sum(lengths, (a + b) / 2) / total if total > 0 else a.mean(axis=0)
        return Opening(np.unique(loop), centre, total, loop)

    def slopes(
        self,
        vertices: NDArray[np.float64],
        weights: NDArray[np.float64],
        of_length: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Differentiate weights @ centre + of_length * length by the positions.

        Parameters
        ----------
        vertices : (vertices, 3) float64
        weights : (functions, 3) float64
        of_length : (functions,) float64

        Returns
        -------
        (functions, vertices, 3) float64
        """
        a, b = vertices[self.edges[:, 0]], vertices[self.edges[:, 1]]
        sides, total = b - a, self.length or 1.0
        lengths = np.linalg.norm(sides, axis=1)
        sides /= np.where(lengths > 0, lengths, 1.0)[:, None]
        # C = sum L m / sum L: dC = sum ((m - C) dL + L dm) / sum L
        apart = weights @ ((a + b) / 2 - self.centre).T + (of_length * total)[:, None]
        along = apart[:, :, None] * sides
        of_middle = 0.5 * weights[:, None] * lengths[:, None]
        slopes = np.zeros((len(weights), len(vertices), 3))
        for function, length, middle in zip(slopes, along, of_middle, strict=True):
            np.add.at(function, self.edges[:, 0], (middle - length) / total)
            np.add.at(function, self.edges[:, 1], (middle + length) / total)
        return slopes


def mean_of(openings: tuple[Opening, ...]) -> NDArray[np.float64]:
    """Centroid of several openings by length, (3,)."""
    lengths = np.array([opening.length for opening in openings])
    centres = np.stack([opening.centre for opening in openings])
    total = float(lengths.sum())
    shares = lengths / total if total > 0 else np.full(len(lengths), 1.0 / len(lengths))
    return weighted_sum(shares, centres)


def surface_of(
    vertices: NDArray[np.float64], faces: NDArray[np.int64], *, in_any_order: bool = False
) -> Surface:
    """Measure a mesh.

    Parameters
    ----------
    vertices : (vertices, 3) float64, scaled
    faces : (faces, 3) int64
    in_any_order : bool
        Whether its vertices may be numbered anew, as they are on a large mesh.
    """
    near = near_order(vertices, faces) if in_any_order else None
    if near is not None:
        surface = _renumbered(vertices, *near)
        if surface is not None:
            return surface
    connectivity = connectivity_of(faces, len(vertices))
    proper: NDArray[np.int64] = np.delete(faces, connectivity.left_out, axis=0)
    return Surface(vertices, proper, vertex_areas(vertices, proper), connectivity)


def _renumbered(
    vertices: NDArray[np.float64], order: NDArray[np.int64], faces: NDArray[np.int64]
) -> Surface | None:
    """Measure a mesh in another order; None where notes or errors would name its parts."""
    sides = sides_of(faces, len(vertices))
    connectivity = connectivity_of(faces, len(vertices)) if sides is None else sides.connectivity()
    named = connectivity.left_out, connectivity.non_manifold_edges, connectivity.pinched
    if any(len(part) for part in named):
        return None
    vertices = np.take(vertices, order, axis=0)
    if sides is None:
        return Surface(vertices, faces, vertex_areas(vertices, faces), connectivity, order)
    weights, areas = sides.stiffness(vertices)
    return Surface(vertices, faces, areas, connectivity, order, sides, weights)
