"""Slices put together: by series, orientation and position to planes, by trigger time to phases."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ShapeError
from modalmotion.images import ImageSequence, Plane, PlaneSet, Volume
from modalmotion.representation import counted

# Slices of one plane agree to this, mm and as directions.
_SAME_PLACE: Final = 0.1
_SAME_DIRECTION: Final = 1e-3

# Slices nearer than this many pixels, regular to a tenth of the step, are a volume.
_DENSE: Final = 2.5
_FEWEST: Final = 4
_REGULAR: Final = 0.1


@dataclass(frozen=True, eq=False)
class Slice:
    """One slice: samples (i, j), affine (3, 4) and what was said of it."""

    values: NDArray[Any]
    affine: NDArray[np.float64]
    info: dict[str, Any]

    @property
    def place(self) -> tuple[Any, ...]:
        """What files of one plane have in common."""
        axes = np.rint(self.affine[:, :2] / _SAME_DIRECTION).astype(np.int64)
        origin = np.rint(self.affine[:, 3] / _SAME_PLACE).astype(np.int64)
        return (self.info["series"], self.values.shape, *axes.ravel(), *origin)


def grouped(slices: Sequence[Slice]) -> ImageSequence:
    """Put slices together to images over time.

    Raises
    ------
    ShapeError
        If they belong to several patients, or no two planes have the same phases.
    """
    for name, told in (("patient", "patients"), ("space", "frames of reference")):
        n = len({own.info[name] for own in slices})
        if n > 1:
            raise ShapeError(
                f"The DICOM files are of {n} {told}.",
                remedy="Send the files of one examination of one patient.",
            )
    planes: dict[tuple[Any, ...], list[Slice]] = defaultdict(list)
    for own in slices:
        planes[own.place].append(own)
    notes: list[str] = []
    ordered = [_in_time(group, notes) for group in planes.values()]
    n_phases, _ = max(Counter(map(len, ordered)).items(), key=lambda item: (item[1], item[0]))
    kept = [group for group in ordered if len(group) == n_phases]
    if len(kept) < len(ordered):
        notes.append(
            "Left out for another number of phases than "
            f"{n_phases}: {counted(len(ordered) - len(kept), 'plane')}."
        )
    kept.sort(key=lambda group: tuple(group[0].affine.T.round(3).ravel()))
    starts = [group[0].info["trigger_ms"] for group in kept]
    late = [t for t in starts if t is not None and t > 100.0]
    if late and len(late) < len(starts):
        notes.append(
            f"Later than the trigger by {min(late):.0f} to {max(late):.0f} ms: "
            f"{counted(len(late), 'plane')}; phases are matched by their order."
        )
    frames = [_frame([group[k] for group in kept]) for k in range(n_phases)]
    return ImageSequence(tuple(frames), *_times(kept, n_phases), tuple(notes))


def _in_time(group: list[Slice], notes: list[str]) -> list[Slice]:
    if len(group) == 1:
        return group
    triggers = [own.info["trigger_ms"] for own in group]
    if any(t is None for t in triggers) or len(set(triggers)) < len(group):
        note = (
            "Slices state no trigger times of their own; phases are in the order of their numbers."
        )
        if note not in notes:
            notes.append(note)
        return sorted(group, key=lambda own: own.info["number"] or 0.0)
    return sorted(group, key=lambda own: float(own.info["trigger_ms"]))


def _times(kept: list[list[Slice]], n: int) -> tuple[NDArray[np.float64] | None, float | None]:
    """Mean times over the planes, s, from 0, and the period."""
    rows = [[own.info["trigger_ms"] for own in group] for group in kept]
    full = [row for row in rows if all(t is not None for t in row) and len(set(row)) == n]
    if n < 2 or not full:
        return None, None
    times = np.mean([np.subtract(row, row[0]) for row in full], axis=0) / 1000.0
    span = float(times[-1])
    intervals = [own[0].info["interval_ms"] for own in kept]
    stated = [t / 1000.0 for t in intervals if t]
    period = float(np.median(stated)) if stated else 0.0
    return times, period if period > span else None


def _frame(slices: list[Slice]) -> Volume | PlaneSet:
    volume = _volume(slices)
    if volume is not None:
        return volume
    return PlaneSet(
        tuple(
            Plane(own.values, own.affine[:, [0, 1, 3]], float(own.info["thickness"]))
            for own in slices
        )
    )


def _volume(slices: list[Slice]) -> Volume | None:
    """Join parallel slices that lie densely and regularly; None of others."""
    first = slices[0]
    axes = first.affine[:, :2]
    if len(slices) < _FEWEST or any(
        own.values.shape != first.values.shape or np.abs(own.affine[:, :2] - axes).max() > 1e-3
        for own in slices
    ):
        return None
    normal = np.cross(axes[:, 0], axes[:, 1])
    normal /= np.linalg.norm(normal)
    slices = sorted(slices, key=lambda own: float(own.affine[:, 3] @ normal))
    origins = np.stack([own.affine[:, 3] for own in slices])
    steps = np.diff(origins, axis=0)
    step = steps.mean(axis=0)
    size = float(np.linalg.norm(step))
    if not 0 < size < _DENSE * float(np.linalg.norm(axes, axis=0).min()):
        return None
    if np.abs(steps - step).max() > _REGULAR * size:
        return None
    values = np.stack([own.values for own in slices], axis=-1)
    return Volume(values, np.column_stack([axes, step, origins[0]]))
