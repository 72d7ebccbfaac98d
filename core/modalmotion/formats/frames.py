"""Frames in files of one mesh each, read and joined to one sequence."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Final

import numpy as np

from modalmotion import errors, mesh
from modalmotion.formats import ply, text_meshes, vtk_legacy, vtk_xml
from modalmotion.formats.detect import MESH_FORMATS, Format, detect_format, unknown_format
from modalmotion.formats.frame import ONE_MESH, Frame, MergeMap, merge_corners
from modalmotion.formats.result import Parser, Reading, reading_of
from modalmotion.limits import ReadLimits
from modalmotion.notes import Note
from modalmotion.progress import Reporter, reported
from modalmotion.representation import FloatArray


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
            raise errors.ShapeError(
                f"It is {kind.upper()}, frame 0 is {self._format.upper()}.",
                remedy="Send all frames in one format.",
            )
        space, expected = (one.stated("coordinate_system") for one in (frame, first))
        if space != expected:
            raise errors.ShapeError(
                f"Its coordinate system is {space}, that of frame 0 {expected}.",
                remedy="Save all frames in one coordinate system.",
            )
        positions = self._finite(frame, number)
        if self._merge is not None:
            positions = self._merge.apply(positions, number)
        elif len(positions) != self._vertices.shape[1]:
            raise errors.ShapeError(
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
        notes = list(first.notes)
        if self._merge is not None:
            notes.append(
                Note.of(
                    "stl_merged",
                    n_corners=len(self._merge.vertex_of),
                    n_vertices=len(self._merge.first),
                )
            )
        return reading_of(
            self._vertices,
            self._faces,
            format=self._format.value,
            grid=_grid(first.stated("grid")),
            topology=first.stated("topology"),
            times=None if times is None else list(times),
            unit=first.stated("unit"),
            facts=mesh.facts_from_texts({"coordinates": first.stated("coordinate_system")}),
            notes=notes,
            ignored=first.ignored,
            coordinate_system=first.stated("coordinate_system"),
        )

    @staticmethod
    def _finite(frame: Frame, number: int) -> FloatArray:
        bad = np.flatnonzero(~np.isfinite(frame.positions).all(axis=1))
        if bad.size:
            raise errors.NonFiniteError(
                f"Vertex {bad[0]} is not finite ({bad.size} such vertices).",
                remedy="Repair or leave out the frame; missing points are not guessed.",
                frame=number,
                vertex=int(bad[0]),
            )
        return frame.positions


def _grid(stated: str | None) -> list[int] | None:
    if stated is None:
        return None
    try:
        return [int(n) for n in stated.split()]
    except ValueError:
        raise errors.MalformedFileError(
            f"The frames state the grid as {stated[:40]!r}.",
            remedy="Remove the comment that states it, or write whole numbers.",
        ) from None


def _other_faces(frame: Frame, first: Frame) -> errors.ConnectivityError:
    own, theirs = frame.faces, first.faces
    what = f"It has {len(own)} faces, frame 0 has {len(theirs)}."
    if len(own) == len(theirs):
        face = int(np.flatnonzero((own != theirs).any(axis=1))[0])
        what = f"Face {face} is {own[face].tolist()}, in frame 0 {theirs[face].tolist()}."
    return errors.ConnectivityError(what, remedy=ONE_MESH)


_READERS: Final = {
    Format.STL: text_meshes.read_stl,
    Format.PLY: ply.read_ply,
    Format.OBJ: text_meshes.read_obj,
    Format.OFF: text_meshes.read_off,
    Format.VTK: vtk_legacy.read_vtk_legacy,
    Format.VTP: vtk_xml.read_vtk_xml,
    Format.VTU: vtk_xml.read_vtk_xml,
}


def read_mesh(data: bytes, stated: Format | None, parser: Parser) -> tuple[Frame, Format]:
    """Read a file that contains one mesh.

    Parameters
    ----------
    data : bytes
    stated : Format or None
        Recognised by content if None.
    parser : Parser
        For the formats that need one; its limits apply to all.

    Returns
    -------
    frame : Frame
    format : Format

    Raises
    ------
    InputError
        The subclass names the problem.
    """
    kind = detect_format(data) if stated is None else stated
    if kind is None:
        raise unknown_format(data)
    if kind not in MESH_FORMATS:
        raise errors.MalformedFileError(
            f"The file is {kind.upper()}, which contains a whole sequence or none.",
            remedy="Send such a file by itself, not as a frame.",
        )
    return _READERS[kind](data, parser.limits), kind


def read_frames(
    names: Sequence[str],
    read: Callable[[str], bytes],
    parser: Parser,
    times: tuple[float, ...] | None = None,
    progress: Reporter | None = None,
) -> Reading:
    """Read frames and join them to one sequence.

    Parameters
    ----------
    names : sequence of str
        Of the files, in the order of time.
    read : callable
        Returns the bytes of one of them.
    parser : Parser
        Its limits apply.
    times : tuple of float, s, optional
    progress : callable, optional

    Raises
    ------
    InputError
        It names the frame and its file.
    """
    parser.limits.require("frames", len(names))
    stack: FrameStack | None = None
    for number, name in enumerate(reported(names, progress)):
        with _named(number, name):
            frame, kind = read_mesh(read(name), None, parser)
            if stack is None:
                stack = FrameStack(frame, kind, len(names), parser.limits)
            else:
                stack.add(number, frame, kind)
    if stack is None:
        raise errors.MalformedFileError("There are no frames.", remedy="Send one file or more.")
    return stack.result(times)


@contextmanager
def _named(number: int, name: str) -> Iterator[None]:
    try:
        yield
    except errors.InputError as error:
        error.message = (
            f"Frame {number} ({name[-60:]!r}): {error.message.removeprefix(f'Frame {number}: ')}"
        )
        error.frame = number
        error.details["file"] = name[-200:]
        raise
