"""Which value of a label map is the cavity, where nobody says: by geometry.

A wall encloses its cavity: the left ventricle borders on its muscle nearly all round, the right one
along the septum alone. So maps are read alike whether the cavity is 3 (ACDC, TotalSegmentator's
chambers), 1 (M&Ms) or something else.
"""

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np
import scipy

from modalmotion import errors, notes
from modalmotion.images import ImageSequence, Volume
from modalmotion.images.volume import is_sliced
from modalmotion.representation import Floats, Ints

NO_MAP: Final = "none"
"""Label of images that are no label map, though they have few whole numbers."""

_REMEDY: Final = (
    "Name the cavity (--label VALUE), or declare that this is not a label map (--label none)."
)

# Of a map of labels: most values, range of these, and least share of neighbours that are alike.
_MOST_VALUES: Final = 150
_WIDEST: Final = 1000
_ALIKE: Final = 0.9

# More labels than chambers and vessels of a heart are those of a body, which has other walls.
_MOST_OF_HEART: Final = 12

# Of the border of a cavity, that is at its wall; and of the largest that is enclosed so, the volume
# of the next: papillary muscles, or scars.
_ENCLOSED: Final = 0.6
_NEXT: Final = 0.5

# Of a section within its outline: a wall has so much of a hole.
_HOLE: Final = 0.1

# Frames that are looked at, at most.
_FRAMES: Final = 4

_MM3_PER_ML: Final = 1000.0


def is_label_map(images: ImageSequence) -> bool:
    """Whether images hold labels: few whole numbers, most of them beside their like.

    Raises
    ------
    ParameterError
        If they are labels, and some voxels have no number.
    """
    volumes = _volumes(images)
    if not volumes:
        return False
    values = volumes[0].values
    if values.dtype.kind not in "biuf":
        return False
    is_number = np.isfinite(values)
    values = values if is_number.all() else np.where(is_number, values, 0)
    low, high = float(values.min()), float(values.max())
    if low < 0 or high - low > _WIDEST or high == low or (values != np.rint(values)).any():
        return False
    if np.count_nonzero(np.bincount(values.ravel().astype(np.int64))) > _MOST_VALUES:
        return False
    along = int(np.argmin(volumes[0].spacing))
    pairs = np.diff(values.astype(np.int64), axis=along)
    is_map = bool((pairs == 0).mean() >= _ALIKE)
    frames = [v for v in images.frames if is_map and isinstance(v, Volume)]
    if n_missing := sum(int((~np.isfinite(v.values)).sum()) for v in frames):
        raise errors.ParameterError(
            f"{n_missing} voxels of the label map are not numbers (NaN or infinite).",
            remedy="Write 0 for unlabelled voxels.",
        )
    return is_map


def whole_labels(labels: Sequence[str | int]) -> list[int]:
    """Take labels as the whole numbers that those of a label map are; of `NO_MAP` there is none.

    Raises
    ------
    ParameterError
        If one is none.
    """
    values: list[int] = []
    if tuple(labels) == (NO_MAP,):
        return values
    for label in labels:
        try:
            values.append(int(label))
        except ValueError:
            raise errors.ParameterError(
                f"The label {label!r:.40} is not a whole number, as the labels of a label map are.",
                remedy=_REMEDY,
            ) from None
    return values


