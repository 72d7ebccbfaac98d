"""What places have in common of what the modes leave."""

from __future__ import annotations

import numpy as np
import pytest

from modalmotion.mesh.sequence import mesh_sequence, standard_surface
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import CLOSED_CURVE, SPHERE
from modalmotion.template import make_template
from modalmotion.tracking.deformable import Deformable, alike_over


def ball() -> Deformable:
    base = standard_surface(Lattice(SPHERE, (40, 60)))
    return Deformable.of(make_template(mesh_sequence(20.0 * base.vertices, base.faces)), 4)


def test_one_place_is_alike_with_itself() -> None:
    assert alike_over(ball(), np.array([7]), np.ones(1), 50.0) == 1.0
    twice = alike_over(ball(), np.array([7, 7]), np.full(2, 0.5), 50.0)
    assert twice == pytest.approx(1.0)


def test_the_whole_surface_has_all_values() -> None:
    surface = ball()
    w = surface.template.weights
    for n_values in (30.0, 100.0):
        alike = alike_over(surface, np.arange(len(w)), w, n_values)
        assert alike == pytest.approx(1.0 / n_values, rel=0.05)


def test_a_ring_passes_through_as_many_patches_as_it_is_long() -> None:
    surface = ball()
    x = surface.template.vertices
    ring = np.flatnonzero(np.abs(x[:, 2] - x[np.abs(x[:, 2]).argmin(), 2]) < 1e-6)
    alike = alike_over(surface, ring, np.full(len(ring), 1.0 / len(ring)), 100.0)
    # l over 2 pi R, with l^2 = 4 pi R^2 / n.
    assert alike == pytest.approx((4 * np.pi / 100.0) ** 0.5 / (2 * np.pi), rel=0.05)


def test_a_curve_is_counted_by_its_length() -> None:
    t = 2 * np.pi * np.arange(200) / 200
    x = 10.0 * np.stack([np.cos(t), np.sin(t), 0 * t], axis=1)
    surface = Deformable.of(
        make_template(mesh_sequence(x[None], topology=CLOSED_CURVE, grid=(200,))), 5
    )
    assert surface.area == pytest.approx(2 * np.pi * 10.0, rel=1e-3)
    alike = alike_over(surface, np.arange(200), np.full(200, 1 / 200), 40.0)
    assert alike == pytest.approx(1 / 40.0, rel=0.05)
