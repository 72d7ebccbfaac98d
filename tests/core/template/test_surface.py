"""A large mesh is numbered anew and worked on by kernels; its template does not show it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from mesh_kernels import compiled, large
from template_surfaces import (
    Moving,
    make_blob,
    make_ring,
    make_sheet,
    make_tube,
    make_ventricle,
)

from modalmotion.errors import TopologyError
from modalmotion.mesh import half_matrix
from modalmotion.mesh.sequence import mesh_sequence
from modalmotion.template import Template, make_template

Maker = Callable[[int, np.random.Generator], Moving]
WITH_AND_WITHOUT = [pytest.param(True, marks=compiled), False]


def scattered(maker: Maker, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    vertices, faces = maker(700, rng)
    order = rng.permutation(vertices.shape[1])
    return vertices[:1, order], np.argsort(order)[faces]


def require_same(one: Template, other: Template) -> None:
    assert one.surface == other.surface
    assert one.notes == other.notes
    assert one.id == other.id
    assert (one.isolated == other.isolated).all()
    assert (one.faces == other.faces).all()
    apart = one.coordinates - other.coordinates
    assert np.abs(apart - np.round(apart)).max(initial=0) < 1e-10
    assert np.allclose(one.weights, other.weights, rtol=1e-12, atol=0)
    assert np.allclose(one.lengths, other.lengths, rtol=1e-11)
    assert one.landmarks is not None
    assert other.landmarks is not None
    assert np.allclose(one.landmarks.axis, other.landmarks.axis, atol=1e-12)
    assert np.allclose(one.landmarks.apex, other.landmarks.apex, atol=1e-10)


@pytest.mark.parametrize("kernels", WITH_AND_WITHOUT)
@pytest.mark.parametrize("maker", [make_ventricle, make_blob, make_ring, make_tube, make_sheet])
def test_a_large_mesh_has_the_template_of_a_small_one(
    maker: Maker, kernels: bool, rng: np.random.Generator
) -> None:
    sequence = mesh_sequence(*scattered(maker, rng))
    small = make_template(sequence)
    with large(kernels=kernels):
        require_same(make_template(sequence), small)


@pytest.mark.parametrize("kernels", WITH_AND_WITHOUT)
def test_loose_doubled_and_turned_parts_keep_their_numbers(
    kernels: bool, rng: np.random.Generator
) -> None:
    vertices, faces = scattered(make_ventricle, rng)
    # A loose vertex in the middle, a doubled one at the end, and triangles wound otherwise.
    vertices = np.concatenate([vertices[:, :90], vertices[:, :1] + 9, vertices[:, 90:]], axis=1)
    faces = faces + (faces >= 90)
    vertices = np.concatenate([vertices, vertices[:, faces[4, :1]]], axis=1)
    faces[::3] = faces[::3, ::-1]
    sequence = mesh_sequence(vertices, faces)
    small = make_template(sequence)
    assert len(small.isolated) == 1
    with large(kernels=kernels):
        require_same(make_template(sequence), small)


@pytest.mark.parametrize("kernels", WITH_AND_WITHOUT)
def test_errors_name_vertices_of_the_mesh(kernels: bool, rng: np.random.Generator) -> None:
    vertices, faces = scattered(make_ventricle, rng)
    faces = np.concatenate([faces, [[faces[7, 0], faces[7, 1], faces[300, 2]]]])
    stated = mesh_sequence(vertices, faces, topology="cup")
    with pytest.raises(TopologyError) as small:
        make_template(stated)
    with large(kernels=kernels), pytest.raises(TopologyError) as found:
        make_template(stated)
    assert str(found.value) == str(small.value)
    assert "more than two triangles" in str(found.value)


@compiled
def test_what_the_kernels_do_not_solve_is_solved(
    monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator
) -> None:
    sequence = mesh_sequence(*scattered(make_tube, rng))
    small = make_template(sequence)
    monkeypatch.setattr(half_matrix, "_MOST_STEPS", 1)
    with large():
        require_same(make_template(sequence), small)
