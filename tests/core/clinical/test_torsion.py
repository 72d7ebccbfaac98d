"""Torsion and shear of a wall of material points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from modalmotion.clinical.strain import Torsion, torsion
from modalmotion.errors import ParameterError
from modalmotion.mesh import Facts
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence, standard_surface
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import CUP
from modalmotion.template import make_template

STILL = standard_surface(Lattice(CUP, (24, 48))).vertices[0] * 30.0


def turned(degrees_per_length: float, noise: float = 0.0, seed: int = 0) -> MeshSequence:
    """A wall that turns about z in proportion to height."""
    z = STILL[:, 2]
    angle = np.radians(degrees_per_length) * (z - z.min()) / np.ptp(z)
    c, s = np.cos(angle), np.sin(angle)
    moved = np.stack(
        [c * STILL[:, 0] - s * STILL[:, 1], s * STILL[:, 0] + c * STILL[:, 1], z], axis=1
    )
    frames = np.stack([STILL, moved])
    frames += noise * np.random.default_rng(seed).normal(size=frames.shape)
    facts = Facts(tracking="material", handedness="right")
    return mesh_sequence(frames, grid=(24, 48), topology=CUP, facts=facts)


def torsion_of(sequence: MeshSequence) -> Torsion:
    return torsion(sequence, make_template(sequence), 0, 1)


def test_twist_is_the_difference_of_the_turns_of_both_thirds() -> None:
    one, two = (torsion_of(turned(angle)) for angle in (6.0, 12.0))
    template = make_template(turned(0.0))
    assert template.landmarks is not None
    # Thirds are a little over a half of the height apart, and the axis runs from apex to base.
    sign = np.sign(template.landmarks.axis[2])
    apex_is_low = sign > 0
    expected = -1.0 if apex_is_low else 1.0
    assert sign * expected * one.twist[1] > 2.5
    assert two.twist[1] == pytest.approx(2 * one.twist[1], rel=0.01)
    assert abs(two.shear[1]) > abs(one.shear[1]) > 0.5
    assert torsion_of(turned(0.0)).twist[1] == pytest.approx(0.0, abs=1e-9)


def test_its_errors_are_those_of_draws() -> None:
    clean = torsion_of(turned(9.0))
    drawn = [torsion_of(turned(9.0, 1.0, seed)) for seed in range(20)]
    for name in ("twist", "shear"):
        errors = np.array([getattr(one, name)[1] - getattr(clean, name)[1] for one in drawn])
        stated = np.mean([getattr(one, f"{name}_deviations")[1] for one in drawn])
        assert 0.6 < np.sqrt(np.mean(errors**2)) / stated < 1.6


def test_points_that_may_slide_have_none() -> None:
    sliding = replace(turned(9.0), facts=Facts(tracking="normal_displacement"))
    with pytest.raises(ParameterError, match="tracking=material"):
        torsion_of(sliding)
