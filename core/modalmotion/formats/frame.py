"""One frame of a sequence, its polygons as triangles, and vertices that triangles share."""

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from modalmotion import errors
from modalmotion.limits import NO_LIMITS, ReadLimits
from modalmotion.notes import Note
from modalmotion.representation import FloatArray, Ints

TRACK: Final = "`modalmotion track`"
"""What takes frames that do not correspond, as remedies name it; a service has its own name."""

SIGNATURE: Final = "`modalmotion signature`"
"""What takes a sequence of one mesh, as remedies name it; a service has its own name."""

NOTHING_TO_TRACK: Final = (
    "The vertices of a sequence of one mesh correspond, so that it needs no tracking: it is for "
    f"{SIGNATURE}."
)
"""Remedy where such a sequence came to be tracked."""

ONE_MESH: Final = (
    "Send one mesh that moves, with the same vertices and faces in every frame; or track the "
    f"frames as they are: {TRACK}."
)
"""Remedy where frames are not of one mesh."""

# 3D Slicer and Mimics write this into headers and comments.
_SPACE: Final = re.compile(rb"SPACE=(RAS|LPS)")


@dataclass(frozen=True, eq=False)
class Frame:
    """Vertices and triangles in the order of the file.

    Parameters
    ----------
    positions : (vertices, 3) float32 or float64
    faces : (faces, 3) int64
        Not checked yet: indices may be out of range.
    is_soup : bool
        Whether each face has three vertices of its own, as in STL.
    notes : tuple of Note
        Changes to the polygons.
    ignored : tuple of str
        Unused content of the file.
    statements : tuple of (str, str)
        What the file states, by name: "coordinate_system", "unit", "topology", "grid"
        and "time" (numbers as text).
    """

    positions: FloatArray
    faces: Ints
    is_soup: bool = False
    notes: tuple[Note, ...] = ()
    ignored: tuple[str, ...] = ()
    statements: tuple[tuple[str, str], ...] = ()

    def stated(self, name: str) -> str | None:
        """Return the file's statement of that name."""
        return dict(self.statements).get(name)


def space_in(text: bytes) -> tuple[tuple[str, str], ...]:
    """Find the statement of a coordinate system in a header or comment.

    Returns
    -------
    tuple of (str, str)
        Empty or one statement, for `Frame.statements`.
    """
    match = _SPACE.search(text)
    return () if match is None else (("coordinate_system", match[1].decode()),)


@contextmanager
def in_frame(frame: int | None, name: str = "") -> Iterator[None]:
    """Name the frame, and the file if there is one, in what is wrong with it."""
    try:
        yield
    except errors.InputError as error:
        file = repr(Path(name).name[-60:]) if name else ""
        where = file if frame is None else f"Frame {frame}{f' ({file})' if file else ''}"
        own = error.message.removeprefix(f"Frame {frame}: ").removeprefix(f"Frame {frame}, ")
        error.message = f"{where}: {own}"
        error.frame = frame if error.frame is None else error.frame
        if name:
            error.details["file"] = name[-200:]
        raise


_MISSHAPEN: Final = (
    *(KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError, RecursionError),
)


@contextmanager
def misread(
    malformed: Callable[[str], errors.MalformedFileError],
    what: str,
    kinds: tuple[type[Exception], ...] = _MISSHAPEN,
) -> Iterator[None]:
    """Make one error of whatever reading content of another shape raises.

    Raises
    ------
    MalformedFileError
        Made by `malformed` of `what`, and of what was raised.
    """
    try:
        yield
    except (errors.ModalMotionError, MemoryError):
        raise
    except kinds as error:
        reason = " ".join(str(error).split())[:80]
        raise malformed(f"{what} ({type(error).__name__}: {reason}).") from error


Integers = Sequence[int] | Ints


@dataclass(frozen=True, eq=False)
class Triangles:
    """Triangles, and notes on the polygons that they come from.

    Parameters
    ----------
    faces : (faces, 3) int64
    notes : tuple of Note
    """

    faces: Ints
    notes: tuple[Note, ...]


