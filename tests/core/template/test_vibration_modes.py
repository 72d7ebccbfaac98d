"""Vibration modes of lattices, of templates and of meshes: numbers, names and refusals."""

from __future__ import annotations

import numpy as np
import pytest

from modalmotion.errors import ModeCountError, ParameterError
from modalmotion.mesh.sequence import mesh_sequence, standard_surface
from modalmotion.modes import ModeLabel
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import CLOSED_CURVE, CUP, CYLINDER, TORUS, Topology, parse_label
from modalmotion.template import Template, make_template
from modalmotion.template.vibration_modes import (
    lattice_modes,
    lattice_modes_named,
    surface_modes,
    surface_modes_named,
)


@pytest.fixture(scope="module")
def tube() -> Template:
    return make_template(standard_surface(Lattice(CYLINDER, (24, 48))))


@pytest.fixture(scope="module")
def two_pieces() -> Template:
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]])
    x = np.random.default_rng(0).normal(size=(1, 8, 3))
    return make_template(mesh_sequence(x, np.concatenate([faces, faces + 4])))


def test_modes_of_a_lattice_are_whole_and_solve_eq_6() -> None:
    lattice = Lattice(CUP, (6, 8))
    modes = lattice_modes(lattice, 3)
    assert [str(label) for label in modes.labels] == [
        *("(0, 0, cos)", "(1, 0, cos)", "(0, 1, cos)", "(0, 1, sin)")
    ]
    assert modes.shapes.T @ modes.shapes == pytest.approx(48 * np.eye(4), abs=1e-12)
    # The first ring of springs along the axis alone: w^2 = 4 sin^2(pi / 2N).
    assert modes.angular_frequencies[1] == pytest.approx(2 * np.sin(np.pi / 12))


@pytest.mark.parametrize("topology", [CYLINDER, TORUS, CUP, CLOSED_CURVE], ids=str)
def test_names_find_what_numbers_give(topology: Topology) -> None:
    lattice = Lattice(topology, (12, 24)[-topology.n_axes :])
    template = make_template(standard_surface(lattice))
    of_lattice, of_surface = lattice_modes(lattice, 7), surface_modes(template, 7)
    for some, back in (
        (of_lattice, lattice_modes_named(lattice, [*of_lattice.labels[::-1]])),
        (of_surface, surface_modes_named(template, [*of_surface.labels[::-1]])),
    ):
        assert back.shapes == pytest.approx(some.shapes[:, ::-1], abs=1e-14)
        assert back.angular_frequencies == pytest.approx(some.angular_frequencies[::-1])


def test_frequencies_of_a_surface_are_c_k(tube: Template) -> None:
    one, fast = surface_modes(tube, 4), surface_modes(tube, 4, wave_speed=3.0)
    assert one.angular_frequencies[1:] == pytest.approx(
        [np.pi / tube.lengths[0], *2 * (2 * np.pi / tube.lengths[1],)]
    )
    assert fast.angular_frequencies == pytest.approx(3 * one.angular_frequencies)
    assert "3 length units" in fast.frequency_unit
    assert len(repr(one)) <= 120


def test_spring_modes_go_by_their_rank(two_pieces: Template) -> None:
    lowest = surface_modes(two_pieces, 5)
    assert lowest.surface == "mesh"
    named = surface_modes_named(two_pieces, [parse_label("spring 4"), parse_label("(spring 1)")])
    assert named.labels == (ModeLabel((4,), "spring"), ModeLabel((1,), "spring"))
    assert named.angular_frequencies == pytest.approx(lowest.angular_frequencies[[4, 1]])
    with pytest.raises(ParameterError, match="spring 3"):
        surface_modes_named(two_pieces, [parse_label("0,1,cos")])
    with pytest.raises(ParameterError, match="0 to 7"):
        surface_modes_named(two_pieces, [ModeLabel((8,), "spring")])


def test_what_a_surface_does_not_have_is_refused(tube: Template) -> None:
    with pytest.raises(ParameterError, match="closed form"):
        surface_modes_named(tube, [ModeLabel((0,), "spring")])
    surface_modes_named(tube, [ModeLabel((0, 20), "cos")])
    with pytest.raises(ParameterError, match="two edge lengths"):
        surface_modes_named(tube, [ModeLabel((0, 30), "cos")])
    with pytest.raises(ModeCountError, match="1152"):
        surface_modes(tube, 5000)
    with pytest.raises(ModeCountError):
        surface_modes(tube, 0)
    with pytest.raises(ParameterError):
        lattice_modes_named(Lattice(CYLINDER, (4, 8)), [ModeLabel((0, 5), "cos")])
