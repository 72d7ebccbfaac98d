"""Strain of a ventricle's wall."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from viewed_surfaces import viewed

from modalmotion.clinical.segments import RINGS, SEGMENTS
from modalmotion.clinical.strain import Strain, wall_strain
from modalmotion.errors import ParameterError, TopologyError
from modalmotion.facts import Facts
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.mesh.standard_surfaces import standard_surface
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topology import CUP
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.simulate import simulate_ventricle

MATERIAL = Facts(tracking="material", handedness="right")


def stretched(*factors: tuple[float, float, float], facts: Facts = MATERIAL) -> MeshSequence:
    still = standard_surface(Lattice(CUP, (16, 24))).vertices[0]
    frames = np.stack([still * np.array(factor) for factor in ((1.0, 1.0, 1.0), *factors)])
    return mesh_sequence(frames, grid=(16, 24), topology=CUP, facts=facts)


def strain_of(sequence: MeshSequence, modes: int = 21) -> Strain:
    signature = modal_signature(sequence, SignatureParameters(modes=modes))
    return wall_strain(signature, sequence, 0)


def test_an_even_scaling_is_the_same_strain_everywhere() -> None:
    strain = strain_of(stretched((0.8, 0.8, 0.8), (1.1, 1.1, 1.1)))
    np.testing.assert_allclose(strain.whole, [[0, 0], [-20, -20], [10, 10]], atol=1e-9)
    np.testing.assert_allclose(strain.by_segment[1], -20.0, atol=1e-9)
    assert strain.names == RINGS
    np.testing.assert_allclose(strain.peak, [-20.0, -20.0])


def test_narrowing_is_circumferential_and_turning_is_none() -> None:
    narrowed = strain_of(stretched((0.75, 0.75, 1.0)))
    np.testing.assert_allclose(narrowed.by_segment[1, :, 0], -25.0, atol=0.05)
    # Near the base the wall is along the axis.
    assert abs(narrowed.by_segment[1, 0, 1]) < 2.0
    still = stretched()
    c, s = np.cos(0.5), np.sin(0.5)
    turned = still.vertices[0] @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]) + [3.0, 4.0, 5.0]
    moved = replace(still, vertices=np.stack([still.vertices[0], turned]))
    np.testing.assert_allclose(strain_of(moved).whole, 0.0, atol=1e-9)


def test_the_bound_is_the_difference_that_few_modes_make() -> None:
    beat = simulate_ventricle(grid=(16, 32))
    few, many = strain_of(beat, 4), strain_of(beat, 40)
    np.testing.assert_array_equal(few.whole, many.whole)
    assert few.whole_bounds.max() > 3 * many.whole_bounds.max()


def test_a_healthy_ventricle_shortens_as_it_was_made_to() -> None:
    beat = simulate_ventricle(grid=(24, 48))
    strain = strain_of(beat)
    circumferential, longitudinal = strain.peak
    # Its endocardium shortens by 19 % along the axis, and more around it.
    assert -24.0 < longitudinal < -14.0
    assert circumferential < longitudinal
    facts = replace(beat.facts, landmarks={"anterior": (0.0, -20.0, 40.0)})
    assert strain_of(beat.with_facts(facts)).names == SEGMENTS


def test_points_that_may_slide_have_no_strain() -> None:
    with pytest.raises(ParameterError, match="tracking=material"):
        strain_of(stretched((0.8, 0.8, 0.8), facts=Facts()))
    sequence, signature = viewed("torus")
    with pytest.raises(TopologyError):
        wall_strain(signature, sequence.with_facts(MATERIAL), 0)
