"""A prepared reference surface: proper triangles, areas, moments, openings."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from modalmotion.mesh import Connectivity, connectivity_of, vertex_areas
from modalmotion.numeric.products import weighted_sum
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
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    areas: NDArray[np.float64]
    connectivity: Connectivity

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
    """

    vertices: NDArray[np.int64]
    centre: NDArray[np.float64]
    length: float

    @staticmethod
    def of(vertices: NDArray[np.float64], loop: NDArray[np.int64]) -> Opening:
        """Measure a loop of edges, (edges, 2)."""
        a, b = vertices[loop[:, 0]], vertices[loop[:, 1]]
        lengths = np.linalg.norm(b - a, axis=1)
        total = float(lengths.sum())
        centre = weighted_sum(lengths, (a + b) / 2) / total if total > 0 else a.mean(axis=0)
        return Opening(np.unique(loop), centre, total)


def mean_of(openings: tuple[Opening, ...]) -> NDArray[np.float64]:
    """Centroid of several openings by length, (3,)."""
    lengths = np.array([opening.length for opening in openings])
    centres = np.stack([opening.centre for opening in openings])
    total = float(lengths.sum())
    shares = lengths / total if total > 0 else np.full(len(lengths), 1.0 / len(lengths))
    return weighted_sum(shares, centres)


def surface_of(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> Surface:
    """Measure a mesh.

    Parameters
    ----------
    vertices : (vertices, 3) float64, scaled
    faces : (faces, 3) int64
    """
    connectivity = connectivity_of(faces, len(vertices))
    proper: NDArray[np.int64] = np.delete(faces, connectivity.left_out, axis=0)
    return Surface(vertices, proper, vertex_areas(vertices, proper), connectivity)
