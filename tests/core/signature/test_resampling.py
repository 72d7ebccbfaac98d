"""A sequence at any phase of its cycle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from modalmotion.errors import ParameterError, ShapeError
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.signature.reconstruction import resample
from modalmotion.simulate import Acquisition, simulate_ventricle


def beat(n_frames: int, noise: float = 0.0, seed: int = 0) -> MeshSequence:
    return simulate_ventricle(
        grid=(12, 24),
        acquisition=Acquisition(n_frames=n_frames, noise=noise),
        rng=np.random.default_rng(seed),
    )


def halves(sequence: MeshSequence) -> tuple[MeshSequence, np.ndarray]:
    """Every second frame, and those between."""
    x = sequence.vertices.astype(np.float64)
    assert sequence.times is not None
    return replace(sequence, vertices=x[::2], times=sequence.times[::2]), x[1::2]


def test_frames_are_what_they_were_and_cost_nothing() -> None:
    sequence = beat(20, 0.5)
    found = resample(sequence, 20)
    np.testing.assert_allclose(found.sequence.vertices, sequence.vertices, atol=1e-5)
    assert found.rms_deviations.max() < 1e-3
    assert found.sequence.times == pytest.approx(sequence.times)


def test_at_frames_the_surface_is_theirs_to_the_last_bit() -> None:
    sequence = replace(beat(8, 0.5), times=None)
    np.testing.assert_array_equal(resample(sequence, 8).sequence.vertices, sequence.vertices)


def test_without_times_frames_are_even_steps_whatever_period_is_stated() -> None:
    sequence = beat(20)
    assert sequence.facts.period is not None
    bare = resample(replace(sequence, times=None), [0.37]).sequence.vertices
    assert bare == pytest.approx(resample(sequence, [0.37]).sequence.vertices, abs=1e-6)


def test_a_smooth_beat_is_foreseen_far_better_than_along_straight_lines() -> None:
    known, between = halves(beat(40))
    found = resample(known, (np.arange(20) + 0.5) / 20)
    straight = (known.vertices + np.roll(known.vertices, -1, axis=0)) / 2.0
    off = np.sqrt(np.mean((found.sequence.vertices - between) ** 2))
    assert found.interpolation == "cubic"
    assert off < 0.5 * np.sqrt(np.mean((straight - between) ** 2))


@pytest.mark.parametrize("noise", [0.3, 1.0])
def test_intervals_hold_frames_that_were_held_out(noise: float) -> None:
    inside = []
    for seed in range(4):
        known, between = halves(beat(30, noise, seed))
        found = resample(known, (np.arange(15) + 0.5) / 15)
        errors = np.abs(found.sequence.vertices - between)
        inside.append(np.mean(errors <= 2.0 * found.deviations[:, :, None]))
    assert 0.9 < np.mean(inside) < 0.985


def test_what_is_no_phase_is_refused() -> None:
    for phases in ([1.5], [np.nan], [0.3, 0.2], [], -3):
        with pytest.raises(ParameterError):
            resample(beat(12), phases)
    with pytest.raises(ShapeError, match="more frames"):
        resample(beat(4), 0.5)
