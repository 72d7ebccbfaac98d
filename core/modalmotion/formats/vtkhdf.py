"""VTKHDF PolyData over time: the HDF5 layout that ParaView opens (VTK file formats, 2.x).

Points of all steps are stored one after the other; "Steps" says where each begins, and where its
connectivity does, which may be the same for all.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

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
    root = file["VTKHDF"]
    require_poly_data(root)
    n_points = integers_of(root, "NumberOfPoints")
    steps = steps_of(root, len(n_points))
    limits.require("frames", len(steps.parts))
    limits.require("vertices", int(n_points[steps.parts].max(initial=0)))
    polygons = root["Polygons"]
    cells = _Cells(
        n_cells=integers_of(polygons, "NumberOfCells"),
        n_corners=integers_of(polygons, "NumberOfConnectivityIds"),
        offsets=integers_of(polygons, "Offsets"),
        corners=integers_of(polygons, "Connectivity"),
    )
    if not len(n_points) == len(cells.n_cells) == len(cells.n_corners):
        raise malformed("The VTKHDF file's lists of parts differ.")
    faces = _same_faces(cells, steps, limits)
    vertices = _positions(points_of(root), n_points[steps.parts], steps.points, limits)
    if "Strips" in root and integers_of(root["Strips"], "NumberOfCells").any():
        raise MalformedFileError(
            "The VTKHDF file contains triangle strips.",
            remedy="Apply the filter 'Triangulate' and save again.",
        )
    arrays: dict[str, NDArray[Any]] = {"vertices": vertices, "faces": faces.faces}
    ours = file[OURS].attrs if OURS in file else {}
    notes = list(faces.notes)
    if steps.times is not None and "times_unknown" not in ours:
        arrays["times"] = steps.times
        if OURS not in file:
            notes.append("The format has no unit of time; its values were read as seconds.")
    info = {
        "format": "vtkhdf",
        "unit": text_of(ours["unit"]) if "unit" in ours else None,
        "topology": text_of(ours["topology"]) if "topology" in ours else None,
        "grid": [int(n) for n in np.atleast_1d(ours["grid"])] if "grid" in ours else None,
        "ignored": _ignored(root),
        "notes": notes,
    }
    return info, arrays


def points_of(root: Any) -> Any:
    """Give the dataset of points, which are numbers in threes."""
    points = root["Points"]
    if points.ndim != 2 or points.shape[1] != 3 or points.dtype.kind != "f":
        raise malformed(
            f"The VTKHDF file's points have the shape {points.shape} of {points.dtype}."
        )
    return points


def require_poly_data(root: Any) -> None:
    """Refuse what is not PolyData."""
    kind = text_of(root.attrs.get("Type"))
    if kind != "PolyData":
        raise MalformedFileError(
            f"The VTKHDF file is of the type {kind[:40]!r}, not 'PolyData'.",
            remedy="Apply 'Extract Surface' in ParaView, and save again.",
        )


@dataclass(frozen=True, eq=False)
class Steps:
    """Where each step begins: part, point, polygon, corner; (frames,) int64 each."""

    parts: NDArray[np.int64]
    points: NDArray[np.int64]
    cells: NDArray[np.int64]
    corners: NDArray[np.int64]
    times: NDArray[np.float64] | None


@dataclass(frozen=True, eq=False)
class _Cells:
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
    parts = integers_of(group, "PartOffsets")
    points = integers_of(group, "PointOffsets")
    cells = integers_of(group, "CellOffsets", columns=len(TOPOLOGIES))[:, _POLYGONS]
    corners = integers_of(group, "ConnectivityIdOffsets", columns=len(TOPOLOGIES))[:, _POLYGONS]
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
    places = zip(
        steps.cells.tolist(),
        steps.corners.tolist(),
        steps.parts.tolist(),
        cells.n_cells[steps.parts].tolist(),
        cells.n_corners[steps.parts].tolist(),
        strict=True,
    )
    first: tuple[NDArray[np.int64], NDArray[np.int64]] | None = None
    known = None
    for frame, (cell, corner, part, n_cells, n_corners) in enumerate(places):
        # Each part before has one offset more than polygons, unless steps share theirs.
        start = cell + part
        if (place := (start, corner, n_cells, n_corners)) == known:
            continue
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


def _positions(
    points: Any, n_points: NDArray[np.int64], starts: NDArray[np.int64], limits: ReadLimits
) -> NDArray[Any]:
    different = np.flatnonzero(n_points != n_points[0])
    if different.size:
        frame = int(different[0])
        raise ShapeError(
            f"Frame {frame} has {n_points[frame]} vertices, frame 0 has {n_points[0]}.",
            remedy=ONE_MESH,
            frame=frame,
        )
    n = int(n_points[0])
    if n < 0 or starts.min() < 0 or int(starts.max()) + n > len(points):
        raise malformed(
            f"The VTKHDF file contains {len(points)} points, fewer than its steps name."
        )
    dtype = np.dtype(np.float32 if points.dtype.itemsize == 4 else np.float64)
    # Steps may all name the same points, so this can be far more than the file declares.
    limits.require("decompressed_bytes", len(starts) * n * 3 * dtype.itemsize)
    # All at once: a chunk that contains many frames would be unpacked again for each of them.
    values = given_up(np.asarray(points[()], dtype=dtype))
    if np.array_equal(starts, n * np.arange(len(starts))):
        return values[: n * len(starts)].reshape(len(starts), n, 3)
    vertices = np.empty((len(starts), n, 3), dtype)
    for frame, start in enumerate(starts.tolist()):
        vertices[frame] = values[start : start + n]
    return vertices


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
    root = file["VTKHDF"]
    require_poly_data(root)
    n_points = integers_of(root, "NumberOfPoints")
    steps = steps_of(root, len(n_points))
    limits.require("frames", len(steps.parts))
    sizes = n_points[steps.parts]
    limits.require("vertices", int(sizes.max(initial=0)))
    points, starts = points_of(root), steps.points
    if sizes.min() < 0 or starts.min() < 0 or int((starts + sizes).max()) > len(points):
        raise malformed(
            f"The VTKHDF file contains {len(points)} points, fewer than its steps name."
        )
    # Steps may all name the same points.
    limits.require("decompressed_bytes", 24 * int(sizes.sum()))
    values = np.asarray(points[()], dtype=np.float64)
    rows = [values[a : a + n] for a, n in zip(starts.tolist(), sizes.tolist(), strict=True)]
    arrays: dict[str, NDArray[Any]] = {
        "points": np.concatenate(rows),
        "offsets": np.concatenate([[0], np.cumsum(sizes)]),
    }
    ours = file[OURS].attrs if OURS in file else {}
    if steps.times is not None and "times_unknown" not in ours:
        arrays["times"] = steps.times
    return {"unit": text_of(ours["unit"]) if "unit" in ours else None}, arrays


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
    for name, value in attributes.items():
        group.attrs[name] = np.bytes_(value.encode()) if isinstance(value, str) else value
    if sequence.unit is not None:
        group.attrs["unit"] = np.bytes_(sequence.unit.encode())
    if sequence.topology is not None:
        group.attrs["topology"] = np.bytes_(sequence.topology.name.encode())
    if sequence.grid is not None:
        group.attrs["grid"] = np.array(sequence.grid, dtype=np.int64)
    if sequence.times is None:
        group.attrs["times_unknown"] = 1


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
