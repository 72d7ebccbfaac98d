"""Areas, gradients, Laplacians and the solver, against what they approximate or invert."""

from __future__ import annotations

import numpy as np
import pytest
import scipy
from scipy.sparse import csc_array
from template_remeshing import subdivided
from template_surfaces import MAKERS, cup_points

from modalmotion.mesh import (
    cotangent_laplacian,
    face_areas,
    face_gradients,
    face_normals,
    graph_laplacian,
    solve_positive_definite,
    vertex_areas,
)
from modalmotion.mesh.triangles import connectivity_of


def naive_stiffness(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Integral of products of gradients of hat functions, triangle by triangle."""
    n = len(vertices)
    K = np.zeros((n, n))
    for face in faces:
        a, b, c = vertices[face]
        area = np.linalg.norm(np.cross(b - a, c - a)) / 2
        unit = np.cross(b - a, c - a) / (2 * area)
        slopes = [np.cross(unit, side) / (2 * area) for side in (c - b, a - c, b - a)]
        for i in range(3):
            for j in range(3):
                K[face[i], face[j]] += area * slopes[i] @ slopes[j]
    return K


@pytest.fixture(name="cup")
def _cup() -> tuple[np.ndarray, np.ndarray]:
    return cup_points(300, np.random.default_rng(0))


def test_areas_against_heron(cup: tuple[np.ndarray, np.ndarray]) -> None:
    vertices, faces = cup
    sides = [vertices[faces[:, i]] - vertices[faces[:, (i + 1) % 3]] for i in range(3)]
    a, b, c = (np.linalg.norm(side, axis=1) for side in sides)
    s = (a + b + c) / 2
    heron = np.sqrt(s * (s - a) * (s - b) * (s - c))
    assert face_areas(vertices, faces) == pytest.approx(heron, rel=1e-12)
    assert vertex_areas(vertices, faces).sum() == pytest.approx(heron.sum(), rel=1e-14)
    # A unit sphere up to z = 0.35 has the area 2 pi 1.35.
    assert heron.sum() == pytest.approx(2 * np.pi * 1.35, rel=0.02)
    outward = np.einsum("ij,ij->i", face_normals(vertices, faces), vertices[faces[:, 0]])
    assert np.abs(np.sign(outward).sum()) == len(faces)


def test_gradients_of_linear_functions_are_exact(cup: tuple[np.ndarray, np.ndarray]) -> None:
    vertices, faces = cup
    slope = np.array([1.0, -2.0, 0.5])
    unit = face_normals(vertices, faces)
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    tangential = slope - unit * (unit @ slope)[:, None]
    values = vertices @ slope + 7
    assert face_gradients(vertices, faces, values) == pytest.approx(tangential, abs=1e-12)
    assert face_gradients(vertices, faces, values[faces]) == pytest.approx(tangential, abs=1e-12)


def test_stiffness_against_elements(cup: tuple[np.ndarray, np.ndarray]) -> None:
    vertices, faces = cup
    K = cotangent_laplacian(vertices, faces)
    expected = naive_stiffness(vertices, faces)
    assert np.abs(K.toarray() - expected).max() <= 1e-12 * np.abs(expected).max()


def test_flat_triangles_contribute_nothing(cup: tuple[np.ndarray, np.ndarray]) -> None:
    vertices, faces = cup
    doubled = np.concatenate([vertices, vertices[:1]])
    flat = np.concatenate([faces, [[0, len(vertices), faces[0, 1]]]])
    K = cotangent_laplacian(doubled, flat).toarray()
    assert K[: len(vertices), : len(vertices)] == pytest.approx(
        cotangent_laplacian(vertices, faces).toarray()
    )
    assert (face_gradients(doubled, flat, doubled[:, 0])[-1] == 0).all()


def test_graph_laplacian_is_degree_minus_adjacency(cup: tuple[np.ndarray, np.ndarray]) -> None:
    vertices, faces = cup
    edges = connectivity_of(faces, len(vertices)).edges
    n = len(vertices)
    A = np.zeros((n, n))
    A[edges[:, 0], edges[:, 1]] = A[edges[:, 1], edges[:, 0]] = 1
    assert (graph_laplacian(edges, n).toarray() == np.diag(A.sum(axis=0)) - A).all()


@pytest.mark.parametrize("n", [5, 100, 1500])
def test_the_solver_against_a_dense_one(n: int) -> None:
    vertices, faces = cup_points(n, np.random.default_rng(n))
    K = csc_array(cotangent_laplacian(vertices, faces))
    K = csc_array(K + csc_array(np.diag(vertex_areas(vertices, faces))))
    right = np.random.default_rng(1).normal(size=(len(vertices), 2))
    found = solve_positive_definite(K, right)
    assert found == pytest.approx(np.linalg.solve(K.toarray(), right), abs=1e-10)
    assert solve_positive_definite(K, right[:, 0]) == pytest.approx(found[:, 0])


def test_the_factor_is_small_whatever_the_numbering(monkeypatch: pytest.MonkeyPatch) -> None:
    sizes = []
    splu = scipy.sparse.linalg.splu

    def noted(*matrix: object, **options: object) -> object:
        factors = splu(*matrix, **options)
        sizes.append(factors.nnz / factors.shape[0])
        return factors

    monkeypatch.setattr(scipy.sparse.linalg, "splu", noted)
    # Refined by subdivision, whose numbering minimum degree alone takes long for.
    vertices, faces = subdivided(subdivided(MAKERS["cup"](400, np.random.default_rng(0))))
    K, n = cotangent_laplacian(vertices[0], faces), len(vertices[0])
    K = csc_array(K + csc_array(np.diag(vertex_areas(vertices[0], faces))))
    for order in (np.arange(n), np.random.default_rng(1).permutation(n)):
        solve_positive_definite(K[order][:, order], np.ones(n))
    assert max(sizes) < 8 * np.log2(n)
    assert sizes[1] < 1.1 * sizes[0]
