"""Which files are frames, and in which order."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from modalmotion.errors import MalformedFileError
from modalmotion.formats.limits import ReadLimits
from modalmotion.formats.names import (
    FRAME_SUFFIXES,
    SERIES_SUFFIXES,
    is_hidden,
    name_beside,
    natural_key,
)
from modalmotion.formats.result import ReadResult
from modalmotion.formats.series import read_series


@dataclass(frozen=True)
class Listing:
    """Frames in the order of time.

    Parameters
    ----------
    names : tuple of str
    times : tuple of float, s, or None
    others : tuple of str
        Files that are no frames.
    notes : tuple of str
    """

    names: tuple[str, ...]
    times: tuple[float, ...] | None
    others: tuple[str, ...]
    notes: tuple[str, ...]

    def complete(self, result: ReadResult) -> ReadResult:
        """Add to what was read of the frames what is known of their files."""
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
        Gives the bytes of one of them.
    limits : ReadLimits

    Raises
    ------
    MalformedFileError
        If there are no frames, frames of several kinds and no list of them, or several lists.
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
    return Listing(ordered, None, tuple(sorted(set(visible) - set(frames))), ())


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