def cavity_in(images: ImageSequence) -> tuple[int, notes.Note]:
    """Decide which value is the cavity: that which another, its wall, encloses.

    Returns
    -------
    int
    Note
        What was decided, and from what, for the user.

    Raises
    ------
    ParameterError
        Where geometry does not tell; it names the values and their volumes.
    """
    volumes = _volumes(images)
    values = np.unique(np.concatenate([np.unique(v.values) for v in volumes])).astype(np.int64)
    values = values[values != 0]
    ml = _ml(volumes[0], values)
    named = listed(values, ml)
    if len(values) > _MOST_OF_HEART:
        raise _undecided(f"there are {len(values)}, more than in a heart", named)
    if len(values) == 1:
        return _of_one(volumes[0], int(values[0]), named)
    borders = np.sum([_borders(v, values) for v in volumes], axis=0)
    shares = borders[:, 1:] / np.maximum(borders.sum(axis=1, keepdims=True), 1)
    walls = shares.argmax(axis=1)
    is_enclosed = shares.max(axis=1) >= _ENCLOSED
    order = np.argsort(np.where(is_enclosed, ml, -1.0))[::-1]
    first, second = order[:2]
    if not is_enclosed[first]:
        raise _undecided("none is enclosed by another as a cavity is by its wall", named)
    if is_enclosed[second] and ml[second] > _NEXT * ml[first] and walls[first] != second:
        raise _undecided(f"{values[first]} and {values[second]} are both enclosed by others", named)
    wall = values[walls[first]]
    note = notes.Note.of(
        "cavity_recognised",
        label=values[first],
        wall=wall,
        share=shares[first].max(),
        volumes=named,
    )
    return int(values[first]), note


def listed(values: Iterable[int], ml: Iterable[float]) -> str:
    """Write values with their volumes."""
    return ", ".join(f"{value}: {volume:.3g} ml" for value, volume in zip(values, ml, strict=True))


def values_in(volume: Volume) -> str:
    """Write the values of a volume other than 0, the most frequent first, with their volumes."""
    values = np.unique(volume.values)
    values = values[values != 0]
    ml = _ml(volume, values)
    order = np.argsort(-ml, kind="stable")[:_MOST_OF_HEART]
    return listed(values[order], ml[order])


def _volumes(images: ImageSequence) -> list[Volume]:
    there = [frame for frame in images.frames if isinstance(frame, Volume)]
    return there[:: max(1, len(there) // _FRAMES)]


def _ml(volume: Volume, values: Ints) -> Floats:
    voxel = abs(float(np.linalg.det(volume.affine[:, :3]))) / _MM3_PER_ML
    return np.array([voxel * np.count_nonzero(volume.values == value) for value in values])


def _borders(volume: Volume, values: Ints) -> Ints:
    """Faces of voxels between each value and each other, (values, 1 + values); the first is 0.

    Between thick slices there are none: what is above a slice is another part of the heart.
    """
    kinds = np.pad(np.searchsorted(values, volume.values) + 1, 1)
    kinds[np.pad(volume.values, 1) == 0] = 0
    n = len(values) + 1
    counts = np.zeros((n, n), dtype=np.int64)
    across = int(np.argmax(volume.spacing)) if is_sliced(volume) else None
    for axis in range(3):
        if axis == across:
            continue
        own = np.moveaxis(kinds, axis, 0)
        differs = own[:-1] != own[1:]
        pairs = own[:-1][differs] * n + own[1:][differs]
        counts += np.bincount(pairs, minlength=n * n).reshape(n, n)
    both: Ints = (counts + counts.T)[1:]
    return both


def _of_one(volume: Volume, value: int, named: str) -> tuple[int, notes.Note]:
    """Take a map of one label as that of a cavity, unless it is a ring."""
    own = np.moveaxis(volume.values == value, int(np.argmax(volume.spacing)), 0)
    filled = sum(int(scipy.ndimage.binary_fill_holes(section).sum()) for section in own)
    if filled - own.sum() > _HOLE * filled:
        raise errors.ParameterError(
            f"The map has one label ({named}), which is a ring: a wall whose cavity has no label.",
            remedy="Give the cavity a label of its own.",
            details={"labels": [value]},
        )
    note = notes.Note.of("one_label", volumes=named)
    return value, note


def _undecided(reason: str, named: str) -> errors.ParameterError:
    return errors.ParameterError(
        f"Which label is the cavity? Of the labels in the map ({named}) {reason}.",
        remedy=_REMEDY,
    )
