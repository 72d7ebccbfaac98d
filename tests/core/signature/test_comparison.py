from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from modalmotion.errors import ParameterError, ShapeError
from modalmotion.mesh.sequence import MeshSequence, in_time_order, mesh_sequence
from modalmotion.signature.distance import compare
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.simulate import Acquisition, VentricleParameters, simulate_ventricle


def beat(n_frames: int = 12, **parameters: float) -> MeshSequence:
    return simulate_ventricle(
        VentricleParameters(**parameters),
        n_vertices=600,
        acquisition=Acquisition(n_frames=n_frames),
        rng=np.random.default_rng(5),
    )


def distance(a: MeshSequence, b: MeshSequence) -> float:
    return compare(modal_signature(a), modal_signature(b)).distance


def test_a_sequence_is_at_no_distance_from_itself() -> None:
    assert distance(beat(), beat()) == 0.0


def test_pose_and_unit_do_not_count() -> None:
    one = beat()
    R = Rotation.from_rotvec([0.3, -1.2, 2.0]).as_matrix()
    turned = replace(one, vertices=one.vertices @ R.T + [10.0, -500.0, 3.0])
    assert distance(turned, one) < 1e-9
    metres = mesh_sequence(
        one.vertices / 1000, one.faces, topology=one.topology, times=one.times, unit="m"
    )
    assert distance(metres, one) < 1e-9


def test_another_motion_is_farther_than_another_frame_rate() -> None:
    one = beat()
    assert distance(beat(24), one) < 0.05
    assert distance(beat(ejection_fraction=0.3, longitudinal_shortening=0.08), one) > 0.3


def test_signatures_of_different_modes_are_not_compared() -> None:
    one = beat()
    more = modal_signature(one, SignatureParameters(modes=18))
    with pytest.raises(ParameterError, match="different modes"):
        compare(modal_signature(one), more)
    unknown = mesh_sequence(one.vertices, one.faces, topology=one.topology)
    with pytest.raises(ParameterError, match="unit"):
        compare(modal_signature(one), modal_signature(unknown))


def test_a_cycle_closes_and_half_a_cycle_does_not() -> None:
    whole = beat(20)
    assert modal_signature(whole).closure_gap < 2.0
    half = mesh_sequence(whole.vertices[:9], whole.faces, topology=whole.topology)
    assert modal_signature(half).closure_gap > 4.0
    still = mesh_sequence(whole.vertices[[0, 0]], whole.faces, topology=whole.topology)
    assert modal_signature(still).closure_gap == 0.0


def test_frames_are_sorted_by_time_and_repetitions_dropped(rng: np.random.Generator) -> None:
    vertices = rng.normal(size=(5, 4, 3))
    times = np.array([0.0, 0.1, 0.25, 0.3, 0.5])
    shuffled = [3, 0, 4, 1, 2, 1]
    found, found_times, notes = in_time_order(vertices[shuffled], times[shuffled])
    assert np.array_equal(found, vertices)
    assert np.array_equal(found_times, times)
    assert len(notes) == 2
    assert "out of order" in notes[0]
    assert "dropped" in notes[1]
    untouched, same, nothing = in_time_order(vertices, times)
    assert untouched is vertices
    assert same is times
    assert nothing == ()


def test_two_frames_of_one_time_that_differ_are_refused(rng: np.random.Generator) -> None:
    with pytest.raises(ShapeError, match="Frames 1 and 2"):
        in_time_order(rng.normal(size=(3, 4, 3)), [0.0, 0.1, 0.1])


@pytest.mark.parametrize("times", [[0.0, np.nan, 0.1], [0.0, 0.1], "soon", [[0.0], [1.0], [2.0]]])
def test_what_is_no_list_of_times_is_left_to_the_check_of_sequences(times: object) -> None:
    vertices = np.zeros((3, 1, 3))
    assert in_time_order(vertices, times)[0] is vertices
