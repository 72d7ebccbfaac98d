"""Frames of one moving mesh, joined one after the other."""

from __future__ import annotations

import numpy as np

from modalmotion.errors import (
    ConnectivityError,
    MalformedFileError,
    NonFiniteError,
    ShapeError,
)
from modalmotion.formats.detect import Format
from modalmotion.formats.frames.frame import ONE_MESH, Frame
from modalmotion.formats.frames.merge import MergeMap, merge_corners
from modalmotion.formats.result import Reading
from modalmotion.limits import ReadLimits
from modalmotion.mesh import facts_from_texts
from modalmotion.mesh.checks import FloatArray, given_up
from modalmotion.mesh.sequence import in_time_order, mesh_sequence


class FrameStack:
    """Frames so far, all of the first one's connectivity.

    Parameters
    ----------
    frame : Frame
        The first one.
    kind : Format
    n_frames : int
        Number of all frames.
    limits : ReadLimits
    """

    def __init__(self, frame: Frame, kind: Format, n_frames: int, limits: ReadLimits) -> None:
        self._first, self._format = frame, kind
        self._merge: MergeMap | None = None
        positions = self._finite(frame, 0)
        self._faces = frame.faces
        if frame.is_soup:
            self._merge = merge_corners(positions)
            self._faces = self._merge.faces
            positions = positions[self._merge.first]
        limits.require("vertices", len(positions))
        limits.require("faces", len(self._faces))
        limits.require("decompressed_bytes", n_frames * positions.nbytes + self._faces.nbytes)
        self._vertices: FloatArray = np.empty((n_frames, *positions.shape), positions.dtype)
        self._vertices[0] = positions
        self._times = [frame.stated("time")]

    def add(self, number: int, frame: Frame, kind: Format) -> None:
        """Append the next frame.

        Raises
        ------
        InputError
            If it differs from the first in anything but positions.
        """
        first = self._first
        if kind is not self._format:
            raise ShapeError(
                f"It is {kind.upper()}, frame 0 is {self._format.upper()}.",
                remedy="Send all frames in one format.",
            )
        space = frame.stated("coordinate_system")
        if space != first.stated("coordinate_system"):
            raise ShapeError(
                f"Its coordinate system is {space}, that of frame 0 "
                f"{first.stated('coordinate_system')}.",
                remedy="Save all frames in one coordinate system.",
            )
        positions = self._finite(frame, number)
        if self._merge is not None:
            positions = self._merge.apply(positions, number)
        elif len(positions) != self._vertices.shape[1]:
            raise ShapeError(
                f"It has {len(positions)} vertices, frame 0 has {self._vertices.shape[1]}.",
                remedy=ONE_MESH,
            )
        elif not np.array_equal(frame.faces, first.faces):
            raise _other_faces(frame, first)
        if positions.dtype == np.float64 and self._vertices.dtype == np.float32:
            self._vertices = self._vertices.astype(np.float64)
        self._vertices[number] = positions
        self._times.append(frame.stated("time"))

    def result(self, times: tuple[float, ...] | None) -> Reading:
        """Build the sequence, through the validator of all sequences."""
        first = self._first
        stated = [time for time in self._times if time is not None]
        if times is None and len(stated) == len(self._times):
            times = tuple(float(time) for time in stated)
        vertices, ordered, notes = self._vertices, None, list(first.notes)
        if times is not None:
            vertices, ordered, done = in_time_order(self._vertices, list(times))
            notes += done
        sequence = mesh_sequence(
            given_up(vertices),
            self._faces,
            grid=_grid(first.stated("grid")),
            topology=first.stated("topology"),
            times=ordered,
            unit=first.stated("unit"),
            facts=facts_from_texts({"coordinates": first.stated("coordinate_system")}),
        )
        if self._merge is not None:
            notes.append(
                f"STL contains no vertices: {len(self._merge.vertex_of)} corners that coincide in "
                f"frame 0 became {len(self._merge.first)} vertices in all frames."
            )
        return Reading(
            sequence,
            ignored=first.ignored,
            format=self._format.value,
            coordinate_system=first.stated("coordinate_system"),
            unit_from=None if sequence.unit is None else "file",
            times_from=None if times is None else "file",
            notes=tuple(notes),
        )

    @staticmethod
    def _finite(frame: Frame, number: int) -> FloatArray:
        bad = np.flatnonzero(~np.isfinite(frame.positions).all(axis=1))
        if bad.size:
            raise NonFiniteError(
                f"Vertex {bad[0]} is not finite ({bad.size} such vertices).",
                remedy="Repair or leave out the frame; missing points are not guessed.",
                frame=number,
                vertex=int(bad[0]),
                details={"count": int(bad.size)},
            )
        return frame.positions


def _grid(stated: str | None) -> list[int] | None:
    if stated is None:
        return None
    try:
        return [int(n) for n in stated.split()]
    except ValueError:
        raise MalformedFileError(
            f"The frames state the grid as {stated[:40]!r}.",
            remedy="Remove the comment that states it, or write whole numbers.",
        ) from None


def _other_faces(frame: Frame, first: Frame) -> ConnectivityError:
    if len(frame.faces) != len(first.faces):
        what = f"It has {len(frame.faces)} faces, frame 0 has {len(first.faces)}."
        face = None
    else:
        face = int(np.flatnonzero((frame.faces != first.faces).any(axis=1))[0])
        what = (
            f"Face {face} is {frame.faces[face].tolist()}, in frame 0 {first.faces[face].tolist()}."
        )
    return ConnectivityError(what, remedy=ONE_MESH, details={"face": face})
