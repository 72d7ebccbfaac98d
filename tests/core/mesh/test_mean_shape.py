"""The mean shape as a reference: the same from wherever a recording starts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from foreign_motions import figures
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from modalmotion.errors import ParameterError
from modalmotion.mesh import vertex_areas
from modalmotion.mesh.alignment import mean_shape
from modalmotion.mesh.sequence import MEAN, MeshSequence, mesh_sequence
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.signature.reconstruction import reconstruct
from modalmotion.simulate import Acquisition, Pose, VentricleParameters, simulate_ventricle
from modalmotion.template import make_template
from modalmotion.template.body_frame import Components

ASKED = SignatureParameters(reference=MEAN)


def beat(n_vertices: int | None = None, n_frames: int = 12) -> MeshSequence:
    return simulate_ventricle(
        VentricleParameters(shape_variation=1.0, motion_variation=1.0),
        grid=(12, 24),
        n_vertices=n_vertices,
        acquisition=Acquisition(
            n_frames=n_frames,
            noise=0.5,
            pose=Pose(drift_rotation=(0.2, 0.1, -0.3), drift_translation=(3.0, -2.0, 1.0)),
        ),
        rng=np.random.default_rng(4),
    )


def distances(positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Between every tenth vertex and all others: what no rigid motion changes."""
    apart: NDArray[np.float64] = np.linalg.norm(positions[::10, None] - positions[None], axis=2)
    return apart


def naive_mean(sequence: MeshSequence, rounds: int = 30) -> NDArray[np.float64]:
    """By turns, frame by frame, until nothing changes."""
    frames = sequence.vertices.astype(np.float64)
    mean = np.array(frames[0])
    for _ in range(rounds):
        w = vertex_areas(mean, sequence.faces)
        w = w / w.sum()
        turned = []
        for x in frames:
            turn, _ = Rotation.align_vectors(mean - w @ mean, x - w @ x, weights=w)
            turned.append(turn.apply(x - w @ x))
        mean = np.stack(turned).mean(axis=0)
    return mean


@pytest.mark.parametrize("n_vertices", [None, 400])
def test_it_is_the_mean_of_frames_turned_onto_it(n_vertices: int | None) -> None:
    sequence = beat(n_vertices)
    assert np.allclose(
        distances(mean_shape(sequence)), distances(naive_mean(sequence)), rtol=0, atol=1e-5
    )


@pytest.mark.parametrize("n_vertices", [None, 400])
def test_another_first_frame_changes_neither_shape_nor_amplitudes(n_vertices: int | None) -> None:
    sequence = beat(n_vertices)
    other = replace(sequence, vertices=np.roll(sequence.vertices.astype(np.float64), 5, axis=0))
    a, b = mean_shape(sequence), mean_shape(other)
    assert np.allclose(distances(a), distances(b), rtol=0, atol=1e-5)
    one, two = (modal_signature(s, ASKED) for s in (sequence, other))
    assert np.allclose(a, b, rtol=0, atol=1e-4)
    assert np.allclose(np.roll(one.amplitudes, 5, axis=0), two.amplitudes, rtol=0, atol=1e-4)
    assert np.allclose(np.roll(one.translations, 5, axis=0), two.translations, rtol=0, atol=1e-4)
    # Measured from frame 0 they differ, for that is another shape.
    plain = [modal_signature(s).deformation_spectrum for s in (sequence, other)]
    assert not np.allclose(plain[0], plain[1], rtol=0.05)


@pytest.mark.parametrize("components", Components)
@pytest.mark.parametrize("start", [1, 4, 9])
def test_a_beat_that_turns_and_moves_far_may_start_anywhere(
    components: Components, start: int
) -> None:
    # By 29 degrees and 20 mm: the path of the centroid is in mode 0 with the rest.
    sequence = simulate_ventricle(
        grid=(12, 24),
        acquisition=Acquisition(
            n_frames=12,
            pose=Pose(drift_rotation=(0.0, 0.5, 0.0), drift_translation=(20.0, 0.0, 0.0)),
        ),
        rng=np.random.default_rng(1),
    )
    turned = np.roll(np.asarray(sequence.vertices), -start, axis=0)
    other = replace(sequence, vertices=turned)
    asked = SignatureParameters(reference=MEAN, components=components)
    one, two = (modal_signature(s, asked) for s in (sequence, other))
    size = np.abs(one.amplitudes[:, 0]).max()
    assert size > 3.0
    for name in ("amplitudes", "body_amplitudes", "translations", "rms_errors"):
        rolled = np.roll(getattr(one, name), -start, axis=0)
        assert np.abs(rolled - getattr(two, name)).max() <= 1e-4 * size, name


