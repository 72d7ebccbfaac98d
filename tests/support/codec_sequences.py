"""Beating tubes for tests of the codec, and how far two sequences are apart."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from modalmotion.mesh import lattice_faces
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.modes.topology import CYLINDER

Make = Callable[[np.random.Generator], MeshSequence]


def wobbling(
    rng: np.random.Generator, grid: tuple[int, int] = (8, 12), n_frames: int = 9
) -> NDArray[np.float64]:
    """A tube that beats, with a little noise, mm."""
    s, theta = np.meshgrid(
        (np.arange(grid[0]) + 0.5) / grid[0], np.arange(grid[1]) / grid[1], indexing="ij"
    )
    frames = []
    for t in np.arange(n_frames) / n_frames:
        radius = 20.0 + 4.0 * np.cos(2 * np.pi * t) * s + np.cos(2 * np.pi * (2 * theta - t))
        angle = 2 * np.pi * theta
        frames.append(np.stack([radius * np.cos(angle), radius * np.sin(angle), 60.0 * s], axis=-1))
    moving: NDArray[np.float64] = np.array(frames).reshape(n_frames, -1, 3)
    return moving + rng.normal(scale=0.02, size=moving.shape)


def lattice_sequence(rng: np.random.Generator, dtype: type = np.float32) -> MeshSequence:
    vertices: NDArray[np.float64] = wobbling(rng).astype(dtype)
    return mesh_sequence(
        vertices,
        lattice_faces(CYLINDER, (8, 12)),
        grid=(8, 12),
        topology="cylinder",
        times=np.arange(9) / 30.0,
        unit="mm",
    )


def mesh_of_tube(
    rng: np.random.Generator, grid: tuple[int, int] = (8, 12), n_frames: int = 9
) -> MeshSequence:
    """The same without a lattice: spring modes."""
    faces = lattice_faces(CYLINDER, grid)
    shuffled = rng.permutation(grid[0] * grid[1])
    vertices = wobbling(rng, grid, n_frames)[:, np.argsort(shuffled)]
    return mesh_sequence(vertices.astype(np.float32), shuffled[faces])


def small_mesh_of_tube(rng: np.random.Generator) -> MeshSequence:
    """Few bytes, with every section that the larger one has."""
    return mesh_of_tube(rng, (4, 6), 5)


# The larger mesh is decoded so often only by `make soak`.
KINDS = [
    lattice_sequence,
    small_mesh_of_tube,
    pytest.param(mesh_of_tube, marks=pytest.mark.soak),
]


def errors_of(sequence: MeshSequence, decoded: MeshSequence) -> tuple[float, float]:
    difference = decoded.vertices.astype(np.float64) - sequence.vertices.astype(np.float64)
    rms = float(np.sqrt((difference**2).sum(axis=-1).mean()))
    return rms, float(np.linalg.norm(difference, axis=-1).max())


def triangles(faces: NDArray[np.int64]) -> list[tuple[int, ...]]:
    """Oriented triangles as a set: neither order nor first corner."""
    return sorted(min((a, b, c), (b, c, a), (c, a, b)) for a, b, c in faces.tolist())
