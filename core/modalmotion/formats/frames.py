"""Frames in files of one mesh each, read and joined to one sequence."""

from collections.abc import Callable, Sequence
from typing import Final, TypeVar

import numpy as np

from modalmotion import errors, mesh
from modalmotion.formats import ply, text_meshes, vtk_legacy, vtk_xml
from modalmotion.formats.detect import MESH_FORMATS, Format, detect_format, unknown_format
from modalmotion.formats.frame import ONE_MESH, Frame, MergeMap, in_frame, merge_corners
from modalmotion.formats.result import Reading, reading_of
from modalmotion.limits import ReadLimits
from modalmotion.mesh import checks
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
        checks.require_finite(frame.positions, 0)
        positions = frame.positions
        self._faces = frame.faces
        if frame.is_soup:
            self._merge = merge_corners(positions)
            self._faces = self._merge.faces
            positions = positions[self._merge.first]
        limits.require(
            vertices=len(positions),
            faces=len(self._faces),
            decompressed_bytes=n_frames * positions.nbytes + self._faces.nbytes,
        )
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
        checks.require_finite(frame.positions, number)
        positions = frame.positions
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
        grid = first.stated("grid")
        stated = [time for time in self._times if time is not None]
        try:
            shape = None if grid is None else [int(n) for n in grid.split()]
            if times is None and len(stated) == len(self._times):
                times = tuple(float(time) for time in stated)
        except ValueError as error:
            raise errors.MalformedFileError(
                f"The frames state their grid or times in words ({str(error)[:80]}).",
                remedy="Remove the comment that states them, or write numbers.",
            ) from None
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
            grid=shape,
            topology=first.stated("topology"),
            times=None if times is None else list(times),
            unit=first.stated("unit"),
            facts=mesh.facts_from_texts({"coordinates": first.stated("coordinate_system")}),
            notes=notes,
            ignored=first.ignored,
            coordinate_system=first.stated("coordinate_system"),
        )


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


def read_mesh(data: bytes, stated: Format | None, limits: ReadLimits) -> tuple[Frame, Format]:
    """Read a file that contains one mesh.

    Parameters
    ----------
    data : bytes
    stated : Format or None
        Recognised by content if None.
    limits : ReadLimits

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
    return _READERS[kind](data, limits), kind


T = TypeVar("T")


def read_frames(
    files: Sequence[T],
    read: Callable[[T], tuple[Frame, Format]],
    limits: ReadLimits,
    times: tuple[float, ...] | None = None,
    progress: Reporter | None = None,
) -> Reading:
    """Read frames and join them to one sequence.

    Parameters
    ----------
    files : sequence
        In the order of time: names of files, or whatever `read` takes.
    read : callable
        Reads one of them.
    limits : ReadLimits
    times : tuple of float, s, optional
        By default those that all frames state.
    progress : callable, optional

    Raises
    ------
    InputError
        It names the frame and its file.
    """
    limits.require(frames=len(files))
    stack: FrameStack | None = None
    for number, file in enumerate(reported(files, progress)):
        with in_frame(number, file if isinstance(file, str) else ""):
            frame, kind = read(file)
            if stack is None:
                stack = FrameStack(frame, kind, len(files), limits)
            else:
                stack.add(number, frame, kind)
    if stack is None:
        raise errors.MalformedFileError("There are no frames.", remedy="Send one file or more.")
    return stack.result(times)
