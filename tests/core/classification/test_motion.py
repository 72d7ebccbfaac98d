"""What features are read from: in the frame of the body, whatever pose, start and hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import modalmotion as mm
from modalmotion.classification.motion import Motion
from modalmotion.mesh.sequence import MEAN, MeshSequence

ASKED = mm.SignatureParameters(modes=18, reference=MEAN, volumes=True)
PARAMETERS = mm.VentricleParameters(shape_variation=1.0, motion_variation=1.0)


def beat(**more: object) -> MeshSequence:
    taken = mm.Acquisition(n_frames=20, **more)  # type: ignore[arg-type]
    rng = np.random.default_rng(3)
    return mm.simulate_ventricle(PARAMETERS, grid=(12, 24), acquisition=taken, rng=rng)


def motion_of(sequence: MeshSequence) -> Motion:
    return Motion(mm.modal_signature(sequence, ASKED))


def test_pose_and_unit_change_nothing() -> None:
    one, turn = beat(), np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    other = replace(one, vertices=(one.vertices @ turn.T + 50.0) / 1000.0, unit="m")
    a, b = motion_of(one), motion_of(other)
    for name in ("harmonics", "cosines", "shape"):
        scale = 1000.0 if name == "shape" else 1.0
        assert getattr(b, name) * scale == pytest.approx(getattr(a, name), abs=1e-8)
    assert b.log_size == pytest.approx(a.log_size)
    assert b.amount == pytest.approx(a.amount)


def test_a_radius_is_along_the_first_axis_where_theta_is_zero() -> None:
    motion = motion_of(beat())
    labels = [str(label) for label in motion.modes.labels]
    cosine, sine = (motion.shape[labels.index(f"(0, 1, {part})")] for part in ("cos", "sin"))
    size = float(np.linalg.norm(cosine))
    assert cosine[0] > 0.99 * size
    assert sine[1] > 0.99 * np.linalg.norm(sine)


def test_left_handed_coordinates_are_read_as_their_mirror_image() -> None:
    one = beat()
    flipped = one.vertices * np.array([-1.0, 1.0, 1.0])
    other = replace(one, vertices=flipped, facts=replace(one.facts, handedness="left"))
    a, b = motion_of(one), motion_of(other)
    assert b.harmonics == pytest.approx(a.harmonics, abs=1e-8)


def test_a_last_frame_that_repeats_the_first_is_of_the_next_turn() -> None:
    open_, closed = motion_of(beat()), motion_of(beat(is_closed=True))
    assert len(open_.cycle[0]) == 20
    assert len(closed.cycle[0]) == 19


def test_phases_follow_from_the_period_where_most_of_it_was_recorded() -> None:
    one = beat()
    most = replace(one, vertices=one.vertices[:16], times=np.asarray(one.times)[:16])
    half = replace(one, vertices=one.vertices[:10], times=np.asarray(one.times)[:10])
    assert motion_of(most).cycle[1][-1] == pytest.approx(2 * np.pi * 15 / 20)
    assert motion_of(half).cycle[1][-1] == pytest.approx(2 * np.pi * 9 / 10)


def test_noise_is_not_smooth_and_a_beat_is() -> None:
    rng, one = np.random.default_rng(1), beat()
    shape = one.vertices.mean(axis=0)
    noise = replace(one, vertices=shape + rng.normal(0.0, 2.0, one.vertices.shape))
    assert motion_of(one).smooth_share(True) > 0.95
    assert motion_of(noise).smooth_share(True) < 0.4
    assert motion_of(noise).smooth_share(False) < 0.4


def test_only_a_cavity_has_a_volume() -> None:
    one = beat()
    assert motion_of(one).volumes is not None
    none = replace(one, facts=replace(one.facts, cavity="none"))
    assert motion_of(none).volumes is None
    plain = mm.modal_signature(one, replace(ASKED, volumes=False))
    assert Motion(plain).volumes is None


def test_harmonics_of_a_known_motion_are_found() -> None:
    signature = mm.modal_signature(beat(), ASKED)
    phase = 2 * np.pi * np.arange(20) / 20
    amplitudes = np.zeros_like(signature.amplitudes)
    amplitudes[:, 3, 0] = 1.0 + 2.0 * np.cos(phase) + 3.0 * np.sin(2 * phase)
    known = Motion(replace(signature, amplitudes=amplitudes, times=None, landmarks=None))
    found = np.linalg.norm(known.harmonics[:, 3], axis=1) * known.size / 100.0
    assert found == pytest.approx([2.0, 3.0])
