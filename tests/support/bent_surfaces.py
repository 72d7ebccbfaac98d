"""Closed surfaces of one mesh whose axis bends, some so much that it is no axis any more."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from modalmotion.mesh.sequence import MeshSequence, mesh_sequence

N_VERTICES = 240
CLASSES = ("strong", "weak")


def ball() -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Points spread over the unit sphere, and the triangles of their hull turned outwards."""
    k = np.arange(N_VERTICES) + 0.5
    z, phi = 1.0 - 2.0 * k / N_VERTICES, k * np.pi * (1.0 + 5.0**0.5)
    r = np.sqrt(1.0 - z**2)
    points = np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=1)
    faces = ConvexHull(points).simplices.astype(np.int64)
    a, b, c = np.moveaxis(points[faces], 1, 0)
    inwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), a) < 0
    faces[inwards] = faces[inwards][:, ::-1]
    return points, faces


def bent_beat(
    label: str, angle: float, rng: np.random.Generator, n_frames: int = 12
) -> MeshSequence:
    """A sausage, bent by an angle (radians), that contracts by a fifth or by a tenth."""
    share = {"strong": 0.2, "weak": 0.1}[label] * rng.uniform(0.85, 1.15)
    return contracting(share, angle, rng, n_frames)


def contracting(
    share: float, angle: float, rng: np.random.Generator, n_frames: int = 12
) -> MeshSequence:
    """A sausage, bent by an angle (radians), that contracts by a share of its radius."""
    points, faces = ball()
    beat = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(n_frames) / n_frames)
    size = rng.uniform(0.9, 1.1)
    frames = []
    for amount in beat:
        radius = 15.0 * (1.0 - share * amount)
        along = 45.0 * points[:, 2]
        across = radius * points[:, :2]
        if angle > 0:
            length = 90.0 / angle
            turn = along / length
            arm = length + across[:, 0]
            x = np.stack([arm * np.cos(turn) - length, across[:, 1], arm * np.sin(turn)], axis=1)
        else:
            x = np.stack([across[:, 0], across[:, 1], along], axis=1)
        frames.append(size * x + rng.normal(scale=0.2, size=x.shape))
    return mesh_sequence(np.array(frames), faces=faces, unit="mm")


def bent_cohort(n_per_class: int, seed: int) -> Iterator[tuple[MeshSequence, str]]:
    """Beats of both classes, every other one bent."""
    rng = np.random.default_rng(seed)
    for number in range(n_per_class):
        for label in CLASSES:
            angle = 0.3 if number % 2 else rng.uniform(3.0, 3.6)
            yield bent_beat(label, angle, rng), label
