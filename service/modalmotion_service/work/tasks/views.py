"""What a page is sent of a kept signature, and the page itself."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final

from modalmotion.errors import LimitError
from modalmotion.store import (
    sequence_from_hdf5,
    signature_from_hdf5,
    track_from_hdf5,
)
from modalmotion.viewer.page import View, view_page
from modalmotion.viewer.payload import frames_payload
from modalmotion_service.work.fitted import Fitted
from modalmotion_service.work.tasks.files import write_whole

# Of one answer: a page asks for the frames of a large surface a piece at a time.
MOST_FRAME_BYTES: Final = 64_000_000


def make_view(one: Fitted, as_page: bool, output: Path) -> None:
    """Write what a page needs first of a kept signature; or the whole page, as one file.

    A page of one file is shown without a service: it holds the data of a track itself.
    """
    view = View(
        signature_from_hdf5(one.signature),
        one.read_sequence(),
        template=one.read_template(),
        title=one.title,
    )
    track = one.track
    if not as_page:
        write_whole(output, replace(view, is_tracked=track is not None).payload())
        return
    data = None if track is None else track_from_hdf5(track).data
    write_whole(output, view_page([replace(view, data=data)]).encode())


def make_frames(one: Fitted, first: int, stop: int | None, output: Path) -> None:
    """Write frames as they were sent.

    Raises
    ------
    LimitError
        If they are more than one answer holds.
    """
    loaded, fitted = sequence_from_hdf5(one.sequence), signature_from_hdf5(one.signature)
    frames = range(loaded.n_frames)[first:stop]
    size = 6 * loaded.n_vertices * len(frames)
    if size > MOST_FRAME_BYTES and len(frames) > 1:
        raise LimitError(
            f"{len(frames)} frames take {size} bytes; an answer holds at most {MOST_FRAME_BYTES}.",
            remedy="Ask for fewer frames at a time: first and stop name them.",
            limit="view_frame_bytes",
            details={"value": size, "most": MOST_FRAME_BYTES},
        )
    named = one.read_template()
    write_whole(output, frames_payload(loaded, fitted, first, stop, template=named))
