"""Modes of the springs along the edges of a mesh: for surfaces without natural coordinates.

They depend on the connectivity alone, so amplitudes compare within one connectivity only. This
is also the slow twin that the closed forms are measured against.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from modalmotion.mesh import connectivity_of, graph_laplacian
from modalmotion.numeric.eigenpairs import lowest_eigenpairs
from modalmotion.representation import shown


class SpringLabel(NamedTuple):
    """Name of one spring mode: its place in the order of frequency, nothing more."""

    rank: int

    def __str__(self) -> str:
        return f"(spring {self.rank})"


@shown()
@dataclass(frozen=True, eq=False)
class SpringSpectrum:
    """Names and eigenvalues of spring modes, without their shapes.

    Parameters
    ----------
    eigenvalues : (modes,) float64
        Squared angular frequencies for K = M = 1, in increasing order.
    connectivity_id : str
        sha256 of the edges in hex: amplitudes compare where it is the same.
    """

    eigenvalues: NDArray[np.float64]
    connectivity_id: str

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, SpringSpectrum):
            return NotImplemented
        return self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)

    @cached_property
    def _key(self) -> tuple[str, bytes]:
        return self.connectivity_id, self.eigenvalues.tobytes()

    def __len__(self) -> int:
        return len(self.eigenvalues)

    @property
    def topology(self) -> None:
        """None: spring modes belong to one mesh and to no topology."""
        return

    @cached_property
    def labels(self) -> tuple[SpringLabel, ...]:
        """The modes' labels, in order."""
        return tuple(SpringLabel(rank) for rank in range(len(self)))


@shown()
@dataclass(frozen=True, eq=False)
class SpringModes:
    """Lowest modes of equal masses at the vertices and equal springs along the edges.

    Parameters
    ----------
    eigenvalues : (modes,) float64
        Squared angular frequencies for K = M = 1, in increasing order.
    shapes : (vertices, modes) float64
        Mean square 1 over the vertices in use; zero at those of no triangle.
    connectivity_id : str
        sha256 of the edges in hex: amplitudes compare where it is the same.
    mean_valence : float
        Edges that meet in a vertex, on average.
    """

    eigenvalues: NDArray[np.float64]
    shapes: NDArray[np.float64]
    connectivity_id: str
    mean_valence: float

    def __post_init__(self) -> None:
        self.eigenvalues.setflags(write=False)
        self.shapes.setflags(write=False)

    @property
    def spectrum(self) -> SpringSpectrum:
        """What is kept of them in a result: everything but the shapes."""
        return SpringSpectrum(self.eigenvalues, self.connectivity_id)

    def __len__(self) -> int:
        return len(self.eigenvalues)

    @property
    def topology(self) -> None:
        """None: spring modes belong to one mesh and to no topology."""
        return

    @cached_property
    def labels(self) -> tuple[SpringLabel, ...]:
        """The modes' labels, in order."""
        return tuple(SpringLabel(rank) for rank in range(len(self)))

    def angular_frequencies(self, wave_speed: float, edge_length: float) -> NDArray[np.float64]:
        """Frequencies of springs that carry long waves at a given speed.

        Parameters
        ----------
        wave_speed : float, length unit per s
        edge_length : float, length unit
            Root mean square over the edges.

        Returns
        -------
        (modes,) float64, rad per s
        """
        # Springs of length a, z to a vertex, carry long waves at c^2 = (K/M) z a^2 / 4.
        # Neither length is squared: their ratio is usual in every unit.
        factor = 2 * (wave_speed / edge_length) / float(np.sqrt(self.mean_valence))
        frequencies: NDArray[np.float64] = factor * np.sqrt(np.maximum(self.eigenvalues, 0.0))
        return frequencies


def spring_modes(faces: NDArray[np.int64], n_vertices: int, n_modes: int) -> SpringModes:
    """Lowest spring modes of a mesh.

    Parameters
    ----------
    faces : (faces, 3) int64
        At least one. Pieces that are not joined are allowed.
    n_vertices : int
    n_modes : int

    Returns
    -------
    SpringModes
        Mode 0 is constant over the whole mesh; if there are several pieces, the next ones are
        constant on each, the largest piece first, equal ones in the order of first vertices.

    Raises
    ------
    ModeCountError
        If there are not that many vertices in use.
    """
    found = connectivity_of(faces, n_vertices)
    used = np.ones(n_vertices, dtype=np.bool_)
    used[found.isolated] = False
    place = np.cumsum(used) - 1
    edges = place[found.edges]
    n = int(used.sum())
    values, vectors = lowest_eigenpairs(graph_laplacian(edges, n), n_modes, _indicators(edges, n))
    shapes = np.zeros((n_vertices, n_modes))
    shapes[used] = vectors * np.sqrt(n)
    digest = hashlib.sha256(str(n_vertices).encode())
    digest.update(np.ascontiguousarray(found.edges.astype("<i8")).data)
    return SpringModes(
        eigenvalues=np.maximum(values, 0.0),
        shapes=shapes,
        connectivity_id=digest.hexdigest(),
        mean_valence=2 * len(edges) / n,
    )


def _indicators(edges: NDArray[np.int64], n: int) -> NDArray[np.float64]:
    """One on everything, then one on each piece, the largest first."""
    graph = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(n, n))
    _, labels = connected_components(graph, directed=False)
    _, first, size = np.unique(labels, return_index=True, return_counts=True)
    order = np.lexsort((first, -size))
    columns = [np.ones(n), *(labels == labels[i] for i in first[order])]
    return np.stack(columns, axis=1).astype(np.float64)
