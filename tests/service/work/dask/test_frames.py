"""Frames between the service and its bridge: they come in any pieces, and nothing else is taken."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from modalmotion_service.work.dask.frames import Frame, Frames, Kind

MANY = [Frame(kind, number, b"x" * number) for number, kind in enumerate(Kind)]


@given(st.lists(st.integers(1, 9), min_size=1))
def test_frames_come_out_as_they_went_in_whatever_the_pieces(sizes: list[int]) -> None:
    data = b"".join(frame.to_bytes() for frame in MANY)
    frames = Frames(100)
    come: list[Frame] = []
    while data:
        for size in sizes:
            come += frames.add(data[:size])
            data = data[size:]
    assert come == MANY


@pytest.mark.parametrize(
    "data",
    [
        b"?" + MANY[0].to_bytes()[1:],
        # A body that would fill the memory is refused before it comes.
        Frame(Kind.ANSWER, 1, b"x" * 101).to_bytes()[:17],
    ],
)
def test_what_is_no_frame_is_refused(data: bytes) -> None:
    with pytest.raises(ValueError, match=r"\w"):
        list(Frames(100).add(data))
