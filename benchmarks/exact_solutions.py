"""What closed forms are judged by: sparse matrices of lattices, oscillators in many digits."""

from __future__ import annotations

from typing import Any
from unittest.mock import patch

import mpmath as mp
import numpy as np
from driven_frames import drive_frames
from extremes_oscillator_rows import exact
from mixed_noise import with_noise
from noisy_surfaces import individual
from numpy.typing import NDArray
from scipy.sparse.linalg import eigsh

import modalmotion as mm
from modalmotion.mesh.laplacian import graph_laplacian
from modalmotion.modes import Oscillators, State, exact_step
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import CLOSED, End
from modalmotion.tracking import track
from modalmotion.tracking.map_frames import joined


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


def forced_error(rng: np.random.Generator) -> float:
    """Largest error of one step of equation (3), over the size of what it adds up."""
    worst, h = 0.0, 1.3
    for w in (0.0, 1e-9, 0.7, 30.0):
        for c in (0.0, 1e-9, 0.3, 1.4, 1.4 * (1 + 1e-9), 60.0, 1e4, 1e8):
            u, v, before, after = rng.standard_normal(4)
            step = exact_step(Oscillators(np.array([w]), c), h)
            force = np.array([before]), np.array([after])
            found = step.advance(State(np.array([u]), np.array([v])), *force).amplitudes[0]
            rise = (mp.mpf(after) - mp.mpf(before)) / mp.mpf(h)
            shares = {"kept": mp.mpf(u), "impulse": mp.mpf(v), "step": mp.mpf(before), "ramp": rise}
            parts = exact(w, c, h)
            true = sum(parts[name][0] * share for name, share in shares.items())
            size = sum(parts[name][1] * abs(share) for name, share in shares.items())
            worst = max(worst, float(abs(mp.mpf(float(found)) - true) / size))
    return worst


def apart_at_rest(seed: int) -> float:
    """Distance of a track from where equation (3) rests under the force of its data, mm."""
    rng = np.random.default_rng([seed, 1])
    beat = with_noise(individual(rng, grid=(12, 24), n_frames=6), 0.5, rng)
    start = mm.mesh_sequence(beat.vertices[:1], beat.faces, topology="cup", unit="mm")
    with patch("modalmotion.tracking.map_frames.joined", wraps=joined) as solved:
        result = track(list(beat.vertices), start=start, modes=7, unit="mm")
    # Its last equations, (Q (x) K + A) a = b, driven from the start's shape; frame 0 is known.
    matrices, vectors, stiffness, Q = solved.call_args_list[1].args
    driven = drive_frames(matrices, vectors, stiffness, Q, 0.0 * vectors, 0)
    apart = driven.path[-1].reshape(result.amplitudes.shape) - result.amplitudes
    return float(np.abs(result.shapes @ apart).max())
