"""Vertices in no triangle take the shapes of the nearest vertex of the surface."""

from __future__ import annotations

import numpy as np
import pytest

from modalmotion.mesh.sequence import mesh_sequence
from modalmotion.simulate import simulate_ventricle
from modalmotion.template import choose_modes, make_template
from modalmotion.template.body_frame import local_frames
from modalmotion.template.template import nearest_in_use, shapes_of


@pytest.mark.parametrize("closed_form", [True, False])
@pytest.mark.parametrize("far", [7.3, 1e200])
def test_a_loose_vertex_has_the_shapes_and_directions_of_its_nearest(
    closed_form: bool, far: float
) -> None:
    made = simulate_ventricle(n_vertices=150, rng=np.random.default_rng(2))
    x = np.asarray(made.vertices)[:1]
    places = np.stack([x[0, 5] + 1e-3, x[0, 77] - 1e-3, np.full(3, far)])
    together = np.concatenate([places[None], x], axis=1)
    template = make_template(mesh_sequence(together, made.faces + 3), closed_form=closed_form)
    assert template.isolated.tolist() == [0, 1, 2]
    shapes = shapes_of(choose_modes(template, 7)[0], template)
    assert (shapes[:2] == shapes[[8, 80]]).all()
    assert np.isfinite(shapes).all()
    if closed_form:
        assert (template.coordinates[:2] == template.coordinates[[8, 80]]).all()
        frames = local_frames(template)
        assert (frames[:2] == frames[[8, 80]]).all()
        alone = local_frames(make_template(mesh_sequence(x, made.faces)))
        assert frames[3:] == pytest.approx(alone, abs=1e-12)


def test_against_every_distance() -> None:
    rng = np.random.default_rng(0)
    vertices = rng.normal(size=(60, 3))
    isolated = np.array([0, 31, 59])
    used = np.delete(np.arange(60), isolated)
    distances = np.linalg.norm(vertices[isolated][:, None] - vertices[used], axis=2)
    assert (nearest_in_use(vertices, isolated) == used[distances.argmin(axis=1)]).all()


def test_where_nothing_is_in_use_each_is_its_own() -> None:
    assert nearest_in_use(np.zeros((2, 3)), np.array([0, 1])).tolist() == [0, 1]
