"""Mode shapes that are exact for affine motions, their amplitudes those of the modes."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from modalmotion.mesh.sequence import mesh_sequence, standard_surface
from modalmotion.modes import lowest_modes
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import CLOSED_CURVE, CUP, CYLINDER, PLANE, SPHERE, Topology
from modalmotion.template import Template, make_template
from modalmotion.template.body_frame import affine_shapes, unit_coordinates
from modalmotion.template.template import shapes_of

A = np.array([[0.8, 0.1, -0.05], [0.02, 0.85, 0.1], [0.0, -0.1, 0.9]])


def template_of(topology: Topology, *, loose: int = 0) -> Template:
    grid = (10, 16)
    base = standard_surface(Lattice(topology, grid))
    x = base.vertices[0] * np.array([25.0, 22.0, 40.0]) + np.array([100.0, -40.0, 7.0])
    x = np.concatenate([x, 200.0 + np.arange(3.0 * loose).reshape(-1, 3)])
    return make_template(mesh_sequence(x[None], base.faces, unit="mm"))


def shapes_in(template: Template, n_modes: int) -> NDArray[np.float64]:
    return shapes_of(lowest_modes(template.topology, n_modes), template)


def amplitudes_of(
    shapes: NDArray[np.float64], template: Template, u: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Weighted least squares, by numpy alone."""
    root = np.sqrt(template.weights)[:, None]
    return np.asarray(np.linalg.lstsq(root * shapes, root * u, rcond=None)[0])


@pytest.mark.parametrize("topology", [CUP, CYLINDER, SPHERE])
def test_an_affine_motion_is_superposed_exactly(topology: Topology) -> None:
    template = template_of(topology)
    x, phi = template.vertices, shapes_in(template, 21)
    u = x @ (A - np.eye(3)).T + np.array([1.0, 2.0, 3.0])
    a = amplitudes_of(phi, template, u)
    # The modes alone leave a tenth of a millimetre or more.
    assert np.abs(phi @ a - u).max() > 0.1
    assert affine_shapes(phi, template) @ a == pytest.approx(u, abs=1e-6)


@pytest.mark.parametrize("topology", [CUP, PLANE, SPHERE])
def test_amplitudes_stay_what_they_are(topology: Topology) -> None:
    template = template_of(topology)
    phi = shapes_in(template, 21)
    a = np.random.default_rng(0).normal(size=(phi.shape[1], 3))
    u = affine_shapes(phi, template) @ a
    assert amplitudes_of(phi, template, u) == pytest.approx(a, abs=1e-8)


def test_as_the_formula_says(rng: np.random.Generator) -> None:
    template = template_of(CUP)
    phi = shapes_in(template, 21)
    q = unit_coordinates(template.vertices / 100.0, template.weights)
    held = amplitudes_of(phi, template, q)
    slow = phi + (q - phi @ held) @ np.linalg.pinv(held)
    assert affine_shapes(phi, template) == pytest.approx(slow, abs=1e-7)
    assert (template.weights @ q**2) == pytest.approx(np.ones(4))
    moved = unit_coordinates(template.vertices[:, [2, 0, 1]] / 7.0, template.weights)
    assert np.abs(moved) == pytest.approx(np.abs(q), abs=1e-9)


def test_what_the_modes_do_not_hold_is_left_to_them() -> None:
    template = template_of(CUP)
    one = shapes_in(template, 1)
    # One mode holds translations, which it holds exactly.
    assert affine_shapes(one, template) == pytest.approx(one, abs=1e-9)
    flat = make_template(
        mesh_sequence(np.zeros((1, 12, 3)), np.zeros((0, 3), dtype=int), topology=CLOSED_CURVE)
    )
    assert np.array_equal(affine_shapes(np.ones((12, 1)), flat), np.ones((12, 1)))


def test_loose_vertices_move_as_their_nearest() -> None:
    template = template_of(CUP, loose=2)
    whole = affine_shapes(shapes_in(template, 21), template)
    used = np.delete(whole, template.isolated, axis=0)
    for row in whole[template.isolated]:
        assert (np.abs(used - row).max(axis=1) == 0.0).any()
