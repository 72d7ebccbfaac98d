"""Features say how a surface moves, and nothing of how it was recorded."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation
from slow_features import slow_axis_features

from modalmotion.classification.features import READINGS, AxisReading, MotionFeatures, axis_features
from modalmotion.classification.features.temporal import one_turn
from modalmotion.errors import ModeCountError, ParameterError, ShapeError, TopologyError
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.modes import ModeSet
from modalmotion.modes.topology import CYLINDER, PLANE
from modalmotion.signature.making import ModalSignature, SignatureParameters, modal_signature
from modalmotion.simulate import Acquisition, VentricleParameters, simulate_ventricle
from modalmotion.template.body_frame import Components

INDIVIDUAL = VentricleParameters(
    motion_variation=2.0, delay=0.05, akinesia=0.5, ejection_fraction=0.5
)


def motion_features(
    signature: ModalSignature, reading: AxisReading = READINGS[0], *, walls: bool = False
) -> MotionFeatures:
    """Features in one reading, (features,)."""
    found = axis_features(signature, walls=walls)
    return replace(found, values=found.values[READINGS.index(reading)])


def ventricle(parameters: VentricleParameters = INDIVIDUAL, **options: int) -> MeshSequence:
    return simulate_ventricle(
        parameters,
        grid=(16, 32),
        acquisition=Acquisition(n_frames=options.get("n_frames", 20)),
        rng=np.random.default_rng(8),
    )


@pytest.fixture(scope="module")
def signature() -> ModalSignature:
    return modal_signature(ventricle())


def with_amplitudes(
    signature: ModalSignature,
    amplitudes: NDArray[np.float64],
    times: ArrayLike | None = None,
) -> ModalSignature:
    stamps = None if times is None else np.asarray(times, dtype=np.float64)
    facts = replace(signature.facts, period=None)
    return replace(signature, amplitudes=amplitudes, times=stamps, facts=facts)


def assert_same(a: MotionFeatures, b: MotionFeatures, atol: float = 1e-9) -> None:
    assert a.names == b.names
    # Parts without a sign are square roots: twice the digits are lost where they vanish.
    assert np.allclose(a.values, b.values, rtol=0, atol=atol)
    assert a.motion == pytest.approx(b.motion, rel=max(1e-6, atol))
    assert a.smooth_share == pytest.approx(b.smooth_share, abs=max(1e-6, atol))


def test_every_column_has_a_name(signature: ModalSignature) -> None:
    features = motion_features(signature)
    assert len(features.names) == len(set(features.names)) == len(features.values) == 35
    assert {name.rsplit(" ", 3)[0] for name in features.names} == {
        "radial",
        "turning",
        "axial",
        "across",
        "oval",
        "tilt",
    }
    assert "radial 0 sin 1" not in features.names


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    start=st.floats(0.0, 1.0),
    vector=st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3),
    shift=st.integers(0, 19),
    scale=st.floats(1e-3, 1e3),
)
def test_pose_start_angle_start_phase_and_unit_change_nothing(
    signature: ModalSignature,
    seed: int,
    start: float,
    vector: list[float],
    shift: int,
    scale: float,
) -> None:
    noise = np.random.default_rng(seed).normal(0.0, 0.3, signature.amplitudes.shape)
    before = with_amplitudes(signature, signature.amplitudes + noise)
    after = before.amplitudes.copy()
    modes = signature.modes
    assert isinstance(modes, ModeSet)
    # A start angle turns each pair (p, p') by p' times it.
    for i, (p, turns) in enumerate(modes.wavenumbers):
        if modes.is_sine[i]:
            j = next(
                j
                for j, other in enumerate(modes.wavenumbers)
                if tuple(other) == (p, turns) and not modes.is_sine[j]
            )
            angle = 2 * np.pi * start * turns
            c, s = before.amplitudes[:, j], before.amplitudes[:, i]
            after[:, j] = np.cos(angle) * c - np.sin(angle) * s
            after[:, i] = np.sin(angle) * c + np.cos(angle) * s
    after = after @ Rotation.from_rotvec(vector).as_matrix().T
    # Another reference frame adds a constant; another first frame turns the phase.
    after = scale * (np.roll(after, shift, axis=0) + np.array([1.0, -2.0, 3.0]))
    turned = replace(
        before,
        amplitudes=after,
        lengths=tuple(scale * length for length in before.lengths),
    )
    assert_same(motion_features(before), motion_features(turned), atol=1e-6)


def test_moving_the_mesh_itself_changes_nothing(signature: ModalSignature) -> None:
    sequence = ventricle()
    turn = Rotation.from_rotvec([0.3, -1.2, 2.0]).as_matrix()
    moved = (sequence.vertices @ turn.T + [100.0, 20.0, -7.0]).reshape(20, 16, 32, 3)
    moved = np.roll(moved, 5, axis=2).reshape(20, -1, 3)
    other = mesh_sequence(
        moved, grid=(16, 32), topology="cup", times=np.array(sequence.times) + 9.0, unit="mm"
    )
    assert_same(motion_features(signature), motion_features(modal_signature(other)), atol=1e-6)


def test_columns_that_run_the_other_way_are_the_mirrored_reading() -> None:
    sequence = ventricle()
    backwards = sequence.vertices.reshape(20, 16, 32, 3)[:, :, ::-1].reshape(20, -1, 3)
    other = mesh_sequence(backwards, grid=(16, 32), topology="cup", times=sequence.times, unit="mm")
    a, b = modal_signature(sequence), modal_signature(other)
    for inverted in (False, True):
        assert_same(
            motion_features(a, AxisReading(False, inverted)),
            motion_features(b, AxisReading(True, inverted)),
            # Quads of the mean of all frames are bent, and halved along the other diagonal.
            atol=5e-3,
        )
    assert not np.allclose(motion_features(a).values, motion_features(b).values, atol=0.1)


def test_readings_are_four_and_differ(signature: ModalSignature) -> None:
    values = [motion_features(signature, reading).values for reading in READINGS]
    assert len(READINGS) == 4
    for i in range(4):
        for j in range(i):
            assert np.abs(values[i] - values[j]).max() > 0.1


@pytest.mark.every(5)
@pytest.mark.parametrize("walls", [False, True])
@pytest.mark.parametrize(("n_signed", "n_sized"), [(1, 1), (2, 1), (2, 3)])
@pytest.mark.parametrize("n_modes", [7, 18])
@pytest.mark.parametrize("timing", ["even", "uneven", "short"])
def test_each_reading_is_what_its_definition_says(
    n_modes: int, n_signed: int, n_sized: int, walls: bool, timing: str, rng: np.random.Generator
) -> None:
    beat = modal_signature(ventricle(), SignatureParameters(modes=n_modes))
    if timing == "uneven":
        beat = replace(beat, times=np.cumsum(rng.uniform(0.2, 2.0, beat.n_frames)))
    if timing == "short":
        beat = replace(beat, amplitudes=beat.amplitudes[:4], times=None)
    found = axis_features(beat, n_signed, n_sized, walls=walls)
    for reading, values in zip(READINGS, found.values, strict=True):
        slow = slow_axis_features(beat, reading, n_signed, n_sized, walls=walls)
        assert set(found.names) == set(slow)
        expected = [slow[name] for name in found.names]
        np.testing.assert_allclose(values, expected, rtol=1e-9, atol=1e-9)


def test_the_smooth_share_is_what_least_squares_leave(
    signature: ModalSignature, rng: np.random.Generator
) -> None:
    amplitudes = signature.amplitudes + rng.normal(size=signature.amplitudes.shape)
    noisy = replace(signature, amplitudes=amplitudes, times=None)
    n = noisy.n_frames
    moving = amplitudes[:, 1:].reshape(n, -1) - amplitudes[:, 1:].reshape(n, -1).mean(axis=0)
    angle = 2 * np.pi * np.arange(n) / n
    waves = [np.ones(n)] + [f(h * angle) for h in (1, 2, 3) for f in (np.cos, np.sin)]
    design = np.stack(waves, axis=1)
    rest = moving - design @ np.linalg.lstsq(design, moving)[0]
    # Of white noise n - 7 of n - 1 parts would remain.
    left = (rest**2).sum() / (n - 7) * (n - 1) / (moving**2).sum()
    assert 0.1 < left < 0.9
    assert axis_features(noisy).smooth_share == pytest.approx(1 - left, abs=1e-12)


def synthetic(
    signature: ModalSignature,
    radial: NDArray[np.float64],
    turning: NDArray[np.float64],
    axial: NDArray[np.float64],
) -> ModalSignature:
    """A motion made of known parts: (0, 1) radial, (1, 1) turning, (1, 0) axial."""
    e = np.eye(3)
    amplitudes = np.zeros((len(radial), 7, 3))
    index = {label: i for i, label in enumerate(map(str, signature.modes.labels))}
    amplitudes[:, index["(0, 1, cos)"]] = radial[:, None] * e[0]
    amplitudes[:, index["(0, 1, sin)"]] = radial[:, None] * e[1]
    # Along the tangent -sin e1 + cos e2.
    amplitudes[:, index["(1, 1, cos)"]] = turning[:, None] * e[1]
    amplitudes[:, index["(1, 1, sin)"]] = -turning[:, None] * e[0]
    amplitudes[:, index["(1, 0, cos)"]] = axial[:, None] * e[2]
    return with_amplitudes(signature, amplitudes, np.arange(len(radial)) * 0.05)


def test_known_parts_are_read_as_what_they_are(signature: ModalSignature) -> None:
    phase = 2 * np.pi * np.arange(16) / 16
    # Inward and shortening at phase 1.1, the twist a little later.
    made = synthetic(
        signature, -3.0 * np.cos(phase - 1.1), 2.0 * np.cos(phase - 1.5), np.cos(phase - 1.1)
    )
    read = dict(zip(motion_features(made).names, motion_features(made).values, strict=True))
    unit = 100.0 / np.sqrt(signature.lengths[0] * signature.lengths[1])
    assert read.pop("radial 0 cos 1") == pytest.approx(-3.0 * unit)
    assert read.pop("turning 1 cos 1") == pytest.approx(2.0 * np.cos(0.4) * unit)
    assert read.pop("turning 1 sin 1") == pytest.approx(2.0 * np.sin(0.4) * unit)
    assert read.pop("axial 1 cos 1") == pytest.approx(1.0 * unit)
    assert np.abs(list(read.values())).max() <= 1e-6


def test_turning_grows_with_the_twist_and_keeps_its_sign() -> None:
    found = []
    for twist in (-8.0, 0.0, 8.0, 16.0):
        p = VentricleParameters(apex_rotation=twist * 0.7, base_rotation=-twist * 0.3)
        features = motion_features(modal_signature(ventricle(p)))
        found.append(features.values[features.names.index("turning 1 cos 1")])
    assert np.allclose(np.diff(found), np.diff(found)[0], rtol=0.1)
    assert abs(found[1]) < 0.05 * abs(found[3])


def test_uneven_times_are_fitted_as_they_are(signature: ModalSignature) -> None:
    rng = np.random.default_rng(4)
    times = np.sort(rng.uniform(0.0, 0.95, 14))
    times[[0, -1]] = 0.0, 1.0 - 1.0 / 14  # one beat of 1 s
    phase = 2 * np.pi * times
    made = synthetic(
        signature,
        -3.0 * np.cos(phase) + 0.5 * np.cos(2 * phase),
        np.zeros(14),
        np.cos(phase) + 0.2,
    )
    made = replace(made, times=times)
    read = dict(zip(motion_features(made).names, motion_features(made).values, strict=True))
    unit = 100.0 / np.sqrt(signature.lengths[0] * signature.lengths[1])
    assert read["radial 0 cos 1"] == pytest.approx(-3.0 * unit)
    assert read["radial 0 cos 2"] == pytest.approx(0.5 * unit)
    assert read["radial 0 sin 2"] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("n_frames", [2, 3, 4, 5])
def test_few_frames_give_finite_features(signature: ModalSignature, n_frames: int) -> None:
    few = with_amplitudes(
        signature, signature.amplitudes[:: 20 // n_frames][:n_frames], np.arange(float(n_frames))
    )
    features = motion_features(few)
    assert np.isfinite(features.values).all()
    assert features.values[0] < 0
    assert features.smooth_share == 1.0
    # The second harmonic needs five frames.
    second = [v for n, v in zip(features.names, features.values, strict=True) if n[-1] == "2"]
    assert (np.abs(second).max() > 0) == (n_frames == 5)


def test_a_last_frame_that_repeats_the_first_is_left_out_unless_it_rests(
    signature: ModalSignature,
) -> None:
    a = signature.amplitudes
    closed = with_amplitudes(signature, np.concatenate([a, a[:1]]))
    assert_same(motion_features(with_amplitudes(signature, a)), motion_features(closed))
    # In a rest at the start and at the end nobody can tell which turn the last frame is of.
    resting = np.concatenate([a[:1], a, a[:1], a[:1]])
    assert one_turn(with_amplitudes(signature, resting)).n_frames == len(resting)
    noise = np.random.default_rng(3).normal(0.0, 0.05, a[:1].shape)
    nearly = with_amplitudes(signature, np.concatenate([a, a[:1] + noise]))
    assert one_turn(nearly).n_frames == len(a) + 1


def test_without_times_the_frames_are_evenly_spaced(signature: ModalSignature) -> None:
    assert_same(motion_features(signature), motion_features(replace(signature, times=None)))


def test_noise_is_told_from_motion(signature: ModalSignature, rng: np.random.Generator) -> None:
    assert motion_features(signature).smooth_share > 0.95
    shares = [
        motion_features(
            with_amplitudes(signature, rng.standard_normal(signature.amplitudes.shape))
        ).smooth_share
        for _ in range(40)
    ]
    assert np.mean(shares) < 0.1
    assert np.quantile(shares, 0.9) < 0.25


def test_motion_is_measured_against_the_size(signature: ModalSignature) -> None:
    deviations = signature.amplitudes[:, 1:] - signature.amplitudes[:, 1:].mean(axis=0)
    size = np.sqrt(signature.lengths[0] * signature.lengths[1])
    expected = np.sqrt((deviations**2).sum(axis=(1, 2)).mean()) / size
    assert motion_features(signature).motion == pytest.approx(expected)
    still = with_amplitudes(signature, np.zeros_like(signature.amplitudes))
    assert motion_features(still).motion == 0.0
    assert not motion_features(still).values.any()


@pytest.mark.parametrize("power", [-200, 200])
def test_extreme_units_neither_overflow_nor_vanish(signature: ModalSignature, power: int) -> None:
    scale = 10.0**power
    scaled = replace(
        signature,
        amplitudes=signature.amplitudes * scale,
        lengths=tuple(length * scale for length in signature.lengths),
    )
    assert_same(motion_features(signature), motion_features(scaled), atol=1e-6)


def test_what_has_no_motion_to_read_is_refused(signature: ModalSignature) -> None:
    with pytest.raises(ShapeError):
        motion_features(with_amplitudes(signature, signature.amplitudes[:1], np.zeros(1)))
    sequence = ventricle()
    flat = modal_signature(replace(sequence, topology=PLANE))
    with pytest.raises(TopologyError):
        motion_features(flat)
    with pytest.raises(TopologyError, match="lengths"):
        motion_features(replace(signature, lengths=(0.0, 1.0)))
    with pytest.raises(ModeCountError):
        motion_features(modal_signature(sequence, SignatureParameters(modes=2)))
    with pytest.raises(TopologyError, match="spring modes"):
        motion_features(modal_signature(sequence, SignatureParameters(closed_form=False)))
    cylindrical = SignatureParameters(components=Components.CYLINDRICAL)
    with pytest.raises(ParameterError, match="Cartesian"):
        motion_features(modal_signature(sequence, cylindrical))
    assert motion_features(modal_signature(replace(sequence, topology=CYLINDER))).motion > 0


def test_with_a_zero_of_theta_walls_are_told_apart(signature: ModalSignature) -> None:
    # The same motion with its territory on the other side: only the zero of theta can tell.
    landmarks = signature.landmarks
    assert landmarks is not None
    other = replace(signature, landmarks=replace(landmarks, theta_zero=-landmarks.theta_zero))
    assert_same(motion_features(signature), motion_features(other))
    here, there = (motion_features(case, walls=True) for case in (signature, other))
    assert len(here.names) == len(set(here.names))
    sided = np.array(["zero" in name for name in here.names])
    across = np.array([name.startswith("across") for name in here.names])
    assert np.allclose(here.values[~sided], there.values[~sided])
    assert np.allclose(here.values[across], -there.values[across])
    assert np.abs(here.values[across]).max() > 0.1


def test_more_modes_add_columns_and_change_none(signature: ModalSignature) -> None:
    more = modal_signature(ventricle(), SignatureParameters(modes=18))
    few = motion_features(signature)
    many = motion_features(more)
    assert set(few.names) < set(many.names)
    assert any(name.startswith("side (0, 2)") for name in many.names)
