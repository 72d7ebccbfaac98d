"""Landmarks as JSON and as facts: places, one or one for each frame."""

from __future__ import annotations

import time

import numpy as np
import pytest

from modalmotion.errors import ParameterError
from modalmotion.mesh import Facts
from modalmotion.tracking.landmarks import (
    landmarks_from_json,
    landmarks_of,
    places_of,
    with_landmarks,
)
from modalmotion.tracking.observation import Observation


def test_a_landmark_is_a_place_or_one_for_each_frame() -> None:
    found = landmarks_from_json('{"apex": [0, 1, 2.5], "base": [[1, 2, 3], null, [4, 5, 6]]}')
    assert found["apex"].tolist() == [0.0, 1.0, 2.5]
    assert found["base"][[0, 2]].tolist() == [[1, 2, 3], [4, 5, 6]]
    assert np.isnan(found["base"][1]).all()


@pytest.mark.parametrize(
    "text",
    [
        '{"apex": [1, 2]}',
        '{"apex": []}',
        '{"apex": 7}',
        '{"apex": [1, 2, "3"]}',
        '{"apex": [[1, 2, 3], [1, 2]]}',
        '{"apex": [5, [1, 2, 3]]}',
        '{"apex": [null, true]}',
        '{"apex": [1, 2, 1e400]}',
        '{"apex": [true, 2, 3]}',
        '{"apex": [1' + "0" * 400 + ", 2, 3]}",
        "[1, 2, 3]",
        "{",
        '{"apex": [NaN, 0, 0]}',
    ],
)
def test_what_is_no_place_is_named(text: str) -> None:
    with pytest.raises(ParameterError, match="landmark") as caught:
        landmarks_from_json(text)
    assert caught.value.remedy


def test_the_frame_of_a_wrong_place_is_named() -> None:
    with pytest.raises(ParameterError, match="in frame 1") as caught:
        landmarks_from_json('{"apex": [[1, 2, 3], [1, 2]]}')
    assert caught.value.frame == 1


def test_an_array_without_axes_is_no_place() -> None:
    with pytest.raises(ParameterError, match="not three finite numbers"):
        places_of("apex", np.array(3.0))


def test_facts_state_points_and_no_vertices() -> None:
    found = landmarks_of(Facts(landmarks={"apex": (0.0, 1.0, 2.0)}))
    assert found["apex"].tolist() == [0, 1, 2]
    with pytest.raises(ParameterError, match="has no fixed vertices"):
        landmarks_of(Facts(landmarks={"apex": 7}))


def test_landmarks_of_many_frames_look_at_the_points_once() -> None:
    frames = tuple((Observation(np.full((20_000, 3), float(k))),) for k in range(60))
    began = time.process_time()
    found = with_landmarks(frames, {"apex": np.zeros((60, 3))}, 0)
    # For each landmark anew it took 3 s.
    assert time.process_time() - began < 1.0
    assert all(len(frame) == 2 for frame in found)
