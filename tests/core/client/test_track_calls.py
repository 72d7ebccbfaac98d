"""What a track's request says; docs/client.md runs the calls themselves."""

from __future__ import annotations

import io
import json

import numpy as np
import pytest

from modalmotion.client.connection import query_of
from modalmotion.client.recordings import track_call
from modalmotion.client.values import Info
from modalmotion.errors import ShapeError
from modalmotion.tracking.landmarks import landmarks_from_json
from modalmotion.tracking.reading import read_observed


def test_clouds_and_missing_frames_are_read_as_they_were_sent() -> None:
    clouds = [np.arange(12.0).reshape(4, 3), None, np.ones((2, 3), dtype=np.float32)]
    call = track_call(clouds, {"modes": 9})
    assert call.body is not None
    assert call.is_keyed
    frames = read_observed(b"".join(call.body.sent(None))).frames
    assert [len(frame[0]) for frame in frames] == [4, 0, 2]
    assert np.array_equal(frames[0][0].points, clouds[0])  # type: ignore[arg-type]
    buffer = io.BytesIO()
    np.savez(buffer, points=np.ones((3, 3)), offsets=[0, 3])
    body = track_call(buffer.getvalue(), {}).body
    assert body is not None
    assert b"".join(body.sent(None)) == buffer.getvalue()


def test_landmarks_are_read_as_they_were_stated() -> None:
    known = np.array([[0.0, 1, 2], [np.nan, 0, 0]])
    stated = {"landmarks": {"apex": (1, 2, 3), "base": known}}
    query = query_of(track_call([], stated).query or {})
    assert json.loads(query["landmarks"])["base"][1] is None
    found = landmarks_from_json(query["landmarks"])
    assert found["apex"].tolist() == [1, 2, 3]
    assert found["base"][0].tolist() == [0, 1, 2]
    assert np.isnan(found["base"][1]).all()


def test_what_are_no_points_is_said_before_anything_is_sent() -> None:
    with pytest.raises(ShapeError, match="Frame 1 has the shape") as caught:
        track_call([np.ones((4, 3)), np.ones((4, 2))], {})
    assert caught.value.frame == 1


def test_images_that_were_sent_before_are_named_and_not_sent_again() -> None:
    call = track_call(Info({"id": "ab"}), {"landmarks": {"apex": (1, 2, 3)}, "keep": True})
    query = query_of(call.query or {})
    assert (query["images"], query["keep"], call.body, call.is_keyed) == ("ab", "true", None, True)
