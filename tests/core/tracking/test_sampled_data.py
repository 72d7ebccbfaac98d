"""A sample of the data that a track keeps: spread, with strays and landmarks named."""

from __future__ import annotations

import numpy as np
from clouds import breathing_spheroid, sampled
from numpy.typing import NDArray

from modalmotion.tracking import Observation, track
from modalmotion.tracking.normal_equations import NormalEquations
from modalmotion.tracking.result import STRAY, sample_of


def informed(n: int) -> NormalEquations:
    points: NDArray[np.float64] = np.arange(3 * n, dtype=np.float64).reshape(n, 3)
    none = np.zeros((n, 3), dtype=np.int64)
    return NormalEquations(
        np.eye(3), np.zeros(3), points, points, np.linspace(0, 1, n), none, np.eye(3)
    )


def test_every_frame_has_its_own_rows_with_landmarks_last() -> None:
    places = np.array([[7.0, 8.0, 9.0], [1.0, 2.0, 3.0]])
    landmark = Observation(places, places=("apex", "base"))
    data = sample_of([(), (landmark,), ()], [informed(3), informed(0), informed(2000)])
    assert data.counts.tolist() == [3, 2, 500]
    assert data.n_points == 505
    assert np.array_equal(data.points[data.of_frame(0)], informed(3).points)
    assert np.array_equal(data.points[data.of_frame(1)], places)
    assert np.flatnonzero(data.are_landmarks).tolist() == [3, 4]
    # Of many points some from everywhere, with their own weights.
    rows = (data.points[data.of_frame(2), 0] / 3).astype(int)
    assert np.diff(rows).max() <= 10
    assert np.array_equal(data.weights[data.of_frame(2)], np.linspace(0, 1, 2000)[rows])


def test_a_long_recording_keeps_few_points_a_frame() -> None:
    n = 20_000
    data = sample_of([()] * n, [informed(60)] * n)
    assert set(data.counts.tolist()) == {10}


def test_strays_hardly_counted() -> None:
    beat, rng = breathing_spheroid(3), np.random.default_rng(1)
    clouds = [sampled(x, beat.faces, 200, rng, 0.2) for x in beat.vertices]
    for cloud in clouds:
        cloud[:20] *= 1.6
    result = track(clouds, modes=7, unit="mm")
    assert result.data is not None
    assert result.data.counts.tolist() == [200] * 3
    for k in range(3):
        weights = result.data.weights[result.data.of_frame(k)]
        assert (weights[:20] < STRAY).mean() > 0.8
        assert (weights[20:] < STRAY).mean() < 0.1
