"""Segments of the left ventricle, and their inward motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from viewed_surfaces import viewed

from modalmotion.clinical.segments import RINGS, SEGMENTS, RegionalMotion, regional_motion
from modalmotion.errors import TopologyError
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence, standard_surface
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import CUP
from modalmotion.signature.making import modal_signature
from modalmotion.simulate import Acquisition, VentricleParameters, simulate_ventricle
from modalmotion.simulate.parameters import TERRITORY_CENTRES, Territory

# At azimuth 270 degrees, as the simulated ventricle counts them.
ANTERIOR = (0.0, -20.0, 40.0)
_OF_LAD = (0, 1, 6, 7, 12, 13, 16)


def motion_of(sequence: MeshSequence) -> RegionalMotion:
    return regional_motion(modal_signature(sequence), sequence, 0)


def stated(sequence: MeshSequence, **facts: object) -> MeshSequence:
    return sequence.with_facts(replace(sequence.facts, **facts))  # type: ignore[arg-type]


def cup(shares: list[float]) -> MeshSequence:
    """A cup that shrinks towards its axis, by these shares of its radius."""
    still = standard_surface(Lattice(CUP, (24, 24)))
    frames = [still.vertices[0] * [1.0 - share, 1.0 - share, 1.0] for share in shares]
    return mesh_sequence(np.stack(frames), grid=still.grid, topology=CUP)


def test_a_cylinders_wall_moves_by_the_share_of_its_radius() -> None:
    shares = motion_of(cup([0.0, 0.1, 0.25])).shares
    # Near its base the wall is all but parallel to the axis, and normals are radial.
    np.testing.assert_allclose(shares[:, 0], [0.0, 10.0, 25.0], rtol=0.05, atol=1e-9)


def test_rotation_and_drift_of_the_whole_do_not_count() -> None:
    still = cup([0.0, 0.1])
    c, s = np.cos(0.4), np.sin(0.4)
    turned = np.array(still.vertices)
    turned[1] = turned[1] @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]).T + [5, 6, 7]
    moved = mesh_sequence(turned, grid=still.grid, topology=CUP)
    np.testing.assert_allclose(motion_of(moved).shares, motion_of(still).shares, atol=0.02)


def test_without_the_anterior_wall_there_are_rings_and_a_reason() -> None:
    rings = motion_of(cup([0.0, 0.1]))
    assert rings.names == RINGS
    assert not rings.has_segments
    assert "anterior" in rings.reason
    beat = simulate_ventricle(grid=(12, 24))
    unknown = stated(beat, landmarks={"anterior": ANTERIOR}, handedness="unknown")
    assert "handed" in motion_of(unknown).reason


@pytest.mark.parametrize("hand", ["right", "left"])
def test_an_akinetic_wall_is_found_in_its_artery_s_segments(hand: str) -> None:
    azimuth, height = TERRITORY_CENTRES[Territory.LAD]
    ill = VentricleParameters(
        akinesia=1.0, akinesia_azimuth=azimuth, akinesia_height=height, ejection_fraction=0.4
    )
    beat = simulate_ventricle(ill, grid=(24, 48), acquisition=Acquisition(n_frames=8))
    anterior = ANTERIOR
    if hand == "left":
        mirror = np.array([-1.0, 1.0, 1.0])
        beat = replace(beat, vertices=beat.vertices * mirror)
        anterior = (0.0, -20.0, 40.0)
    beat = stated(beat, landmarks={"anterior": anterior}, handedness=hand)
    motion = motion_of(beat)
    assert motion.names == SEGMENTS
    assert motion.reason == ""
    systole = motion.shares[np.nanmean(motion.shares, axis=1).argmax()]
    rest = [i for i in range(17) if i not in _OF_LAD]
    # The middle of its region lies between the anterior and the anteroseptal wall.
    assert {*np.argsort(systole)[:2].tolist()} == {6, 7}
    assert systole[[*_OF_LAD]].mean() < systole[rest].mean()


def test_a_healthy_wall_is_even_and_every_segment_has_vertices() -> None:
    beat = simulate_ventricle(grid=(24, 48), acquisition=Acquisition(n_frames=6))
    motion = motion_of(stated(beat, landmarks={"anterior": ANTERIOR}))
    assert np.isfinite(motion.shares).all()
    for ring in (slice(0, 6), slice(6, 12), slice(12, 16)):
        assert np.ptp(motion.shares[:, ring], axis=1).max() < 1.0


def test_a_vertex_may_name_the_anterior_wall() -> None:
    beat = simulate_ventricle(grid=(24, 48), acquisition=Acquisition(n_frames=3))
    nearest = int(np.linalg.norm(beat.vertices[0] - np.array(ANTERIOR), axis=1).argmin())
    by_vertex = motion_of(stated(beat, landmarks={"anterior": nearest}))
    by_point = motion_of(stated(beat, landmarks={"anterior": ANTERIOR}))
    np.testing.assert_allclose(by_vertex.shares, by_point.shares, atol=0.5)


def test_other_surfaces_have_no_segments() -> None:
    sequence, signature = viewed("torus")
    with pytest.raises(TopologyError, match="torus"):
        regional_motion(signature, sequence, 0)
