"""Large meshes are numbered anew, the same way with kernels and without."""

from __future__ import annotations

import numpy as np
import pytest
from mesh_kernels import compiled, large
from template_surfaces import make_ventricle

from modalmotion.mesh import face_areas
from modalmotion.mesh.near_order import near_order


@pytest.mark.parametrize("kernels", [pytest.param(True, marks=compiled), False])
def test_it_is_the_same_surface_with_neighbours_near(
    kernels: bool, rng: np.random.Generator
) -> None:
    vertices, faces = make_ventricle(2000, rng)
    order = rng.permutation(vertices.shape[1])
    scattered, place = vertices[0, order], np.argsort(order)
    assert near_order(scattered, place[faces]) is None
    with large(kernels=kernels):
        found = near_order(scattered, place[faces])
    assert found is not None
    new, near_faces = found
    assert (np.sort(new) == np.arange(len(new))).all()
    # The same triangles, corner by corner, in another order.
    rows = new[near_faces]
    assert {tuple(row) for row in rows.tolist()} == {tuple(row) for row in place[faces].tolist()}
    areas = face_areas(scattered[new], near_faces)
    assert (areas == face_areas(scattered, rows)).all()
    assert np.median(np.ptp(near_faces, axis=1)) < 0.1 * np.median(np.ptp(place[faces], axis=1))
    assert (np.diff(near_faces.min(axis=1)) >= 0).all()


@compiled
def test_kernels_give_the_same_order(rng: np.random.Generator) -> None:
    places = rng.standard_normal((3000, 3))
    # Several at one place keep their order.
    places[1000:1500] = places[:500]
    faces = rng.integers(0, 3000, (5000, 3))
    with large():
        one = near_order(places, faces)
    with large(kernels=False):
        other = near_order(places, faces)
    assert one is not None
    assert other is not None
    assert (one[0] == other[0]).all()
    assert (one[1] == other[1]).all()
