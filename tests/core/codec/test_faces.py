"""Connectivity and the order of the vertices: exact, and cheap where there is a pattern."""

from __future__ import annotations

import math
import tracemalloc

import numpy as np
import pytest
from numpy.typing import NDArray
from text_of_faces import walk

from modalmotion.codec import container as codec_faces
from modalmotion.codec.coder import Coder
from modalmotion.codec.container import read_faces, write_faces
from modalmotion.errors import MalformedFileError
from modalmotion.mesh import lattice_faces
from modalmotion.modes.topologies import CYLINDER, TORUS

Ints = NDArray[np.int64]


def as_set(faces: Ints) -> list[tuple[int, ...]]:
    return sorted(min((a, b, c), (b, c, a), (c, a, b)) for a, b, c in faces.tolist())


def subdivided(faces: Ints, n: int) -> tuple[Ints, int]:
    """Each triangle in four; the new vertices in the order of the sorted edges."""
    sides = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges, which = np.unique(sides, axis=0, return_inverse=True)
    x, y, z = (n + which.reshape(-1, 3)).T
    a, b, c = faces.T
    parts = [(a, x, z), (x, b, y), (z, y, c), (x, y, z)]
    return np.stack([np.stack(p, axis=1) for p in parts], axis=1).reshape(-1, 3), n + len(edges)


def refined(times: int) -> tuple[Ints, int]:
    faces, n = lattice_faces(TORUS, (4, 5)), 20
    for _ in range(times):
        faces, n = subdivided(faces, n)
    return faces, n


@pytest.mark.every(3)
@pytest.mark.parametrize("seed", range(6))
def test_any_triangles_come_back(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 40))
    faces = rng.integers(0, n, size=(int(rng.integers(1, 80)), 3))
    data = write_faces(n, None, faces)
    found = read_faces(data, len(faces), n, None)
    assert as_set(found) == as_set(faces)


def test_a_pattern_in_the_numbers_is_cheap_and_disorder_costs_what_it_must() -> None:
    faces, n = refined(2)
    ordered = len(write_faces(n, None, faces))
    shuffled = np.random.default_rng(2).permutation(n)
    disordered = len(write_faces(n, None, shuffled[faces]))
    permutation = math.lgamma(n + 1) / math.log(2.0) / 8.0
    # Refined twice, twenty vertices in no order that matters; then n! orders.
    assert ordered < 0.6 * permutation
    assert 0.9 * permutation < disordered < permutation + ordered


def test_rows_cost_a_fraction_of_a_bit() -> None:
    faces, n = lattice_faces(CYLINDER, (12, 20)), 240
    faces = faces[np.random.default_rng(0).permutation(len(faces))]
    assert 8 * len(write_faces(n, None, faces)) < 2 * n


def test_relations_pay_and_are_left_out_of_large_meshes(monkeypatch: pytest.MonkeyPatch) -> None:
    faces, n = refined(1)
    with_relations = write_faces(n, None, faces)
    monkeypatch.setattr(codec_faces, "LARGEST_RELATED", n - 1)
    without = write_faces(n, None, faces)
    assert with_relations[1] == 6
    assert without[1] == 0
    assert len(with_relations) < len(without)
    assert as_set(read_faces(without, len(faces), n, None)) == as_set(faces)


def test_a_hub_comes_back() -> None:
    n = 600
    rim = np.arange(1, n)
    faces = np.stack([np.zeros(n - 1, np.int64), rim, np.roll(rim, -1)], axis=1)
    data = write_faces(n, None, faces)
    assert as_set(read_faces(data, n - 1, n, None)) == as_set(faces)


def test_damaged_faces_are_refused_or_other_triangles_of_the_same_vertices() -> None:
    rng = np.random.default_rng(1)
    faces, n = refined(0)
    data = write_faces(n, None, faces)
    for _ in range(300):
        damaged = bytearray(data)
        damaged[int(rng.integers(len(data)))] = int(rng.integers(256))
        try:
            found = read_faces(bytes(damaged), len(faces), n, None)
        except MalformedFileError:
            continue
        assert found.shape == faces.shape
        assert found.min() >= 0
        assert found.max() < n


def test_vertices_in_any_order_take_many_bits_and_no_more_memory(rng: np.random.Generator) -> None:
    faces = lattice_faces(TORUS, (40, 30))
    scattered = rng.permutation(1200)[faces]
    tracemalloc.start()
    try:
        data = write_faces(1200, None, scattered, n_relations=(0,))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    # Ten bits a vertex, where there was room for a thousand at first.
    assert len(data) > 1200
    assert peak < 60e6
    assert as_set(read_faces(data, len(faces), 1200, None)) == as_set(scattered)


def any_faces(rng: np.random.Generator, kind: int) -> tuple[Ints, int]:
    """Triangles at random, rows in some order, a hub, and vertices that no triangle has."""
    rows = int(rng.integers(3, 7)), int(rng.integers(3, 9))
    n = int(np.prod(rows))
    if kind == 0:
        return rng.integers(0, n, size=(int(rng.integers(1, 60)), 3)), n
    if kind == 1:
        faces = lattice_faces(CYLINDER, rows)
        return rng.permutation(n + 2)[faces[rng.permutation(len(faces))]], n + 2
    if kind == 2:
        rim = np.arange(1, n + 18)
        return np.stack([np.zeros(len(rim), np.int64), rim, np.roll(rim, -1)], axis=1), n + 18
    return lattice_faces(TORUS, rows), n


@pytest.mark.parametrize("kind", range(4))
def test_the_text_reads_the_same_faces(kind: int, rng: np.random.Generator) -> None:
    faces, n = any_faces(rng, kind)
    data = write_faces(n, None, faces)
    assert walk(data, len(faces), n) == read_faces(data, len(faces), n, None).tolist()


def test_a_table_that_is_too_small_grows(rng: np.random.Generator) -> None:
    # Scattered triangles meet many more contexts than there are places at first.
    faces = rng.integers(0, 2000, size=(1500, 3))
    data = write_faces(2000, None, faces)
    assert as_set(read_faces(data, 1500, 2000, None)) == as_set(faces)


@pytest.mark.parametrize("n_bytes", [0, 3, 40])
def test_damage_is_refused_or_gives_triangles(n_bytes: int, rng: np.random.Generator) -> None:
    faces, n = any_faces(rng, 1)
    data = write_faces(n, None, faces)
    for _ in range(12):
        try:
            found = read_faces(data[:2] + rng.bytes(n_bytes), len(faces), n, None)
        except MalformedFileError:
            continue
        assert 0 <= found.min() <= found.max() < n


@pytest.mark.parametrize("shape", [(2**28, 1, 0), (3, 2**28, 0), (3, 1, 7)])
def test_what_is_too_large_is_refused_before_anything_is_taken(
    shape: tuple[int, int, int],
) -> None:
    with pytest.raises(MalformedFileError, match="larger than can be coded"):
        Coder(bytes(9)).faces(shape, np.zeros((1, 3), dtype=np.int64))