def test_frames_that_turn_all_the_way_round_point_nowhere() -> None:
    start = np.asarray(beat(n_frames=1).vertices[0])
    turns = Rotation.from_rotvec(np.outer(2 * np.pi * np.arange(8) / 8, [0.0, 0.0, 1.0]))
    moved = np.stack([start @ R.T for R in turns.as_matrix()])
    mean = mean_shape(mesh_sequence(moved, grid=(12, 24), topology="cup"))
    assert np.allclose(distances(mean), distances(start), rtol=0, atol=1e-5)


def test_nothing_that_moves_has_its_first_frame_as_mean() -> None:
    still = mesh_sequence(np.repeat(beat().vertices[:1], 5, axis=0), grid=(12, 24), topology="cup")
    assert np.array_equal(mean_shape(still), still.vertices[0])
    assert not modal_signature(still, ASKED).amplitudes.any()


def test_a_frame_that_is_there_twice_counts_once() -> None:
    sequence = beat()
    again = np.concatenate([sequence.vertices, sequence.vertices[:1]])
    closed = mesh_sequence(again, grid=(12, 24), topology="cup", unit="mm")
    assert np.array_equal(mean_shape(closed), mean_shape(replace(sequence, times=None)))


@pytest.mark.parametrize("scale", [1e-200, 1e-9, 1e200])
def test_it_scales_with_the_unit(scale: float) -> None:
    sequence = beat()
    scaled = replace(sequence, vertices=scale * sequence.vertices)
    assert np.allclose(mean_shape(scaled) / scale, mean_shape(sequence), rtol=0, atol=1e-9)


def test_curves_and_points_have_one_too() -> None:
    s = np.linspace(0.0, 1.0, 9)
    lift = np.sin(2 * np.pi * np.arange(8) / 8)
    points = np.zeros((8, 9, 3))
    points[:, :, 0], points[:, :, 1] = 60 * s, lift[:, None] * s
    for topology in ("open curve", None):
        curve = mesh_sequence(points, topology=topology)
        assert np.allclose(mean_shape(curve).mean(axis=0), points.mean(axis=(0, 1)), atol=1e-6)
        assert np.allclose(mean_shape(curve), points.mean(axis=0), atol=0.1)


def test_a_signature_from_it_reconstructs_the_sequence_with_less_error() -> None:
    sequence = beat()
    one, zero = modal_signature(sequence, ASKED), modal_signature(sequence)
    apart = np.linalg.norm(reconstruct(one, sequence) - sequence.vertices, axis=2)
    assert np.sqrt((apart**2).mean()) == pytest.approx(one.rms_error, rel=1e-9)
    assert one.rms_error < zero.rms_error
    assert one.template_id != zero.template_id
    assert make_template(sequence, reference=MEAN).id == one.template_id


def test_a_surface_is_what_its_first_frame_is() -> None:
    stated = beat(400)
    unstated = replace(stated, topology=None)
    one, zero = (make_template(unstated, reference=r) for r in (MEAN, 0))
    assert one.surface == zero.surface
    assert one.id != zero.id
    assert np.allclose(one.coordinates, make_template(stated, reference=MEAN).coordinates)


def test_a_reference_that_is_none_is_refused() -> None:
    sequence = beat()
    for reference in (12, -1, "median"):
        with pytest.raises(ParameterError, match="reference"):
            modal_signature(sequence, replace(ASKED, reference=reference, amplitudes=None))  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["fox", "robot"])
def test_windows_of_one_figure_are_all_of_one_topology(name: str) -> None:
    found = figures(name)
    if not found:
        pytest.skip(f"{name}/ is not there: it is measured on, not shipped")
    surfaces = {make_template(window, reference=MEAN).surface for window in found[::3]}
    assert surfaces == {None}
