"""Closest points: those of all triangles, one after the other."""

from __future__ import annotations

import numpy as np
import pytest
from clouds import Floats

from modalmotion.mesh.sequence import standard_surface
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import CUP
from modalmotion.tracking.closest import closest_points


def distance_to(p: Floats, triangle: Floats) -> float:
    """By a fine search over the triangle."""
    t = np.linspace(0.0, 1.0, 201)
    u, v = np.meshgrid(t, t)
    kept = u + v <= 1.0
    u, v = u[kept][:, None], v[kept][:, None]
    a, b, c = triangle
    return float(np.linalg.norm(a + u * (b - a) + v * (c - a) - p, axis=1).min())


def test_foot_is_the_closest_place_of_a_triangle(rng: np.random.Generator) -> None:
    for _ in range(20):
        triangle = rng.normal(size=(3, 3))
        points = rng.normal(size=(6, 3)) * 2.0
        found = closest_points(points, triangle, np.array([[0, 1, 2]]))
        assert found.shares.min() >= 0.0
        assert found.shares.sum(axis=1) == pytest.approx(1.0)
        assert found.feet == pytest.approx(found.shares @ triangle)
        for p, d in zip(points, found.distances, strict=True):
            assert d == pytest.approx(distance_to(p, triangle), abs=0.02)


def test_foot_on_a_surface_is_that_of_its_best_triangle(rng: np.random.Generator) -> None:
    shape = standard_surface(Lattice(CUP, (12, 16)))
    x, faces = shape.vertices[0], shape.faces
    points = rng.normal(size=(60, 3)) * 0.2 + x[rng.integers(len(x), size=60)]
    best = np.min(
        [closest_points(points, x, faces[[k]]).distances for k in range(len(faces))], axis=0
    )
    found = closest_points(points, x, faces)
    assert np.mean(found.distances <= best * (1 + 1e-12)) >= 0.95
    assert found.distances == pytest.approx(best, abs=0.02)
    n = found.normals[:, 0]
    assert np.linalg.norm(n, axis=1) == pytest.approx(1.0)


def test_foot_on_a_curve_is_across_it() -> None:
    t = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    x = np.stack([np.cos(t), np.sin(t), 0 * t], axis=1)
    cells = np.stack([np.arange(40), (np.arange(40) + 1) % 40], axis=1)
    found = closest_points(np.array([[2.0, 0.1, 0.3]]), x, cells)
    assert found.distances[0] == pytest.approx(np.hypot(np.hypot(2.0, 0.1) - 1.0, 0.3), abs=0.01)
    tangent = x[found.corners[0, 1]] - x[found.corners[0, 0]]
    assert found.normals[0] @ tangent == pytest.approx([0.0, 0.0], abs=1e-12)


def test_a_triangle_without_area_is_its_longest_side() -> None:
    flat = np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]])
    found = closest_points(np.array([[1.5, 1.0, 0.0]]), flat, np.array([[0, 1, 2]]))
    assert found.distances[0] == pytest.approx(1.0)
