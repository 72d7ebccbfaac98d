"""The systolic dyssynchrony index."""

from __future__ import annotations

import numpy as np
import pytest

import modalmotion as mm
from modalmotion.clinical.dyssynchrony import dyssynchrony, segment_volumes, volume_variances
from modalmotion.clinical.smooth_wall import smooth_walls
from modalmotion.clinical.wall_motion import WallMotion

PHASES = np.arange(30) / 30


def volumes(times: np.ndarray) -> np.ndarray:
    """Curves that are least at given instants."""
    turns = 2 * np.pi * (PHASES[:, None] - times)
    return np.asarray(10.0 - 3.0 * np.cos(turns) - 0.5 * np.cos(2 * turns))


def test_it_is_the_deviation_of_the_times_between_frames_and_over_the_end_of_the_cycle() -> None:
    rng = np.random.default_rng(0)
    for middle in (0.4, 0.99):
        times = middle + 0.05 * rng.normal(size=16)
        found = dyssynchrony(volumes(times), PHASES, np.zeros((30, 16)))
        assert found is not None
        assert found[0] == pytest.approx(100 * times.std(ddof=1), abs=0.1)


def test_noise_does_not_count_as_dyssynchrony() -> None:
    rng = np.random.default_rng(1)
    times = 0.4 + 0.04 * rng.normal(size=16)
    true = 100 * times.std(ddof=1)
    found = [
        dyssynchrony(
            volumes(times) + 0.3 * rng.normal(size=(30, 16)), PHASES, np.full((30, 16), 0.3**2)
        )
        for _ in range(12)
    ]
    values, low, high = np.array([one for one in found if one is not None]).T
    assert abs(values.mean() - true) < 0.5
    assert ((low <= true) & (true <= high)).mean() > 0.8


def flat(shares: np.ndarray, phases: np.ndarray) -> np.ndarray:
    """Curves that are nearly level when least, with a share of a slope each."""
    level = 10.0 - 3.0 * np.exp(-(((phases - 0.4) / 0.2) ** 4))
    return np.asarray(level[:, None] + shares * np.sin(2 * np.pi * (phases - 0.4))[:, None])


def test_segments_that_are_least_apart_stay_so_where_noise_hides_it() -> None:
    off, inside, instants = [], [], np.arange(1000) / 1000
    for seed in (2, 3, 4):
        rng = np.random.default_rng(seed)
        shares = 0.25 * rng.normal(size=16)
        true = 100 * instants[flat(shares, instants).argmin(axis=0)].std(ddof=1)
        for _ in range(24):
            noisy = flat(shares, PHASES) + 0.3 * rng.normal(size=(30, 16))
            found = dyssynchrony(noisy, PHASES, np.full((30, 16), 0.3**2))
            assert found is not None
            off.append(found[0] - true)
            inside.append(found[1] <= true <= found[2])
    assert abs(np.mean(off)) < 0.7
    # That of the likeliest curves alone, instead of the mean over draws, is 1.4.
    assert np.sqrt(np.mean(np.square(off))) < 1.25
    assert np.mean(inside) > 0.94


def test_what_noise_hides_is_within_the_interval() -> None:
    rng, phases = np.random.default_rng(7), np.arange(12) / 12
    instants, inside, level = np.arange(1000) / 1000, [], 0
    for _ in range(40):
        shares = 0.2 * rng.normal(size=16)
        true = 100 * instants[flat(shares, instants).argmin(axis=0)].std(ddof=1)
        noisy = flat(shares, phases) + 0.6 * rng.normal(size=(12, 16))
        found = dyssynchrony(noisy, phases, np.full((12, 16), 0.6**2))
        assert found is not None
        level += found[0] < 0.5
        inside.append(found[1] <= true <= found[2])
    assert level > 4  # nothing was seen beyond noise
    assert np.mean(inside) > 0.9


def test_volumes_of_segments_are_off_by_what_is_stated() -> None:
    beat = mm.simulate_ventricle(
        grid=(16, 32), acquisition=mm.Acquisition(n_frames=1), rng=np.random.default_rng(5)
    )
    rng = np.random.default_rng(6)
    noise = 0.5 * rng.normal(size=(200, beat.n_vertices, 3))
    # The first frame has no noise, so that places are those of the surface itself.
    positions = beat.vertices.astype(np.float64) + np.concatenate([0 * noise[:1], noise])
    fine, _ = smooth_walls(mm.make_template(beat), is_lattice=True)
    motion = WallMotion.of(positions, None, fine, 0)
    segment = np.arange(motion.places.values.shape[0]) % motion.places.shape[1] // 12
    n = int(segment.max()) + 1
    true = segment_volumes(motion, segment, n)[0][1:].std(axis=0)
    stated = np.sqrt(volume_variances(motion, segment_volumes(motion, segment, n)[1])[1])
    assert np.allclose(stated / true, 1.0, atol=0.25)


def test_few_frames_and_part_of_a_cycle_have_none() -> None:
    assert dyssynchrony(volumes(np.zeros(16))[:7], PHASES[:7], np.zeros((7, 16))) is None
    assert dyssynchrony(volumes(np.zeros(16)), PHASES / 3, np.zeros((30, 16))) is None


def test_segments_that_are_least_at_once_are_so_under_noise() -> None:
    rng = np.random.default_rng(2)
    noisy = [volumes(np.full(16, 0.4)) + 0.3 * rng.normal(size=(30, 16)) for _ in range(12)]
    found = [dyssynchrony(one, PHASES, np.full((30, 16), 0.3**2)) for one in noisy]
    raw = np.mean([100 * PHASES[one.argmin(axis=0)].std(ddof=1) for one in noisy])
    assert np.mean([one[0] for one in found if one is not None]) < 0.5 * raw
    assert np.mean([one is not None and one[1] == 0.0 for one in found]) > 0.9


def test_errors_of_a_track_widen_the_interval_and_take_nothing_away() -> None:
    rng = np.random.default_rng(3)
    smooth = volumes(0.4 + 0.03 * rng.normal(size=16))
    exact = dyssynchrony(smooth, PHASES, np.zeros((30, 16)))
    found = dyssynchrony(smooth, PHASES, np.full((30, 16), 0.5**2), is_smooth=True)
    assert exact is not None
    assert found is not None
    assert found[0] == exact[0]
    assert found[2] - found[1] > 2.0 * (exact[2] - exact[1])
    together = volumes(np.full(16, 0.4))
    found = dyssynchrony(together, PHASES, np.full((30, 16), 0.5**2), is_smooth=True)
    assert found is not None
    # Errors of this size may hide so much.
    assert found[:2] == (0.0, 0.0)
    assert found[2] > 3.0