def triangulate(sizes: Integers, corners: Integers, limits: ReadLimits = NO_LIMITS) -> Triangles:
    """Split each polygon into a fan from its first corner; drop those of fewer than three.

    Parameters
    ----------
    sizes : (polygons,) int
        Number of corners of each polygon.
    corners : (corners,) int
        Of one polygon after the other.
    limits : ReadLimits, optional

    Returns
    -------
    Triangles
        In the order of the polygons: (c0, c1, c2), (c0, c2, c3), ...

    Raises
    ------
    LimitError
        If they are more faces than `limits` accept.
    """
    sizes, corners = (np.asarray(values, dtype=np.int64) for values in (sizes, corners))
    notes = []
    if (n_fans := int((sizes > 3).sum())) > 0:
        notes.append(Note.of("polygons_split", n_polygons=n_fans))
    if (n_dropped := int((sizes < 3).sum())) > 0:
        notes.append(Note.of("polygons_dropped", n_polygons=n_dropped))
    if not n_fans and not n_dropped:
        return Triangles(corners.reshape(-1, 3), ())
    counts = np.maximum(sizes - 2, 0)
    # A byte of a file may be a corner, and a hundred bytes here.
    limits.require(faces=int(counts.sum()))
    first = np.repeat(np.cumsum(sizes) - sizes, counts)
    # Place of each triangle within its fan: 0, 1, ... for each polygon.
    place = np.arange(int(counts.sum())) - np.repeat(np.cumsum(counts) - counts, counts)
    faces = np.stack(
        [corners[first], corners[first + place + 1], corners[first + place + 2]], axis=1
    )
    return Triangles(faces, tuple(notes))


@dataclass(frozen=True, eq=False)
class MergeMap:
    """Map from corners of triangles to merged vertices.

    Merging each frame by itself would number its vertices anew and break correspondence
    without any sign, so the map of the first frame serves all.

    Parameters
    ----------
    first : (vertices,) int64
        First corner of each vertex, increasing.
    vertex_of : (corners,) int64
    """

    first: Ints
    vertex_of: Ints

    @property
    def faces(self) -> Ints:
        """Triangles of the merged vertices, (faces, 3) int64."""
        return self.vertex_of.reshape(-1, 3)

    def apply(self, corners: FloatArray, frame: int) -> FloatArray:
        """Merge the corners of a frame.

        Parameters
        ----------
        corners : (corners, 3) float32 or float64
        frame : int

        Returns
        -------
        (vertices, 3) float32 or float64

        Raises
        ------
        ShapeError
            If the frame has another number of triangles.
        ConnectivityError
            If corners that were one vertex in the first frame no longer coincide.
        """
        if len(corners) != len(self.vertex_of):
            raise errors.ShapeError(
                f"Frame {frame} has {len(corners) // 3} triangles, frame 0 has "
                f"{len(self.vertex_of) // 3}.",
                remedy=ONE_MESH,
                frame=frame,
            )
        positions = corners[self.first]
        apart = np.flatnonzero((positions[self.vertex_of] != corners).any(axis=1))
        if apart.size:
            corner = int(apart[0])
            vertex = int(self.vertex_of[corner])
            raise errors.ConnectivityError(
                f"Frame {frame}: the corners that are vertex {vertex} in frame 0 are apart "
                f"(corner {corner % 3} of triangle {corner // 3}; {apart.size} such corners).",
                remedy="STL contains no vertices, so those of frame 0 count for all frames. Send a "
                "format that has them (PLY, OBJ, VTK), or triangles in the same order; or track "
                f"the frames as they are: {TRACK}.",
                frame=frame,
                vertex=vertex,
            )
        return positions


def merge_corners(corners: FloatArray) -> MergeMap:
    """Merge corners at exactly the same place into one vertex, in order of appearance.

    Parameters
    ----------
    corners : (corners, 3) float32 or float64

    Returns
    -------
    MergeMap
    """
    # Adding zero turns -0 into 0; equal rows then have equal bytes, which sort fast.
    rows = np.ascontiguousarray(corners + corners.dtype.type(0))
    keys = rows.view(np.dtype((np.void, rows.itemsize * 3))).ravel()
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return MergeMap(first[order].astype(np.int64), rank[inverse.ravel()].astype(np.int64))
