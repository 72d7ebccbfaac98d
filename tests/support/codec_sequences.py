"""Beating tubes for tests of the codec, and how far two sequences are apart."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import fft

from modalmotion.mesh import lattice_faces
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.modes.topologies import CYLINDER

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


def jointed(
    rng: np.random.Generator, n_links: int = 4, n_frames: int = 12, welded: bool = False
) -> MeshSequence:
    """A chain of rigid links, rough tubes of 12 vertices, that bends at its joints, mm."""
    faces = lattice_faces(CYLINDER, (3, 4))
    times = np.arange(n_frames)[:, None] / n_frames
    rates, starts = rng.uniform(0.5, 2.0, size=(2, n_links))
    angles = np.cumsum(np.sin(2 * np.pi * rates * times + starts), axis=1)
    along = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    joints = np.cumsum(np.concatenate([np.zeros((n_frames, 1, 2)), 9.0 * along], axis=1), axis=1)
    links = []
    for i in range(n_links):
        u, v, w = rng.normal(scale=2.0, size=(3, 12)) + np.array([[4.0], [0.0], [0.0]])
        c, s = along[:, i, :1], along[:, i, 1:]
        x, y = c * u - s * v + joints[:, i, :1], s * u + c * v + joints[:, i, 1:]
        links.append(np.stack([x, y, np.broadcast_to(w, x.shape)], axis=-1))
    parts = [faces + 12 * i for i in range(n_links)]
    if welded:
        parts += [np.array([[12 * i, 12 * i + 11, 12 * i + 12]]) for i in range(n_links - 1)]
    vertices = np.concatenate(links, axis=1).astype(np.float32)
    return mesh_sequence(vertices, np.concatenate(parts), unit="mm")


# The larger mesh is decoded so often only by `make soak`.
KINDS = [
    lattice_sequence,
    small_mesh_of_tube,
    jointed,
    pytest.param(mesh_of_tube, marks=pytest.mark.soak),
]


def errors_of(sequence: MeshSequence, decoded: MeshSequence) -> tuple[float, float]:
    difference = decoded.vertices.astype(np.float64) - sequence.vertices.astype(np.float64)
    rms = float(np.sqrt((difference**2).sum(axis=-1).mean()))
    return rms, float(np.linalg.norm(difference, axis=-1).max())


def triangles(faces: NDArray[np.int64]) -> list[tuple[int, ...]]:
    """Oriented triangles as a set: neither order nor first corner."""
    return sorted(min((a, b, c), (b, c, a), (c, a, b)) for a, b, c in faces.tolist())


def random_sequence(rng: np.random.Generator) -> MeshSequence:
    """Few frames of a surface of any kind: smooth or rough, on a lattice, a mesh or neither."""
    grid = int(rng.integers(2, 6)), int(rng.integers(3, 8))
    n_frames = int(rng.integers(1, 9))
    n = grid[0] * grid[1]
    falls = np.exp(-np.arange(n) / rng.uniform(1.0, n))
    amplitudes = rng.normal(size=(n_frames, 3, n)).cumsum(axis=0) * falls
    vertices = fft.idct(amplitudes, axis=2, norm="ortho").transpose(0, 2, 1)
    vertices = vertices * 10.0 ** rng.uniform(-3, 3) + rng.normal(size=3) * 10.0 ** rng.uniform(
        0, 2
    )
    vertices = vertices.astype(np.float32 if rng.random() < 0.5 else np.float64)
    faces = lattice_faces(CYLINDER, grid)
    kind = int(rng.integers(4))
    if kind == 0:
        return mesh_sequence(vertices, faces, grid=grid, topology="cylinder")
    if kind == 1:
        return mesh_sequence(vertices)
    if kind == 2:
        return mesh_sequence(vertices, rng.permutation(n)[faces])
    return mesh_sequence(vertices, rng.integers(0, n, size=(int(rng.integers(1, 2 * n)), 3)))
