"""Connectivity against direct counting."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from template_surfaces import MAKERS

from modalmotion.mesh import (
    connectivity_of,
    lattice_faces,
    oriented_faces,
)
from modalmotion.modes.topologies import CYLINDER, PLANE, TORUS


def moebius(n: int = 9) -> np.ndarray:
    """A band of n cells with a half turn."""
    low, high = np.arange(n), np.arange(n) + n
    ahead_low = np.append(low[1:], high[0])
    ahead_high = np.append(high[1:], low[0])
    return np.concatenate(
        [np.stack([low, ahead_low, high], 1), np.stack([ahead_low, ahead_high, high], 1)]
    )


def side_counts(faces: np.ndarray) -> Counter[tuple[int, ...]]:
    return Counter(tuple(sorted((int(f[i]), int(f[(i + 1) % 3])))) for f in faces for i in range(3))


@pytest.mark.parametrize(
    ("topology", "n_loops", "euler", "genus"),
    [
        ("cup", 1, 1, 0),
        ("sphere", 0, 2, 0),
        ("torus", 0, 0, 1),
        ("cylinder", 2, 0, 0),
        ("plane", 1, 1, 0),
    ],
)
def test_known_surfaces(topology: str, n_loops: int, euler: int, genus: int) -> None:
    vertices, faces = MAKERS[topology](200, np.random.default_rng(0))
    found = connectivity_of(faces, vertices.shape[1])
    assert len(found.loops) == n_loops
    assert found.euler_characteristic == euler
    assert found.genus == genus
    assert found.n_components == 1
    assert not len(found.non_manifold_edges)
    assert not len(found.pinched)
    counts = side_counts(faces)
    assert {
        tuple(e): c for e, c in zip(found.edges.tolist(), found.faces_at_edge, strict=True)
    } == (counts)
    border = {edge for edge, count in counts.items() if count == 1}
    assert {tuple(e) for loop in found.loops for e in loop.tolist()} == border


def test_triangles_that_repeat_others_count_once() -> None:
    vertices, faces = MAKERS["sphere"](120, np.random.default_rng(2))
    once = connectivity_of(faces, vertices.shape[1])
    twice = connectivity_of(np.concatenate([faces, faces[::-1, ::-1]]), vertices.shape[1])
    assert twice.repeated.tolist() == list(range(len(faces), 2 * len(faces)))
    np.testing.assert_array_equal(twice.edges, once.edges)
    assert (twice.n_components, twice.genus, len(twice.non_manifold_edges)) == (1, 0.0, 0)
    # Two that lie on each other alone are a closed surface without volume, as ever.
    pillow = connectivity_of(np.array([[0, 1, 2], [2, 1, 0]]), 3)
    assert (len(pillow.repeated), pillow.genus) == (0, 0.0)


@given(st.integers(0, 2**32 - 1), st.integers(3, 30), st.integers(1, 30))
def test_any_triangles_are_counted(seed: int, n_vertices: int, n_faces: int) -> None:
    faces = np.random.default_rng(seed).integers(0, n_vertices, size=(n_faces, 3))
    found = connectivity_of(faces, n_vertices)
    proper = np.array([f for f in faces.tolist() if len(set(f)) == 3], dtype=int).reshape(-1, 3)
    assert len(found.degenerate) == n_faces - len(proper)
    if max(side_counts(proper).values(), default=0) > 2:
        # Of the same three vertices the first counts.
        sets = [frozenset(f) for f in proper.tolist()]
        proper = proper[[i for i, one in enumerate(sets) if one not in sets[:i]]]
    assert len(found.left_out) == n_faces - len(proper)
    assert not set(found.degenerate.tolist()) & set(found.repeated.tolist())
    counts = side_counts(proper)
    assert len(found.edges) == len(counts)
    assert len(found.non_manifold_edges) == sum(c > 2 for c in counts.values())
    used = set(proper.ravel().tolist())
    assert set(found.isolated.tolist()) == set(range(n_vertices)) - used
    assert found.euler_characteristic == len(used) - len(counts) + len(proper)
    # Pieces by flooding.
    left, pieces = set(used), 0
    while left:
        pieces, front = pieces + 1, {left.pop()}
        while front:
            near = {v for e in counts for v in e if front & set(e)} & left
            left, front = left - near, near
    assert found.n_components == pieces


def test_two_strips_that_touch_in_a_point() -> None:
    faces = np.array([[0, 1, 2], [0, 3, 4]])
    assert connectivity_of(faces, 5).pinched.tolist() == [0]


def test_one_sided_and_many_sided() -> None:
    assert connectivity_of(moebius(), 18).genus == 0.5
    assert oriented_faces(moebius(), 18) is None
    book = np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]])
    assert connectivity_of(book, 5).non_manifold_edges.tolist() == [[0, 1]]


@pytest.mark.parametrize("topology", [PLANE, CYLINDER, TORUS])
def test_faces_are_wound_as_the_first(topology: object) -> None:
    faces = lattice_faces(topology, (5, 6))  # type: ignore[arg-type]
    turned = np.where(np.random.default_rng(1).random((len(faces), 1)) < 0.5, faces[:, ::-1], faces)
    turned[0] = faces[0]
    found = oriented_faces(turned, 30)
    assert found is not None
    directed = Counter((int(f[i]), int(f[(i + 1) % 3])) for f in found for i in range(3))
    assert max(directed.values()) == 1
    assert (found[0] == turned[0]).all()
    assert (np.sort(found, axis=1) == np.sort(faces, axis=1)).all()
