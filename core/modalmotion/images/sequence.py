"""Images over time."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ShapeError
from modalmotion.images.volume import Plane, PlaneSet, Volume, slices_of
from modalmotion.mesh.checks import require_times
from modalmotion.notes import Note
from modalmotion.representation import Floats, FrozenArrays, shown

Image: TypeAlias = Volume | PlaneSet

# Voxels longer than this times their width are slices: what is between two of them is not seen.
_SLICED: Final = 2.5

# Slices with fewer voxels through a volume are a few slices, not a volume.
_FEWEST: Final = 4


@shown("n_frames", "frames", "times")
@dataclass(frozen=True, eq=False)
class ImageSequence(FrozenArrays):
    """Images of one object over time, in LPS mm.

    Parameters
    ----------
    frames : tuple of Volume, PlaneSet or None
        None if a frame is missing. Sets of planes have as many planes in each frame, in the
        same order.
    times : (frames,) float64, s, or None
    period : float or None, s
        Of the cycle, where the file states it.
    notes : tuple of Note
        Of the file, for the user.
    """

    frames: tuple[Image | None, ...]
    times: Floats | None = None
    period: float | None = None
    notes: tuple[Note, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "frames", tuple(self.frames))
        if not any(frame is not None for frame in self.frames):
            raise ShapeError(
                "The images have no frame.", remedy="Give a volume or planes for one frame or more."
            )
        if self.times is not None:
            object.__setattr__(self, "times", require_times(self.times, len(self.frames)))
        sizes = {len(frame) for frame in self.frames if isinstance(frame, PlaneSet)}
        if len(sizes) > 1:
            raise ShapeError(
                f"Frames have {min(sizes)} planes, others {max(sizes)}.",
                remedy="Give each frame the same planes; one that is missing may be all NaN.",
            )

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return len(self.frames)

    @property
    def finest(self) -> float:
        """Least distance between neighbouring samples, mm."""
        parts = (part for frame in self.frames if frame is not None for part in parts_of(frame))
        return min(min(part.spacing) for part in parts)

    @cached_property
    def id(self) -> str:
        """Digest (sha256, hex) of samples, places and times: the same for the same content."""
        digest = hashlib.sha256(b"modalmotion.images 1\0")
        for array in (self.times, None if self.period is None else np.array([self.period])):
            _add(digest, array)
        for frame in self.frames:
            parts: Sequence[Volume | Plane] = () if frame is None else parts_of(frame)
            _add(digest, np.array([len(parts), isinstance(frame, PlaneSet)]))
            for part in parts:
                _add(digest, part.affine)
                _add(digest, part.values)
                if isinstance(part, Plane):
                    _add(digest, np.array([part.thickness]))
        return digest.hexdigest()

    def sliced(self) -> ImageSequence:
        """Take volumes of thick slices apart into planes."""
        frames = tuple(
            slices_of(frame) if isinstance(frame, Volume) and is_sliced(frame) else frame
            for frame in self.frames
        )
        return ImageSequence(frames, self.times, self.period, self.notes)


def parts_of(frame: Image) -> tuple[Volume | Plane, ...]:
    """Volume, or planes, that a frame consists of."""
    return frame.planes if isinstance(frame, PlaneSet) else (frame,)


def _add(digest: hashlib._Hash, array: NDArray[Any] | None) -> None:
    """Add an array's type and shape and its elements, in one order of bytes."""
    if array is None:
        digest.update(b"none\0")
        return
    kind = array.dtype.newbyteorder("<")
    digest.update(f"{kind.str} {array.shape}\0".encode())
    digest.update(np.ascontiguousarray(array, dtype=kind).data)


def is_sliced(volume: Volume) -> bool:
    """Whether a volume is a stack of thick slices."""
    return max(volume.spacing) > _SLICED * min(volume.spacing) or min(volume.shape) < _FEWEST


Images: TypeAlias = ImageSequence | Volume | PlaneSet
"""One image, or a sequence of them."""


def images_in(observed: Any) -> ImageSequence | None:
    """Read images, or a list with an image among its frames, as a sequence; None of other things.

    Raises
    ------
    ShapeError
        If other things are among the images.
    """
    if isinstance(observed, ImageSequence):
        return observed
    if isinstance(observed, (Volume, PlaneSet)):
        return ImageSequence((observed,))
    if not isinstance(observed, Sequence):
        return None
    kinds = [isinstance(item, (Volume, PlaneSet)) for item in observed]
    if not any(kinds):
        return None
    for k, (item, is_image) in enumerate(zip(observed, kinds, strict=True)):
        if item is not None and not is_image:
            raise ShapeError(
                f"Frame {k} is a {type(item).__name__}, others are images.",
                remedy="Give images in all frames, and None if one is missing.",
                frame=k,
            )
    return ImageSequence(tuple(observed))
