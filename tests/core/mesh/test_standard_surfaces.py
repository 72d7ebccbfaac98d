"""Lattices of each topology in space: recognised as what they are."""

from __future__ import annotations

import numpy as np
import pytest

from modalmotion.errors import TopologyError
from modalmotion.mesh import cavity_of, connectivity_of
from modalmotion.mesh.sequence import standard_surface
from modalmotion.mesh.triangles import step_lengths
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import (
    CLOSED_CURVE,
    CUP,
    CYLINDER,
    OPEN_CURVE,
    PLANE,
    SPHERE,
    TORUS,
    Topology,
    lattice_coordinates,
)
from modalmotion.template import make_template


@pytest.mark.parametrize(
    ("topology", "characteristic"), [(PLANE, 1), (CYLINDER, 0), (TORUS, 0), (CUP, 0), (SPHERE, 0)]
)
def test_surfaces_are_joined_as_their_topology_says(
    topology: Topology, characteristic: int
) -> None:
    surface = standard_surface(Lattice(topology, (12, 24)))
    # A pole is a hole half a step wide: one less for each.
    assert connectivity_of(surface.faces, surface.n_vertices).euler_characteristic == characteristic
    template = make_template(surface)
    assert template.surface == topology
    assert template.coordinates == pytest.approx(lattice_coordinates(topology, (12, 24)))


def test_sizes() -> None:
    ring = standard_surface(Lattice(CLOSED_CURVE, (500,)))
    assert step_lengths(ring.vertices[0], CLOSED_CURVE).sum() == pytest.approx(2 * np.pi, rel=1e-4)
    line = standard_surface(Lattice(OPEN_CURVE, (500,))).vertices[0]
    assert np.ptp(line[:, 0]) == pytest.approx(0.55 * 2 * np.pi, rel=3e-3)
    ball = standard_surface(Lattice(SPHERE, (60, 120)))
    cavity = cavity_of(ball.faces, ball.n_vertices)
    assert abs(cavity.volume(ball.vertices.astype(np.float64))[0]) == pytest.approx(
        4 * np.pi / 3, rel=3e-3
    )


def test_a_volume_is_not_a_surface() -> None:
    with pytest.raises(TopologyError):
        standard_surface(Lattice(Topology.parse("open x open x open"), (3, 3, 3)))
