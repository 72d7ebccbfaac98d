"""Connectivity and the order of the vertices: exact, and cheap where there is a pattern."""

from __future__ import annotations

import math
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from modalmotion.codec.bits import mixed_matrix
from modalmotion.codec.bits.entropy import Reader, Writer
from modalmotion.codec.bits.matrix import code_matrix
from modalmotion.codec.bits.mixed_matrix import code_mixed_matrix
from modalmotion.codec.bits.mixing import CHANCES, LOGARITHMS, Mixer
from modalmotion.codec.connectivity import faces as codec_faces
from modalmotion.codec.connectivity.faces import read_faces, write_faces
from modalmotion.codec.connectivity.numbering import LOGARITHMS as TRUST_LOGARITHMS
from modalmotion.codec.connectivity.rings import MOST_LOOKS, NOWHERE, Rings
from modalmotion.codec.machine.image import image
from modalmotion.errors import MalformedFileError
from modalmotion.mesh import lattice_faces
from modalmotion.modes.topology import CYLINDER, TORUS

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
@pytest.mark.parametrize("keep_order", [True, False])
@pytest.mark.parametrize("seed", range(6))
def test_any_triangles_come_back(keep_order: bool, seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 40))
    faces = rng.integers(0, n, size=(int(rng.integers(1, 80)), 3))
    data = write_faces(n, None, faces, keep_order=keep_order)
    found = read_faces(data, len(faces), n, None)
    assert as_set(found) == as_set(faces)
    if keep_order:
        assert np.array_equal(found, faces)


def test_a_pattern_in_the_numbers_is_cheap_and_disorder_costs_what_it_must() -> None:
    faces, n = refined(2)
    ordered = len(write_faces(n, None, faces, keep_order=False))
    shuffled = np.random.default_rng(2).permutation(n)
    disordered = len(write_faces(n, None, shuffled[faces], keep_order=False))
    permutation = math.lgamma(n + 1) / math.log(2.0) / 8.0
    # Refined twice, twenty vertices in no order that matters; then n! orders.
    assert ordered < 0.6 * permutation
    assert 0.9 * permutation < disordered < permutation + ordered


def test_rows_cost_a_fraction_of_a_bit() -> None:
    faces, n = lattice_faces(CYLINDER, (12, 20)), 240
    faces = faces[np.random.default_rng(0).permutation(len(faces))]
    assert 8 * len(write_faces(n, None, faces, keep_order=False)) < 2 * n


def test_relations_pay_and_are_left_out_of_large_meshes(monkeypatch: pytest.MonkeyPatch) -> None:
    faces, n = refined(1)
    with_relations = write_faces(n, None, faces, keep_order=False)
    monkeypatch.setattr(codec_faces, "LARGEST_RELATED", n - 1)
    without = write_faces(n, None, faces, keep_order=False)
    assert with_relations[2] == 6
    assert without[2] == 0
    assert len(with_relations) < len(without)
    assert as_set(read_faces(without, len(faces), n, None)) == as_set(faces)


def test_a_hub_is_looked_at_no_longer_than_others() -> None:
    n = 600
    rim = np.arange(1, n)
    faces = np.stack([np.zeros(n - 1, np.int64), rim, np.roll(rim, -1)], axis=1)
    rings = Rings(n, faces.tolist())
    assert len(rings.around[0]) == n - 1
    around = rings.breadth_first(1, NOWHERE, 40)
    # The hub itself is listed, what lies beyond it is not.
    assert 0 in around.nodes
    assert len(rings.around[0]) > MOST_LOOKS * 40
    assert len(around.nodes) <= 41
    data = write_faces(n, None, faces, keep_order=False)
    assert as_set(read_faces(data, n - 1, n, None)) == as_set(faces)


def test_paths_lead_where_they_were_seen_to_lead() -> None:
    faces, n = refined(1)
    rings = Rings(n, faces.tolist())
    for v in range(0, n, 11):
        origin = rings.around[v][2]
        around = rings.breadth_first(v, origin, 60)
        assert around.nodes[0] == v
        assert len(set(around.nodes)) == len(around.nodes) == 61
        for place, node in enumerate(around.nodes):
            way = around.way_back(place)[::-1]
            assert rings.follow(v, origin, rings.path_along(origin, way)) == node


