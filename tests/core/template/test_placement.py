"""Axes of templates: of all frames, and turned by errors as their slopes say."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from template_surfaces import MAKERS

from modalmotion.mesh import vertex_areas
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.template import GivenLandmarks, Template, make_template
from modalmotion.template.landmarks import LANDMARKS_ON

Floats = NDArray[np.float64]


def moving(topology: str, n: int = 400) -> MeshSequence:
    vertices, faces = MAKERS[topology](n, np.random.default_rng(0))
    return mesh_sequence(vertices, faces, topology=topology, unit="mm")


def repeated(sequence: MeshSequence, n_frames: int) -> MeshSequence:
    first = sequence.vertices[0].astype(np.float64)
    return replace(sequence, vertices=np.stack([first] * n_frames))


def noisy(sequence: MeshSequence, seed: int, sigma: float = 0.4) -> MeshSequence:
    e = np.random.default_rng(seed).normal(0.0, sigma, sequence.vertices.shape)
    return replace(sequence, vertices=sequence.vertices + e)


def turn_between(one: Floats, other: Floats) -> Floats:
    W = other @ one.T
    found: Floats = np.array([W[2, 1] - W[1, 2], W[0, 2] - W[2, 0], W[1, 0] - W[0, 1]]) / 2
    return found


@pytest.mark.parametrize(
    ("topology", "given"),
    [
        *((topology, {}) for topology in sorted(MAKERS)),
        ("cup", {"theta_zero": 17}),
        ("cylinder", {"apex": 5, "theta_zero": 100}),
        ("sphere", {"apex": 5, "base": (0.0, 0.0, 50.0)}),
    ],
)
def test_slopes_are_those_of_differences(topology: str, given: dict[str, Any]) -> None:
    placement = make_template(moving(topology), landmarks=GivenLandmarks(**given)).placement
    assert placement is not None
    mean = placement.mean
    e = 1e-7 * np.random.default_rng(1).normal(size=mean.vertices.shape)
    places = {
        name: place + (e[placement.vertices[name]] if name in placement.vertices else 0.0)
        for name, place in placement.mean_places.items()
    }
    moved = placement.axes_of(mean.moved_to(mean.vertices + e), places)
    expected = turn_between(placement.axes.matrix, moved.matrix)
    found = np.einsum("kvc,vc->k", placement.slopes(), e * placement.scale)
    assert found == pytest.approx(expected, rel=0.01, abs=1e-3 * np.abs(expected).max())


@pytest.mark.parametrize("topology", ["cup", "cylinder", "sphere", "plane"])
def test_a_turned_template_is_that_of_turned_axes(topology: str) -> None:
    template = make_template(moving(topology))
    placement = template.placement
    assert placement is not None
    w = np.array([0.01, -0.02, 0.03])
    axes = placement.axes.turned(w)
    assert turn_between(placement.axes.matrix, axes.matrix) == pytest.approx(w, abs=1e-4)
    made = placement.make(placement.surface, placement.places, axes)
    assert made is not None
    turned = template.turned(w)
    assert turned.coordinates == pytest.approx(made.values, abs=1e-12)
    assert turned.landmarks is not None
    assert turned.landmarks.axis == pytest.approx(axes.axis)
    assert template.turned(np.zeros(3)).coordinates == pytest.approx(template.coordinates)


def test_axes_are_as_sure_as_all_frames_make_them() -> None:
    sequence = moving("cup")
    clean = make_template(sequence).landmarks
    assert clean is not None

    def off(n_frames: int) -> float:
        # The same shape over and over: more frames of it say more.
        still = repeated(sequence, n_frames)
        exact = make_template(still).landmarks
        assert exact is not None
        zeros = [make_template(noisy(still, seed)).landmarks for seed in range(12)]
        apart = [one.theta_zero - exact.theta_zero for one in zeros if one is not None]
        return float(np.sqrt((np.array(apart) ** 2).sum(axis=1).mean()))

    assert off(25) < 0.35 * off(1)


def test_areas_are_not_those_of_one_frames_roughness() -> None:
    sequence = moving("cup", 1200)
    exact = make_template(sequence).weights

    def off(template: Template) -> float:
        return float(np.abs(template.weights - exact).sum())

    rough = noisy(sequence, 3)
    areas = vertex_areas(rough.vertices[0], rough.faces)
    assert off(make_template(rough)) < 0.6 * np.abs(areas / areas.sum() - exact).sum()


def test_a_recording_in_which_nothing_moves_is_taken_as_it_is() -> None:
    one = moving("cup")
    still, single = repeated(one, 5), repeated(one, 1)
    assert make_template(still).id == make_template(single).id
    assert np.array_equal(make_template(still).coordinates, make_template(single).coordinates)


def test_every_landmark_that_may_be_a_vertex_is_one() -> None:
    for topology, names in LANDMARKS_ON.items():
        for name in set(names) - {"corners"} if topology in MAKERS else ():
            given = GivenLandmarks.from_json({name: 40})
            placement = make_template(moving(topology), landmarks=given).placement
            assert placement is not None
            assert placement.vertices == {name: 40}
