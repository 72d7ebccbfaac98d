"""Kernels of large meshes find what NumPy finds."""

from __future__ import annotations

import numpy as np
import pytest
from mesh_kernels import compiled, large
from template_surfaces import make_ventricle

from modalmotion.mesh import (
    Connectivity,
    connectivity_of,
    cotangent_laplacian,
    face_areas,
    face_gradients,
    face_normals,
    vertex_areas,
)
from modalmotion.mesh.half_matrix import HalfMatrix
from modalmotion.mesh.sides import Sides, sides_of
from modalmotion.template.coordinates.axis import corner_steps

Floats = np.ndarray
pytestmark = compiled


def ventricle(rng: np.random.Generator) -> tuple[Floats, np.ndarray]:
    vertices, faces = make_ventricle(900, rng)
    order = rng.permutation(vertices.shape[1])
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    return vertices[0, order], place[faces]


def found(faces: np.ndarray, n: int) -> Sides:
    with large():
        sides = sides_of(faces, n)
    assert sides is not None
    return sides


def same(one: Connectivity, other: Connectivity) -> bool:
    names = ("edges", "faces_at_edge", "isolated", "degenerate", "repeated", "pinched")
    arrays = all(np.array_equal(getattr(one, name), getattr(other, name)) for name in names)
    loops = len(one.loops) == len(other.loops) and all(
        np.array_equal(a, b) for a, b in zip(one.loops, other.loops, strict=True)
    )
    counts = ("n_components", "euler_characteristic", "genus")
    return arrays and loops and all(getattr(one, c) == getattr(other, c) for c in counts)


def test_connectivity_is_the_same(rng: np.random.Generator) -> None:
    _, faces = ventricle(rng)
    n = int(faces.max()) + 1
    # Two pieces, with vertices in no triangle between and behind.
    both = np.concatenate([faces, faces[:100] + n + 7])
    sides = found(both, 2 * n + 20)
    assert same(sides.connectivity(), connectivity_of(both, 2 * n + 20))
    assert sides.is_wound
    both[5] = both[5, ::-1]
    assert not found(both, 2 * n + 20).is_wound
    # Both along their edge one way, and both the other.
    for a, b in ((1, 2), (2, 1)):
        assert not found(np.array([[a, b, 0], [a, b, 3]]), 4).is_wound
        assert found(np.array([[a, b, 0], [b, a, 3]]), 4).is_wound


def test_a_fan_of_many_triangles_and_a_pinch_are_the_same(rng: np.random.Generator) -> None:
    # All edges of vertex 0 are sorted at once, by heap; the order of the triangles is any.
    n = 500
    fan = np.stack([np.zeros(n, dtype=np.int64), np.arange(1, n + 1), np.arange(2, n + 2)], axis=1)
    faces = np.concatenate([rng.permutation(fan), [[0, n + 2, n + 3]]])
    connectivity = found(faces, n + 4).connectivity()
    assert same(connectivity, connectivity_of(faces, n + 4))
    assert len(connectivity.pinched) == 1


@pytest.mark.parametrize("more", [[1, 1, 2], [0, 1, 2]])
def test_what_is_no_surface_is_left_to_numpy(more: list[int], rng: np.random.Generator) -> None:
    _, faces = ventricle(rng)
    edge = [*faces[0, :2], faces[50, 2]] if more[0] == 0 else more
    with large():
        assert sides_of(np.concatenate([faces, [edge]]), len(faces)) is None
    with large(10**6):
        assert sides_of(faces, len(faces)) is None


def test_stiffness_and_areas_are_the_same(rng: np.random.Generator) -> None:
    vertices, faces = ventricle(rng)
    faces = np.concatenate([faces, [[3, 3 + 1, 3 + 2]]])
    vertices = np.concatenate([vertices, np.zeros((3, 3))])
    n = len(vertices)
    # A triangle without area weighs nothing.
    faces[-1] = n - 3, n - 2, n - 1
    sides = found(faces, n)
    weights, areas = sides.stiffness(vertices)
    matrix = HalfMatrix.of(sides, weights)
    expected = cotangent_laplacian(vertices, faces)
    x = rng.standard_normal(n)
    assert np.abs(matrix.times(x) - expected @ x).max() < 1e-12 * np.abs(expected @ x).max()
    assert np.allclose(areas, vertex_areas(vertices, faces), rtol=1e-14, atol=0)
    assert areas[-1] == 0


def test_integrals_are_the_same(rng: np.random.Generator) -> None:
    vertices, faces = ventricle(rng)
    sides = found(faces, len(vertices))
    s = vertices[:, 2] + 0.1 * vertices[:, 0] ** 2
    t = np.arctan2(vertices[:, 1], vertices[:, 0]) / (2 * np.pi)
    areas = face_areas(vertices, faces)
    for values, closed in ((s, False), (t, True)):
        corners = corner_steps(values, faces) if closed else values
        lengths = np.linalg.norm(face_gradients(vertices, faces, corners), axis=1)
        mean = float((areas * lengths).sum() / areas.sum())
        assert sides.mean_gradient(vertices, values, closed=closed) == pytest.approx(mean, 1e-12)
    assert np.allclose(sides.vector_area(vertices), face_normals(vertices, faces).sum(axis=0))
    x, y = s[faces] - s[faces][:, :1], corner_steps(t, faces)
    covered = 0.5 * float((x[:, 1] * y[:, 2] - x[:, 2] * y[:, 1]).sum())
    assert sides.covered(s, t, closed=(False, True)) == pytest.approx(covered, 1e-10)
    assert abs(covered) > 0.01
