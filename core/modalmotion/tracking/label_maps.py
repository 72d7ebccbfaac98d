"""Label maps: a segmentation as the easiest image, its apex and base proposed from itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import scipy

from modalmotion.errors import ParameterError, ShapeError
from modalmotion.images import ImageSequence, PlaneSet, Volume
from modalmotion.images.sequence import Image, is_sliced
from modalmotion.notes import Note
from modalmotion.representation import Bools, Floats, Ints
from modalmotion.tracking.closest import across
from modalmotion.tracking.label_slices import ends_in_slices
from modalmotion.tracking.label_values import cavity_in, values_in
from modalmotion.tracking.landmarks import Proposed

# Brightness of the labelled cavity; outside is 0.
_INSIDE: Final = 100.0

# Deviation of a proposal, in voxels: of an opening, across and along the normal of its plane, as on
# simulated ventricles; and of an end.
_CUT_OFF: Final = 0.7
_CUT_HEIGHT: Final = 0.2
_END: Final = 2.0

# Of half a voxel: what is so near to the plane of a cut is its border. Tangent of the most that a
# cut is aslant to the axis; places on the border that are looked at.
_CUT: Final = 3.0
_MOST_ASLANT: Final = 0.8
_MOST_BORDER: Final = 6000

# Voxels below the highest one: a section there is whole.
_SECTION: Final = (6.0, 3.0)

# mm beside the cavity, that edges are looked for within.
_ROOM: Final = 15.0

# mm: a landmark so far outside is noted.
_OUTSIDE: Final = 2.0

# Fewer voxels have no axis.
_FEWEST: Final = 30


class Labelled(NamedTuple):
    """Images of labels, ready to be tracked.

    Parameters
    ----------
    images : ImageSequence
    landmarks : mapping of "apex" and "base" to Proposed
    """

    images: ImageSequence
    landmarks: dict[str, Proposed]


def from_labels(images: ImageSequence, labels: Sequence[int] = ()) -> Labelled:
    """Make a label map ready for `track`: cavity bright, the rest dark, ends proposed.

    Parameters
    ----------
    images : ImageSequence
        Volumes of whole numbers.
    labels : sequence of int
        Of the cavity; without one it is that of `cavity_in`.

    Raises
    ------
    ParameterError
        If a label is nowhere in a frame, or geometry does not tell which is the cavity; it names
        those that are there, and their volumes.
    ShapeError
        If a frame is no volume.

    Notes
    -----
    In thick slices the ends are those of `ends_in_slices`. In other volumes the base is the plane
    that the wider end is cut by.
    """
    decided: tuple[Note, ...] = ()
    if not labels:
        value, note = cavity_in(images)
        labels, decided = (value,), (note,)
    frames = _with_room([_shown(k, frame, labels) for k, frame in enumerate(images.frames)])
    sliced = any(is_sliced(frame) for frame in frames if frame is not None)
    marks, notes = ends_in_slices(frames) if sliced else (_of_volumes(frames), ())
    note = Note.of("ends_proposed")
    own = (*images.notes, *decided, note, *notes)
    return Labelled(ImageSequence(frames, images.times, images.period, own), marks)


def notes_on_landmarks(
    images: ImageSequence, landmarks: Mapping[str, Any], reference: int
) -> tuple[Note, ...]:
    """Note stated landmarks that are more than 2 mm outside all that is labelled.

    Parameters
    ----------
    images : ImageSequence
        The label map.
    landmarks : mapping of str to (3,) or (frames, 3) array_like, mm
        A place in the reference frame, or one for each frame, NaN if it is unknown.
    reference : int
    """
    notes = []
    for name, value in landmarks.items():
        # What is no place is refused where landmarks join the frames.
        stated = np.asarray(None if isinstance(value, Proposed) else value, dtype=np.float64)
        if stated.ndim not in (1, 2) or stated.shape[-1] != 3:
            continue
        places = {reference: stated} if stated.ndim == 1 else dict(enumerate(stated))
        away = {
            k: _away(images.frames[k], place)
            for k, place in places.items()
            if k < images.n_frames and np.isfinite(place).all()
        }
        far = max(away, key=lambda k: away[k], default=None)
        if far is not None and away[far] > _OUTSIDE:
            notes.append(Note.of("landmark_outside", landmark=name, distance=away[far], frame=far))
    return tuple(notes)


def _away(frame: Volume | PlaneSet | None, place: Floats) -> float:
    """How far a place is outside the labelled voxels, mm."""
    if not isinstance(frame, Volume):
        return 0.0
    points = np.argwhere(frame.values != 0) @ frame.affine[:, :3].T + frame.affine[:, 3]
    nearest = float(np.linalg.norm(points - place, axis=1).min(initial=np.inf))
    return max(0.0, nearest - float(max(frame.spacing)) / 2.0)


def _shown(k: int, frame: Image | None, labels: Sequence[int]) -> Volume | None:
    """Cavity of frame k bright, the rest dark."""
    if isinstance(frame, PlaneSet):
        raise ShapeError(
            f"Frame {k} is a set of planes; the ends of a cavity are only found in volumes.",
            remedy="State apex and base, and track the planes as images.",
            frame=k,
        )
    if frame is None:
        return None
    cavity = np.isin(frame.values, list(labels))
    if cavity.sum() < _FEWEST:
        raise ParameterError(
            f"Label {', '.join(map(str, labels))} has {int(cavity.sum())} voxels in frame {k}.",
            remedy=f"Name one of these by --label: {values_in(frame)}.",
            frame=k,
        )
    return Volume(np.where(cavity, np.float32(_INSIDE), np.float32(0.0)), frame.affine)


def _with_room(frames: Sequence[Volume | None]) -> tuple[Volume | None, ...]:
    """Add unlabelled voxels where maps are cropped so close that edges have no outside."""
    before, after = np.zeros((2, 3), dtype=int)
    for frame in frames:
        if frame is not None:
            there = np.argwhere(frame.values)
            wanted = np.ceil(_ROOM / np.array(frame.spacing)).astype(int)
            before = np.maximum(before, wanted - there.min(axis=0))
            last = np.array(frame.values.shape) - 1
            after = np.maximum(after, wanted - (last - there.max(axis=0)))
    widths = np.stack([before, after], axis=1)
    return tuple(None if frame is None else _widened(frame, widths) for frame in frames)


def _widened(frame: Volume, widths: Ints) -> Volume:
    affine = frame.affine.copy()
    affine[:, 3] -= affine[:, :3] @ widths[:, 0]
    return Volume(np.pad(frame.values, widths), affine)


def _of_volumes(frames: Sequence[Volume | None]) -> dict[str, Proposed]:
    apices, bases, cuts = np.full((3, len(frames), 3), np.nan)
    spacing, axis = 0.0, None
    for k, frame in enumerate(frames):
        if frame is not None:
            apices[k], bases[k], axis, cuts[k] = _ends(frame, axis)
            spacing = max(spacing, float(max(frame.spacing)))
    base = Proposed(bases, _CUT_OFF * spacing, cuts, _CUT_HEIGHT * spacing)
    return {"apex": Proposed(apices, _END * spacing), "base": base}


def _ends(volume: Volume, before: Floats | None) -> tuple[Floats, Floats, Floats, Floats]:
    """Apex, base, the unit vector between them and that across the base, of one frame."""
    A, cavity = volume.affine, _largest_part(volume.values > 0)
    points = np.argwhere(cavity) @ A[:, :3].T + A[:, 3]
    middle = points.mean(axis=0)
    half = float(np.linalg.norm(A[:, :3], axis=0).mean()) / 2.0
    axis: Floats = np.linalg.eigh(np.cov((points - middle).T))[1][:, -1]
    z = (points - middle) @ axis
    if before is None:
        # A base is cut where the cavity is still wide.
        low, high = np.quantile(z, (0.0, 1.0))
        step = 0.12 * (high - low)
        turn = (z > high - step).sum() >= (z < low + step).sum()
    else:
        turn = axis @ before > 0
    axis = axis if turn else -axis
    flat = _flat_end(cavity, A, axis, half)
    base = _middle_of_cut(points, flat, axis, half)
    # Tip: at the height of the lowest voxels, in the middle of those near it.
    z = (points - base) @ axis
    tip = points[z < z.min() + 4.0 * half].mean(axis=0)
    return tip + (z.min() - half - float((tip - base) @ axis)) * axis, base, axis, flat


def _largest_part(cavity: Bools) -> Bools:
    """Leave out voxels that are apart from the rest: some beyond the base would be the base."""
    parts, _ = scipy.ndimage.label(cavity)
    largest: Bools = parts == np.bincount(parts[cavity]).argmax()
    return largest


def _flat_end(cavity: Bools, A: Floats, axis: Floats, half: float) -> Floats:
    """Direction across the plane in which a cavity ends, which may be aslant to its long axis.

    Of planes that touch the cavity from above it is the one that most of its border is near to.
    """
    inner = scipy.ndimage.binary_erosion(cavity, border_value=0)
    border = np.argwhere(cavity & ~inner) @ A[:, :3].T
    border = border[:: max(1, len(border) // _MOST_BORDER)]
    best, reach = axis, _MOST_ASLANT
    for _ in range(3):
        steps = np.linspace(-reach, reach, 9)
        tried = best + np.array([[a, b] for a in steps for b in steps]) @ across(best)
        tried /= np.linalg.norm(tried, axis=1, keepdims=True)
        heights = border @ tried.T
        near = (heights > heights.max(axis=0) - _CUT * half).sum(axis=0)
        # Of directions alike their mean.
        best = tried[near >= 0.98 * near.max()].mean(axis=0)
        best /= np.linalg.norm(best)
        reach /= 4.0
    return best


def _middle_of_cut(points: Floats, flat: Floats, axis: Floats, half: float) -> Floats:
    """Place the middle of an opening that is nearly flat: over a whole section, at its height.

    Its mean height is that of the section and what is above, over the section's size.
    """
    z = points @ flat
    low, high = (float(z.max()) - 2.0 * voxels * half for voxels in _SECTION)
    section = points[(z > low) & (z <= high)]
    above = (z > high).sum() / max(len(section), 1) * (high - low)
    middle = section.mean(axis=0)
    place: Floats = middle + (high + above - float(middle @ flat)) / float(flat @ axis) * axis
    return place
