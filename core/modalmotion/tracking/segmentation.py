"""One image to one surface, with its stated error: tracking of a single frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from modalmotion.errors import ParameterError, ShapeError
from modalmotion.images import ImageSequence
from modalmotion.images.sequence import Images, images_in
from modalmotion.progress import Progress
from modalmotion.tracking.label_maps import from_labels
from modalmotion.tracking.label_values import is_label_map
from modalmotion.tracking.making import Start, track
from modalmotion.tracking.papillary import Papillary
from modalmotion.tracking.result import Track


def segment(
    images: Images,
    *,
    landmarks: Mapping[str, Any] | None = None,
    labels: Sequence[int] = (),
    wall: Sequence[int] = (),
    frame: int = 0,
    start: Start | None = None,
    modes: int = 37,
    papillary: Papillary = "pool",
    progress: Progress | None = None,
) -> Track:
    """Find a surface in one image.

    Parameters
    ----------
    images : Volume, PlaneSet or ImageSequence
        In LPS mm; of a sequence one frame is read.
    landmarks : mapping of "apex" and "base" to (3,) or (frames, 3) array_like, mm, optional
        Needed of images that are no label map.
    labels, wall : sequence of int
        Of a label map: values of the cavity, and of the wall around it; by geometry where no label
        is named.
    frame : int
    start, modes, papillary, progress : optional
        As for `track`.

    Returns
    -------
    Track
        Of one frame: its surface with a standard deviation at each vertex, and its volume.

    Raises
    ------
    InputError
        As `track` does, or if there is no such frame.
    """
    sequence = images_in(images)
    if sequence is None:
        raise ShapeError(
            f"A {type(images).__name__} is no image.",
            remedy="Give a Volume, a PlaneSet or an ImageSequence.",
        )
    if not 0 <= frame < sequence.n_frames or sequence.frames[frame] is None:
        raise ParameterError(
            f"There is no image in frame {frame}: there are {sequence.n_frames} frames.",
            remedy="Name a frame that has one, counted from 0.",
            frame=frame,
        )
    one = ImageSequence((sequence.frames[frame],), notes=sequence.notes)
    marks: dict[str, Any] = {}
    if labels or is_label_map(one):
        one, proposed = from_labels(one, labels, wall)
        marks |= proposed
    for name, value in (landmarks or {}).items():
        places = np.asarray(value, dtype=np.float64)
        is_listed = places.ndim == 2 and len(places) == sequence.n_frames
        marks[name] = places[frame] if is_listed else places
    return track(
        one,
        landmarks=marks,
        start=start,
        modes=modes,
        time="open",
        papillary=papillary,
        progress=progress,
    )
