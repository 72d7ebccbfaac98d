"""VTKHDF PolyData over time: the HDF5 layout that ParaView opens (VTK file formats, 2.x).

Points of all steps are stored one after the other; "Steps" says where each begins, and where its
connectivity does, which may be the same for all.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ConnectivityError, MalformedFileError, ParameterError, ShapeError
from modalmotion.formats.frame import ONE_MESH, Triangles, triangulate
from modalmotion.formats.result import Parsed
from modalmotion.limits import ReadLimits
from modalmotion.mesh.checks import given_up
from modalmotion.mesh.sequence import MeshSequence

TOPOLOGIES: Final = ("Vertices", "Lines", "Polygons", "Strips")
"""Groups of cells, in the order of their columns in the offsets of steps."""

OURS: Final = "modalmotion"
"""Group beside "VTKHDF" for data that the format has no place for: unit, topology, grid."""

_POLYGONS: Final = TOPOLOGIES.index("Polygons")
malformed: Final = partial(
    MalformedFileError, remedy="Save the surface again as VTKHDF from ParaView or VTK."
)
"""Error for a file that is not as VTK writes it."""


def parse_vtkhdf(file: Any, limits: ReadLimits) -> Parsed:
    """Parse an open file that has passed the gate.

    Parameters
    ----------
    file : h5py.File
    limits : ReadLimits

    Returns
    -------
    info : dict
    arrays : dict of ndarray
        "vertices" (frames, vertices, 3), "faces" (faces, 3), maybe "times" (frames).

    Raises
    ------
    MalformedFileError
        If it is not PolyData of one part, or its offsets lead nowhere.
    ShapeError
        If a frame has another number of vertices.
    ConnectivityError
        If a frame has other faces than frame 0.
    """
    points = _points(file, limits)
    steps, polygons = points.steps, points.root["Polygons"]
    cells = _Cells(
        *(
            integers_of(polygons, name)
            for name in ("NumberOfCells", "NumberOfConnectivityIds", "Offsets", "Connectivity")
        )
    )
    if not points.n_parts == len(cells.n_cells) == len(cells.n_corners):
        raise malformed("The VTKHDF file's lists of parts differ.")
    faces = _same_faces(cells, steps, limits)
    if "Strips" in points.root and integers_of(points.root["Strips"], "NumberOfCells").any():
        raise MalformedFileError(
            "The VTKHDF file contains triangle strips.",
            remedy="Apply the filter 'Triangulate' and save again.",
        )
    arrays: dict[str, NDArray[Any]] = {
        "vertices": _positions(points, limits),
        "faces": faces.faces,
        **_times(points),
    }
    notes = list(faces.notes)
    if "times" in arrays and OURS not in file:
        notes.append("The format has no unit of time; its values were read as seconds.")
    info = {
        "format": "vtkhdf",
        "unit": points.stated("unit"),
        "topology": points.stated("topology"),
        "grid": np.atleast_1d(points.ours["grid"]).tolist() if "grid" in points.ours else None,
        "ignored": _ignored(points.root),
        "notes": notes,
    }
    return info, arrays


class _Points(NamedTuple):
    """Points of all steps, not yet read: where those of each step begin, and how many they are."""

    root: Any
    # What our own files state beside it.
    ours: Any
    dataset: Any
    sizes: NDArray[np.int64]
    steps: Steps
    n_parts: int

    def stated(self, name: str) -> str | None:
        return text_of(self.ours[name]) if name in self.ours else None


def _points(file: Any, limits: ReadLimits) -> _Points:
    root = file["VTKHDF"]
    kind = text_of(root.attrs.get("Type"))
    if kind != "PolyData":
        raise MalformedFileError(
            f"The VTKHDF file is of the type {kind[:40]!r}, not 'PolyData'.",
            remedy="Apply 'Extract Surface' in ParaView, and save again.",
        )
    n_points = integers_of(root, "NumberOfPoints")
    steps = steps_of(root, len(n_points))
    sizes = n_points[steps.parts]
    limits.require("frames", len(sizes))
    limits.require("vertices", int(sizes.max(initial=0)))
    dataset = root["Points"]
    if dataset.ndim != 2 or dataset.shape[1] != 3 or dataset.dtype.kind != "f":
        raise malformed(
            f"The VTKHDF file's points have the shape {dataset.shape} of {dataset.dtype}."
        )
    starts = steps.points
    if sizes.min() < 0 or starts.min() < 0 or int((starts + sizes).max()) > len(dataset):
        raise malformed(
            f"The VTKHDF file contains {len(dataset)} points, fewer than its steps name."
        )
    ours = file[OURS].attrs if OURS in file else {}
    return _Points(root, ours, dataset, sizes, steps, len(n_points))


def _times(points: _Points) -> dict[str, NDArray[np.float64]]:
    times = points.steps.times
    return {} if times is None or "times_unknown" in points.ours else {"times": times}


class Steps(NamedTuple):
    """Where each step begins: part, point, polygon, corner; (frames,) int64 each."""

    parts: NDArray[np.int64]
    points: NDArray[np.int64]
    cells: NDArray[np.int64]
    corners: NDArray[np.int64]
    times: NDArray[np.float64] | None


class _Cells(NamedTuple):
    n_cells: NDArray[np.int64]
    n_corners: NDArray[np.int64]
    offsets: NDArray[np.int64]
    corners: NDArray[np.int64]


def steps_of(root: Any, n_parts: int) -> Steps:
    """Read where each step begins; one step where there are none.

    Raises
    ------
    MalformedFileError
        If they do not fit one another, or have several parts.
    """
    if "Steps" not in root:
        if n_parts != 1:
            raise _several_parts(n_parts)
        zero = np.zeros(1, dtype=np.int64)
        return Steps(zero, zero, zero, zero, None)
    group = root["Steps"]
    n_steps = int(group.attrs["NSteps"])
    parts, points = (integers_of(group, f"{name}Offsets") for name in ("Part", "Point"))
    cells, corners = (
        integers_of(group, f"{name}Offsets", columns=len(TOPOLOGIES))[:, _POLYGONS]
        for name in ("Cell", "ConnectivityId")
    )
    times = np.asarray(group["Values"][()], dtype=np.float64)
    lengths = {len(a) for a in (parts, points, cells, corners, times)}
    if n_steps < 1 or lengths != {n_steps}:
        raise malformed(f"The VTKHDF file declares {n_steps} steps but lists {sorted(lengths)}.")
    if "NumberOfParts" in group and (several := integers_of(group, "NumberOfParts").max()) > 1:
        raise _several_parts(int(several))
    if parts.min() < 0 or parts.max() >= n_parts:
        raise malformed("A step of the VTKHDF file names no part.")
    return Steps(parts, points, cells, corners, times)


def _same_faces(cells: _Cells, steps: Steps, limits: ReadLimits) -> Triangles:
    limits.require("faces", int(cells.n_cells[steps.parts].max(initial=0)))
    sizes = cells.n_cells[steps.parts], cells.n_corners[steps.parts]
    # Each part before has one offset more than polygons, unless steps share theirs.
    places = np.stack([steps.cells + steps.parts, steps.corners, *sizes], axis=1)
    first: tuple[NDArray[np.int64], NDArray[np.int64]] | None = None
    known = None
    for frame, place in enumerate(places.tolist()):
        if place == known:
            continue
        start, corner, n_cells, n_corners = place
        offsets = cells.offsets[start : start + n_cells + 1] if start >= 0 else cells.offsets[:0]
        corners = cells.corners[corner : corner + n_corners] if corner >= 0 else cells.corners[:0]
        fits = len(offsets) == n_cells + 1 and len(corners) == n_corners
        if not fits or offsets[0] != 0 or offsets[-1] != n_corners or (np.diff(offsets) < 0).any():
            raise malformed(
                f"Frame {frame}: the polygons of the VTKHDF file do not add up to its lists.",
                frame=frame,
            )
        if first is None:
            first, known = (offsets, corners), place
        elif not (np.array_equal(first[0], offsets) and np.array_equal(first[1], corners)):
            raise ConnectivityError(
                f"Frame {frame} has other faces than frame 0.",
                remedy=ONE_MESH,
                frame=frame,
            )
    if first is None:
        raise malformed("The VTKHDF file contains no step.")
    return triangulate(*first)


def _positions(points: _Points, limits: ReadLimits) -> NDArray[Any]:
    n, starts = int(points.sizes[0]), points.steps.points
    different = np.flatnonzero(points.sizes != n)
    if different.size:
        frame = int(different[0])
        raise ShapeError(
            f"Frame {frame} has {points.sizes[frame]} vertices, frame 0 has {n}.",
            remedy=ONE_MESH,
            frame=frame,
        )
    dtype = np.dtype(np.float32 if points.dataset.dtype.itemsize == 4 else np.float64)
    # Steps may all name the same points, so this can be far more than the file declares.
    limits.require("decompressed_bytes", len(starts) * n * 3 * dtype.itemsize)
    # All at once: a chunk that contains many frames would be unpacked again for each of them.
    values = given_up(np.asarray(points.dataset[()], dtype=dtype))
    if np.array_equal(starts, n * np.arange(len(starts))):
        return values[: n * len(starts)].reshape(len(starts), n, 3)
    return np.stack([values[start : start + n] for start in starts.tolist()])


def integers_of(group: Any, name: str, columns: int | None = None) -> NDArray[np.int64]:
    """Read a list of whole numbers, or a table of so many columns."""
    dataset = group[name]
    fits = dataset.ndim == 1 if columns is None else dataset.shape[1:] == (columns,)
    if dataset.dtype.kind not in "iu" or not fits:
        raise malformed(
            f"The VTKHDF file's {name!r} has the shape {dataset.shape} of {dataset.dtype}."
        )
    return np.asarray(dataset[()], dtype=np.int64)


def _ignored(root: Any) -> list[str]:
    names = [
        f"{group}.{name}"
        for group in ("PointData", "CellData", "FieldData")
        if group in root
        for name in root[group]
    ]
    names += [
        group
        for group in ("Vertices", "Lines")
        if group in root and integers_of(root[group], "NumberOfCells").any()
    ]
    return names


def _several_parts(n_parts: int) -> MalformedFileError:
    return MalformedFileError(
        f"The VTKHDF file contains {n_parts} parts for one time.",
        remedy="Merge them ('Merge Blocks' or 'Append Geometry' in ParaView) and save again.",
    )


def text_of(value: Any) -> str:
    """Read an attribute as text."""
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    return str(value)


def parse_vtkhdf_clouds(file: Any, limits: ReadLimits) -> Parsed:
    """Parse the points of an open file that has passed the gate.

    Parameters
    ----------
    file : h5py.File
    limits : ReadLimits

    Returns
    -------
    info : dict
        The unit, if a file of ours states it.
    arrays : dict of ndarray
        "points" (n, 3) of all steps, "offsets" (frames + 1), the first row of each and the end,
        maybe "times" (frames).

    Raises
    ------
    MalformedFileError
        If it is not PolyData of one part, or its offsets lead nowhere.
    """
    points = _points(file, limits)
    sizes, starts = points.sizes, points.steps.points
    # Steps may all name the same points.
    limits.require("decompressed_bytes", 24 * int(sizes.sum()))
    values = np.asarray(points.dataset[()], dtype=np.float64)
    rows = [values[a : a + n] for a, n in zip(starts.tolist(), sizes.tolist(), strict=True)]
    offsets = np.concatenate([[0], np.cumsum(sizes)])
    arrays = {"points": np.concatenate(rows), "offsets": offsets, **_times(points)}
    return {"unit": points.stated("unit")}, arrays


# The first version that has PolyData over time.
_VERSION: Final = (2, 0)


def write_vtkhdf(
    sequence: MeshSequence,
    fields: Mapping[str, NDArray[Any]] | None = None,
    attributes: Mapping[str, str | int | float] | None = None,
) -> bytes:
    """Write a sequence as VTKHDF PolyData over time.

    Faces are written once for all frames. Frames without times have their numbers as times.
    Sequences without faces show as points.

    Parameters
    ----------
    sequence : MeshSequence
        A reconstruction, for example; its positions are written in their own type.
    fields : mapping of str to (frames, vertices) or (frames, vertices, k) ndarray, optional
        Values at the vertices, such as the error of a reconstruction, by name.
    attributes : mapping of str to str or number, optional
        Origin of the result; stored beside the data that VTK reads.

    Returns
    -------
    bytes
        The same for the same arguments.

    Raises
    ------
    ShapeError
        If a field does not have one value for each vertex of each frame.
    ParameterError
        If a field's name is empty or contains a slash.
    """
    import h5py

    fields = {} if fields is None else fields
    for name, values in fields.items():
        _require_field(name, values, sequence)
    n_frames, n_vertices = sequence.n_frames, sequence.n_vertices
    starts = np.arange(n_frames, dtype=np.int64) * n_vertices
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        root = file.create_group("VTKHDF")
        root.attrs["Version"] = _VERSION
        # VTK asks for text of fixed length.
        root.attrs["Type"] = np.bytes_(b"PolyData")
        root["NumberOfPoints"] = np.array([n_vertices], dtype=np.int64)
        root["Points"] = sequence.vertices.reshape(-1, 3)
        for name in TOPOLOGIES:
            _write_cells(root.create_group(name), _corners(name, sequence))
        steps = root.create_group("Steps")
        steps.attrs["NSteps"] = n_frames
        is_timed = sequence.times is not None
        steps["Values"] = sequence.times if is_timed else np.arange(n_frames, dtype=np.float64)
        steps["PointOffsets"] = starts
        # All steps share the one part and its cells.
        steps["PartOffsets"] = np.zeros(n_frames, dtype=np.int64)
        steps["NumberOfParts"] = np.ones(n_frames, dtype=np.int64)
        for name in ("CellOffsets", "ConnectivityIdOffsets"):
            steps[name] = np.zeros((n_frames, len(TOPOLOGIES)), dtype=np.int64)
        data = root.create_group("PointData")
        offsets = steps.create_group("PointDataOffsets")
        for name, values in fields.items():
            data[name] = values.reshape(n_frames * n_vertices, *values.shape[2:])
            offsets[name] = starts
        _write_ours(file.create_group(OURS), sequence, attributes or {})
    return buffer.getvalue()


def _corners(name: str, sequence: MeshSequence) -> NDArray[np.int64]:
    if name == "Polygons":
        return sequence.faces
    if name == "Vertices" and not len(sequence.faces):
        return np.arange(sequence.n_vertices, dtype=np.int64)[:, None]
    return np.zeros((0, 1), dtype=np.int64)


def _write_cells(group: Any, corners: NDArray[np.int64]) -> None:
    n_cells, size = corners.shape
    group["NumberOfCells"] = np.array([n_cells], dtype=np.int64)
    group["NumberOfConnectivityIds"] = np.array([n_cells * size], dtype=np.int64)
    group["Offsets"] = np.arange(n_cells + 1, dtype=np.int64) * size
    group["Connectivity"] = corners.ravel()


def _write_ours(
    group: Any, sequence: MeshSequence, attributes: Mapping[str, str | int | float]
) -> None:
    stated: dict[str, Any] = {
        **attributes,
        "unit": sequence.unit,
        "topology": None if sequence.topology is None else sequence.topology.name,
        "grid": None if sequence.grid is None else np.array(sequence.grid, dtype=np.int64),
        "times_unknown": 1 if sequence.times is None else None,
    }
    for name, value in stated.items():
        if value is not None:
            group.attrs[name] = np.bytes_(value.encode()) if isinstance(value, str) else value


def _require_field(name: str, values: NDArray[Any], sequence: MeshSequence) -> None:
    if not name or "/" in name or name == ".":
        raise ParameterError(f"A field is called {name!r}.", remedy="Use a name without slashes.")
    expected = (sequence.n_frames, sequence.n_vertices)
    if values.shape[:2] != expected or values.ndim > 3 or values.dtype.kind not in "fiu":
        raise ShapeError(
            f"The field {name!r} has the shape {values.shape} of {values.dtype}; the sequence "
            f"has {expected[0]} frames of {expected[1]} vertices.",
            remedy="Give one number, or a few, for each vertex of each frame.",
            details={"field": name, "shape": list(values.shape)},
        )
