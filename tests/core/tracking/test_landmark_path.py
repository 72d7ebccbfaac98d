"""Landmarks between the frames that they are known in."""

from __future__ import annotations

import numpy as np
import pytest

from modalmotion.tracking.landmarks import path_between

NOWHERE = np.full(3, np.nan)
ROWS = np.stack([np.zeros(3), NOWHERE, np.array([0.0, 0.0, 8.0]), NOWHERE, NOWHERE, NOWHERE])


def test_a_valve_goes_from_place_to_place_and_is_least_sure_half_way() -> None:
    marks = path_between({"base": ROWS}, 6, is_closed=True)
    assert [len(frame) for frame in marks] == [0, 1, 0, 1, 1, 1]
    heights = [frame[0].points[0, 2] for frame in marks if frame]
    assert heights == pytest.approx([4.0, 6.0, 4.0, 2.0])
    sds = [float(np.ravel(frame[0].sd)[0]) for frame in marks if frame and frame[0].sd is not None]
    assert sds[0] == pytest.approx(0.3 * 8.0, abs=0.01)
    assert sds[1] == pytest.approx(sds[3])
    assert sds[2] > sds[1]


def test_an_open_recording_has_no_way_back_and_one_place_no_path() -> None:
    marks = path_between({"base": ROWS}, 6, is_closed=False)
    assert [len(frame) for frame in marks] == [0, 1, 0, 0, 0, 0]
    one = np.stack([np.zeros(3), *[NOWHERE] * 5])
    assert not any(path_between({"base": one, "apex": np.zeros(3)}, 6, is_closed=True))
    assert not any(path_between(None, 6, is_closed=True))
