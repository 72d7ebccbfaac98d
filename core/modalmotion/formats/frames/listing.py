"""Choice and order of the files that are frames."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

from modalmotion.errors import MalformedFileError
from modalmotion.formats.frames.names import (
    FRAME_SUFFIXES,
    SERIES_SUFFIXES,
    is_hidden,
    name_beside,
    natural_key,
)
from modalmotion.formats.frames.series import read_series
from modalmotion.formats.result import Reading
from modalmotion.limits import ReadLimits
from modalmotion.representation import counted

_NUMBERED: Final = re.compile(r"(.*?)(\d{1,18})(\D*)", re.DOTALL)


@dataclass(frozen=True)
class Listing:
    """Frames in the order of time.

    Parameters
    ----------
    names : tuple of str
    times : tuple of float, s, or None
    others : tuple of str
        Files that are not frames.
    notes : tuple of str
    """

    names: tuple[str, ...]
    times: tuple[float, ...] | None
    others: tuple[str, ...]
    notes: tuple[str, ...]

    def complete(self, result: Reading) -> Reading:
        """Add times, unused files and notes of the listing to a reading."""
        return replace(
            result,
            ignored=(*result.ignored, *self.others),
            notes=(*result.notes, *self.notes),
        )


def list_frames(names: list[str], read: Callable[[str], bytes], limits: ReadLimits) -> Listing:
    """Choose and sort the frames among files.

    Parameters
    ----------
    names : list of str
    read : callable
        Returns the bytes of one of them.
    limits : ReadLimits

    Raises
    ------
    MalformedFileError
        If there are no frames, several kinds of frames without a list, or several lists.
    """
    visible = [name for name in names if not is_hidden(name)]
    lists = [name for name in visible if name.lower().endswith(SERIES_SUFFIXES)]
    frames = [name for name in visible if name.lower().endswith(FRAME_SUFFIXES)]
    if len(lists) > 1:
        raise MalformedFileError(
            f"There are several lists of frames: {', '.join(map(repr, sorted(lists)[:4]))}.",
            remedy="Keep one .pvd or .series file, or none.",
        )
    if lists:
        return _as_listed(lists[0], visible, read, limits)
    kinds = sorted({name.lower()[-4:] for name in frames})
    if len(kinds) > 1:
        raise MalformedFileError(
            f"There are frames of several kinds: {', '.join(kinds)}.",
            remedy="Send one kind, or add a .pvd or .series file that names the frames.",
        )
    ordered = tuple(sorted(frames, key=natural_key))
    others = tuple(sorted(set(visible) - set(frames)))
    return Listing(ordered, None, others, notes_on_numbers(ordered))


def notes_on_numbers(names: tuple[str, ...]) -> tuple[str, ...]:
    """Note gaps in the numbers in the names of frames: nothing else would show them.

    Parameters
    ----------
    names : tuple of str
        In their order. Only the last number of each counts, where all else is the same.
    """
    parts = [_NUMBERED.fullmatch(name.rpartition(".")[0]) for name in names]
    if len(names) < 3 or not all(parts) or len({(p[1], p[3]) for p in parts if p}) > 1:
        return ()
    numbers = [int(p[2]) for p in parts if p]
    steps = [b - a for a, b in pairwise(numbers)]
    missing = sum(step // min(steps) - 1 for step in steps) if min(steps) > 0 else 0
    if not missing:
        return ()
    first = next(k for k, step in enumerate(steps) if step > min(steps))
    return (
        (
            f"The numbers in the names leave out {counted(missing, 'frame')}, first between "
            f"{names[first][-60:]!r} and {names[first + 1][-60:]!r}: a file may be missing. Frames "
            "are counted as they come; without stated times they count as evenly spaced."
        ),
    )


def _as_listed(
    source: str, visible: list[str], read: Callable[[str], bytes], limits: ReadLimits
) -> Listing:
    series = read_series(read(source), limits)
    names = tuple(name_beside(source, name) for name in series.names)
    there = set(visible)
    for number, name in enumerate(names):
        if name not in there:
            raise MalformedFileError(
                f"{source[-60:]!r} lists {name[-60:]!r}, which is not there.",
                remedy="Pack the list together with the frames it names.",
                frame=number,
            )
    others = tuple(sorted(there - {source, *names}))
    notes = (*series.notes, f"{source[-60:]!r} has no unit of time; its values count as seconds.")
    return Listing(names, series.times, others, notes)
