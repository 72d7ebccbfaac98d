"""The same lattices as sparse matrices, for a general eigensolver."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import eigsh

from modalmotion.mesh.laplacian import graph_laplacian
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topology import CLOSED, End


def stiffness_matrix(lattice: Lattice) -> Any:
    """Assemble the springs of a lattice, sparse, (nodes, nodes)."""
    node = np.arange(lattice.n_nodes).reshape(lattice.shape)
    pairs: list[tuple[NDArray[np.int64], NDArray[np.int64]]] = []
    for axis, ends in enumerate(lattice.topology.ends):
        rows = np.moveaxis(node, axis, 0)
        pairs.append((rows[:-1].ravel(), rows[1:].ravel()))
        if ends == CLOSED:
            pairs.append((rows[-1].ravel(), rows[0].ravel()))
        for end, row in zip(ends, (rows[0], rows[-1]), strict=True):
            if end == End.POLE:
                near, far = np.split(row, 2, axis=axis)
                pairs.append((near.ravel(), far.ravel()))
    edges = np.concatenate([np.column_stack(each) for each in pairs])
    return graph_laplacian(edges, lattice.n_nodes)


def lowest_eigenpairs(matrix: Any, n_modes: int) -> tuple[NDArray[np.float64], Any]:
    """Solve for the lowest modes by shift and invert, just below the eigenvalue 0."""
    start = np.random.default_rng(0).standard_normal(matrix.shape[0])
    eigenvalues, vectors = eigsh(matrix, n_modes, sigma=-1e-6, v0=start)
    return np.sort(eigenvalues), vectors


def largest_residual(lattice: Lattice) -> float:
    """Largest |K phi - M w^2 phi| of its lowest modes, in units of its stiffness."""
    modes = lattice.lowest_modes(40)
    phi, squares = lattice.shapes(modes), lattice.angular_frequencies(modes) ** 2
    return float(np.abs(stiffness_matrix(lattice) @ phi - phi * squares).max())
