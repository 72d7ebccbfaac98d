"""Data over a surface as the viewer reads them, also far from the origin."""

from __future__ import annotations

import numpy as np
import pytest

from modalmotion.tracking.result import SampledData
from modalmotion.viewer.container import read_container
from modalmotion.viewer.data_payload import data_payload


@pytest.mark.parametrize("far", [0.0, 1e7])
def test_points_keep_their_places_and_what_they_are(rng: np.random.Generator, far: float) -> None:
    points = far + rng.normal(0.0, 40.0, (6, 3))
    weights = np.array([0.0, 0.05, 0.5, 1.0, 1.0, 1.0])
    marks = np.arange(6) == 5
    data = SampledData(points, weights, marks, np.array([4, 0, 2]))
    header, arrays = read_container(data_payload(data))
    assert header["counts"] == [4, 0, 2]
    back = arrays["points"] + np.array(header["origin"])
    assert np.abs(back - points).max() < 2e-5
    assert arrays["weights"].tolist() == [0, 13, 128, 255, 255, 255]
    assert arrays["landmarks"].tolist() == [0, 0, 0, 0, 0, 1]


@pytest.mark.parametrize("size", [1e-200, 1e-12, 1e12, 1e60])
def test_extreme_lengths_are_sent_in_another_unit(rng: np.random.Generator, size: float) -> None:
    points = size * rng.normal(size=(9, 3))
    data = SampledData(points, np.ones(9), np.zeros(9, dtype=bool), np.array([9]))
    header, arrays = read_container(data_payload(data))
    back = arrays["points"].astype(np.float64) * header["length"] + np.array(header["origin"])
    assert np.abs(back - points).max() < 1e-6 * size


def test_no_points_are_no_error() -> None:
    nothing = np.zeros(0)
    data = SampledData(np.zeros((0, 3)), nothing, nothing.astype(bool), np.zeros(2, dtype=np.int64))
    header, arrays = read_container(data_payload(data))
    assert (header["origin"], arrays["points"].shape) == ([0.0, 0.0, 0.0], (0, 3))