def test_rings_go_round() -> None:
    faces, n = refined(1)
    rings = Rings(n, faces.tolist())
    sides = {(a, b) for f in faces.tolist() for a, b in zip(f, f[1:] + f[:1], strict=True)}
    for v, ring in enumerate(rings.around):
        assert sorted(ring) == sorted(b for a, b in sides if a == v)
        for x, y in zip(ring, ring[1:] + ring[:1], strict=True):
            assert (x, y) in sides


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 10**9)), max_size=40))
def test_answers_and_numbers_come_back(asked: list[tuple[int, int]]) -> None:
    writer = Writer()
    mixer = Mixer(writer)
    for question, value in asked:
        mixer.number(question, [value % 2, "any"], value)
        mixer.bit(9, [question], value % 3 == 0)
    mixer = Mixer(Reader(writer.finish()))
    for question, value in asked:
        assert mixer.number(question, [value % 2, "any"], None) == value
        assert mixer.bit(9, [question], None) == (value % 3 == 0)


def test_an_answer_that_can_be_foreseen_costs_next_to_nothing() -> None:
    writer = Writer()
    mixer = Mixer(writer)
    for i in range(4000):
        # Only the second context knows.
        mixer.bit(0, [0, i % 3], i % 3 == 0)
    assert 8 * len(writer.finish()) < 100


def test_tables_are_far_from_half_way() -> None:
    # Two mathematical libraries that differ in the last bits round them alike.
    exact = 65536.0 / (1.0 + np.exp(-np.arange(-2047, 2048) / 256.0))
    for values, table in (
        (256.0 * np.log(np.arange(252) + 0.4), LOGARITHMS),
        (exact, CHANCES),
        (1024.0 * np.log(np.arange(1, 43)), TRUST_LOGARITHMS[1:]),
    ):
        assert np.abs(values - np.array(table)).max() < 0.5 - 1e-6


@pytest.mark.every(2)
@pytest.mark.parametrize("scale", [0.0, 0.3, 5.0, 4000.0])
def test_mixed_matrices_come_back_and_are_not_larger(scale: float) -> None:
    rng = np.random.default_rng(4)
    falls = np.exp(-np.arange(12)[:, None] / 4 - np.arange(150) / 40)
    values = np.rint(scale * 4 * falls * rng.laplace(size=(12, 150))).astype(np.int64)
    sizes = []
    for code in (code_matrix, code_mixed_matrix):
        writer = Writer()
        code(writer, values.shape, values)
        data = writer.finish()
        sizes.append(len(data))
        assert np.array_equal(code(Reader(data), values.shape, None), values)
    # Chance alone: what is left to learn is the same for both.
    assert sizes[1] <= 1.05 * sizes[0] + 8


def test_more_entries_than_are_mixed_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    values = np.ones((4, 40), dtype=np.int64)
    writer = Writer()
    code_mixed_matrix(writer, values.shape, values)
    monkeypatch.setattr(mixed_matrix, "MOST_MIXED", 159)
    with pytest.raises(MalformedFileError, match="160 entries"):
        code_mixed_matrix(Reader(writer.finish()), values.shape, None)


def test_damaged_faces_are_refused_or_other_triangles_of_the_same_vertices() -> None:
    rng = np.random.default_rng(1)
    faces, n = refined(0)
    data = write_faces(n, None, faces, keep_order=False)
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


@pytest.mark.skipif(image() is None, reason="the kernels are not compiled")
def test_vertices_in_any_order_take_many_bits_and_no_more_memory(rng: np.random.Generator) -> None:
    faces = lattice_faces(TORUS, (40, 30))
    scattered = rng.permutation(1200)[faces]
    tracemalloc.start()
    try:
        data = write_faces(1200, None, scattered, keep_order=False, n_relations=0)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    # Ten bits a vertex, where there was room for a thousand at first.
    assert len(data) > 1200
    assert peak < 60e6
    assert as_set(read_faces(data, len(faces), 1200, None)) == as_set(scattered)
