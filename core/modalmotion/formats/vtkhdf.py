"""VTKHDF PolyData over time: the HDF5 layout that ParaView opens (VTK file formats, 2.x).

Points of all steps are stored one after the other; "Steps" says where each begins, and where its
connectivity does, which may be the same for all.
"""

import io
from collections.abc import Mapping
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np

from modalmotion import errors, mesh
from modalmotion.formats.frame import NOTHING_TO_TRACK, ONE_MESH, Triangles, triangulate
from modalmotion.formats.named_arrays import parse_datasets as parse_named
from modalmotion.formats.result import Parsed
from modalmotion.hdf5 import image, sealed
from modalmotion.limits import ReadLimits
from modalmotion.mesh import checks
from modalmotion.mesh.sequence import FORM, TRACK, MeshSequence, sequence_from_hdf5
from modalmotion.notes import Note, notes_as_json
from modalmotion.representation import Array, Floats, Ints

_TOPOLOGIES: Final = ("Vertices", "Lines", "Polygons", "Strips")
"""Groups of cells, in the order of their columns in the offsets of steps."""

_OURS: Final = "modalmotion"
"""Group beside "VTKHDF" for data that the format has no place for: unit, topology, grid."""

_OTHERS: Final = ("Vertices", "Lines", "Strips")
_POLYGONS: Final = _TOPOLOGIES.index("Polygons")
_malformed: Final = partial(
    errors.MalformedFileError, remedy="Save the surface again as VTKHDF from ParaView or VTK."
)


class _Surface(NamedTuple):
    """Where each step begins: part, point, polygon, corner; (frames,) int64 each."""

    root: Any
    # What our own files state beside it.
    ours: Any
    # Of the points of each step, which are not read yet.
    sizes: Ints
    points: Ints
    parts: Ints
    cells: Ints
    corners: Ints
    times: dict[str, Floats]

    def stated(self, name: str) -> str | None:
        return _text(self.ours[name]) if name in self.ours else None


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
    surface = _surface(file, limits)
    root, ours = surface.root, surface.ours
    faces = _same_faces(surface, limits)
    skipped = {name: _integers(root[name], "NumberOfCells").any() for name in root.keys() & _OTHERS}
    if skipped.pop("Strips", False):
        raise errors.MalformedFileError(
            "The VTKHDF file contains triangle strips.",
            remedy="Apply the filter 'Triangulate' and save again.",
        )
    notes = list(faces.notes)
    if surface.times and _OURS not in file:
        notes.append(Note.of("vtkhdf_time_unit_unknown"))
    groups = (name for name in ("PointData", "CellData", "FieldData") if name in root)
    info = {
        "format": "vtkhdf",
        "unit": surface.stated("unit"),
        "topology": surface.stated("topology"),
        "grid": np.atleast_1d(ours["grid"]).tolist() if "grid" in ours else None,
        "ignored": [
            *(f"{group}.{name}" for group in groups for name in root[group]),
            *(name for name in _OTHERS if skipped.get(name)),
        ],
        "notes": notes_as_json(notes),
    }
    vertices = _positions(surface, limits)
    return info, {"vertices": vertices, "faces": faces.faces, **surface.times}


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
    surface = _surface(file, limits)
    sizes = surface.sizes
    # Steps may all name the same points.
    limits.require(decompressed_bytes=24 * int(sizes.sum()))
    values = np.asarray(surface.root["Points"][()], dtype=np.float64)
    places = zip(surface.points.tolist(), sizes.tolist(), strict=True)
    points = np.concatenate([values[start : start + n] for start, n in places])
    offsets = np.concatenate([[0], np.cumsum(sizes)])
    arrays = {"points": points, "offsets": offsets, **surface.times}
    return {"unit": surface.stated("unit")}, arrays


def _surface(file: Any, limits: ReadLimits) -> _Surface:
    root, ours = file["VTKHDF"], file[_OURS].attrs if _OURS in file else {}
    if (kind := _text(root.attrs.get("Type"))) != "PolyData":
        raise errors.MalformedFileError(
            f"The VTKHDF file is of the type {kind[:40]!r}, not 'PolyData'.",
            remedy="Apply 'Extract Surface' in ParaView, and save again.",
        )
    n_points = _integers(root, "NumberOfPoints")
    parts = points = cells = corners = np.zeros(1, dtype=np.int64)
    times, n_parts = {}, len(n_points)
    if "Steps" in root:
        group = root["Steps"]
        parts, points = (_integers(group, f"{name}Offsets") for name in ("Part", "Point"))
        cells, corners = (
            _integers(group, f"{name}Offsets", len(_TOPOLOGIES))[:, _POLYGONS]
            for name in ("Cell", "ConnectivityId")
        )
        values = np.asarray(group["Values"][()], dtype=np.float64)
        lengths = {int(group.attrs["NSteps"]), *map(len, (parts, points, cells, corners, values))}
        if len(lengths) > 1 or 0 in lengths:
            raise _malformed(
                f"The VTKHDF file's lists of steps have the lengths {sorted(lengths)}."
            )
        n_parts = int(_integers(group, "NumberOfParts").max()) if "NumberOfParts" in group else 1
        times = {} if "times_unknown" in ours else {"times": values}
    if n_parts > 1:
        raise errors.MalformedFileError(
            f"The VTKHDF file contains {n_parts} parts for one time.",
            remedy="Merge them ('Merge Blocks' or 'Append Geometry' in ParaView) and save again.",
        )
    if parts.min() < 0 or parts.max() >= len(n_points):
        raise _malformed("A step of the VTKHDF file names no part.")
    sizes = n_points[parts]
    limits.require(frames=len(sizes), vertices=int(sizes.max()))
    found = root["Points"]
    if found.ndim != 2 or found.shape[1] != 3 or found.dtype.kind != "f":
        raise _malformed(f"The VTKHDF file's points have the shape {found.shape} of {found.dtype}.")
    if min(sizes.min(), points.min()) < 0 or int((points + sizes).max()) > len(found):
        raise _malformed(
            f"The VTKHDF file contains {len(found)} points, fewer than its steps name."
        )
    return _Surface(root, ours, sizes, points, parts, cells, corners, times)


def _same_faces(surface: _Surface, limits: ReadLimits) -> Triangles:
    polygons, parts = surface.root["Polygons"], surface.parts
    n_cells, n_corners, offsets, corners = (
        _integers(polygons, name)
        for name in ("NumberOfCells", "NumberOfConnectivityIds", "Offsets", "Connectivity")
    )
    if not len(_integers(surface.root, "NumberOfPoints")) == len(n_cells) == len(n_corners):
        raise _malformed("The VTKHDF file's lists of parts differ.")
    limits.require(faces=int(n_cells[parts].max()))
    # Each part before has one offset more than polygons, unless steps share theirs.
    starts = (surface.cells + parts, surface.corners, n_cells[parts], n_corners[parts])
    places = np.stack(starts, axis=1)
    first: list[Ints] = []
    for frame in np.sort(np.unique(places, axis=0, return_index=True)[1]).tolist():
        start, corner, n, m = places[frame].tolist()
        own = [offsets[max(start, 0) : start + n + 1], corners[max(corner, 0) : corner + m]]
        fits = min(start, corner) >= 0 and [*map(len, own)] == [n + 1, m]
        if not fits or (own[0][0], own[0][-1]) != (0, m) or (np.diff(own[0]) < 0).any():
            raise _malformed(
                f"Frame {frame}: the polygons of the VTKHDF file do not add up to its lists.",
                frame=frame,
            )
        first = first or own
        if not all(map(np.array_equal, first, own)):
            raise errors.ConnectivityError(
                f"Frame {frame} has other faces than frame 0.", remedy=ONE_MESH, frame=frame
            )
    return triangulate(np.diff(first[0]), first[1], limits)


def _positions(surface: _Surface, limits: ReadLimits) -> Array:
    n, starts, dataset = int(surface.sizes[0]), surface.points, surface.root["Points"]
    for frame in np.flatnonzero(surface.sizes != n).tolist():
        raise errors.ShapeError(
            f"Frame {frame} has {surface.sizes[frame]} vertices, frame 0 has {n}.",
            remedy=ONE_MESH,
            frame=frame,
        )
    dtype = np.dtype(np.float32 if dataset.dtype.itemsize == 4 else np.float64)
    # Steps may all name the same points, so this can be far more than the file declares.
    limits.require(decompressed_bytes=len(starts) * n * 3 * dtype.itemsize)
    # All at once: a chunk that contains many frames would be unpacked again for each of them.
    values = checks.given_up(np.asarray(dataset[()], dtype=dtype))
    if np.array_equal(starts, n * np.arange(len(starts))):
        return values[: n * len(starts)].reshape(len(starts), n, 3)
    return np.stack([values[start : start + n] for start in starts.tolist()])


def _integers(group: Any, name: str, columns: int | None = None) -> Ints:
    """Read a list of whole numbers, or a table of so many columns."""
    dataset = group[name]
    fits = dataset.ndim == 1 if columns is None else dataset.shape[1:] == (columns,)
    if dataset.dtype.kind not in "iu" or not fits:
        raise _malformed(
            f"The VTKHDF file's {name!r} has the shape {dataset.shape} of {dataset.dtype}."
        )
    return np.asarray(dataset[()], dtype=np.int64)


def _text(value: Any) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


# The first version that has PolyData over time.
_VERSION: Final = (2, 0)


def write_vtkhdf(
    sequence: MeshSequence,
    fields: Mapping[str, Array] | None = None,
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
        cells = {name: np.zeros((0, 1), dtype=np.int64) for name in _TOPOLOGIES}
        cells["Polygons"] = sequence.faces
        if not len(sequence.faces):
            cells["Vertices"] = np.arange(n_vertices, dtype=np.int64)[:, None]
        for name, corners in cells.items():
            group, (n_cells, size) = root.create_group(name), corners.shape
            group["NumberOfCells"] = np.array([n_cells], dtype=np.int64)
            group["NumberOfConnectivityIds"] = np.array([n_cells * size], dtype=np.int64)
            group["Offsets"] = np.arange(n_cells + 1, dtype=np.int64) * size
            group["Connectivity"] = corners.ravel()
        steps = root.create_group("Steps")
        steps.attrs["NSteps"] = n_frames
        is_timed = sequence.times is not None
        steps["Values"] = sequence.times if is_timed else np.arange(n_frames, dtype=np.float64)
        steps["PointOffsets"] = starts
        # All steps share the one part and its cells.
        steps["PartOffsets"] = np.zeros(n_frames, dtype=np.int64)
        steps["NumberOfParts"] = np.ones(n_frames, dtype=np.int64)
        for name in ("CellOffsets", "ConnectivityIdOffsets"):
            steps[name] = np.zeros((n_frames, len(_TOPOLOGIES)), dtype=np.int64)
        data = root.create_group("PointData")
        offsets = steps.create_group("PointDataOffsets")
        for name, values in fields.items():
            data[name] = values.reshape(n_frames * n_vertices, *values.shape[2:])
            offsets[name] = starts
        stated: dict[str, Any] = {
            **(attributes or {}),
            "unit": sequence.unit,
            "topology": None if sequence.topology is None else sequence.topology.name,
            "grid": None if sequence.grid is None else np.array(sequence.grid, dtype=np.int64),
            "times_unknown": None if is_timed else 1,
        }
        ours = file.create_group(_OURS).attrs
        for name, value in stated.items():
            if value is not None:
                ours[name] = np.bytes_(value.encode()) if isinstance(value, str) else value
    return buffer.getvalue()


def _require_field(name: str, values: Array, sequence: MeshSequence) -> None:
    if not name or "/" in name or name == ".":
        raise errors.ParameterError(
            f"A field is called {name!r}.", remedy="Use a name without slashes."
        )
    expected = (sequence.n_frames, sequence.n_vertices)
    if values.shape[:2] != expected or values.ndim > 3 or values.dtype.kind not in "fiu":
        raise errors.ShapeError(
            f"The field {name!r} has the shape {values.shape} of {values.dtype}; the sequence "
            f"has {expected[0]} frames of {expected[1]} vertices.",
            remedy="Give one number, or a few, for each vertex of each frame.",
        )


_STORED: Final = "modalmotion."
_OF_TRACK: Final = Note.of("read_as_surface")


def parse_hdf5(data: bytes, limits: ReadLimits) -> Parsed:
    """Parse VTKHDF PolyData, a file of the store's, or named datasets, after `open_gated`."""
    with sealed.open_gated(data, limits) as file:
        if "VTKHDF" in file:
            return parse_vtkhdf(file, limits)
        schema = file.attrs.get("schema")
        text = schema.decode("utf-8", "replace") if isinstance(schema, bytes) else str(schema)
        if not text.startswith(_STORED):
            return parse_named(file, limits)
    return _parse_ours(data, limits, TRACK if text == f"{_STORED}{TRACK.kind}" else FORM)


def parse_datasets(data: bytes, limits: ReadLimits) -> Parsed:
    """Give all datasets of numbers in an HDF5 file by their paths, in this process."""
    arrays: dict[str, Array] = {}

    def take(name: str, value: Any) -> None:
        if getattr(value, "shape", None) is not None and value.dtype.kind in "fiu":
            arrays[name] = value[()]

    with sealed.open_gated(data, limits) as file:
        file.visititems(take)
    return {}, arrays


def parse_clouds(data: bytes, limits: ReadLimits) -> Parsed:
    """Parse the points of a VTKHDF file in this process: see `parse_vtkhdf_clouds`."""
    with sealed.open_gated(data, limits) as file:
        if "VTKHDF" in file:
            return parse_vtkhdf_clouds(file, limits)
    raise errors.MalformedFileError(
        "The HDF5 file contains no group 'VTKHDF'.",
        remedy=f"Send VTKHDF PolyData, or npz. {NOTHING_TO_TRACK}",
    )


def _parse_ours(data: bytes, limits: ReadLimits, form: image.Form) -> Parsed:
    try:
        sequence = sequence_from_hdf5(data, form)
    except errors.StoreError as error:
        raise errors.MalformedFileError(error.message, remedy=error.remedy) from error
    limits.require(
        frames=sequence.n_frames, vertices=sequence.n_vertices, faces=len(sequence.faces)
    )
    arrays: dict[str, Array] = {"vertices": sequence.vertices, "faces": sequence.faces}
    if sequence.times is not None:
        arrays["times"] = sequence.times
    info: dict[str, Any] = {
        "format": "hdf5",
        "unit": sequence.unit,
        "topology": None if sequence.topology is None else sequence.topology.name,
        "grid": sequence.grid,
        "facts": mesh.facts_as_json(sequence.facts),
        "ignored": [],
        "notes": notes_as_json([_OF_TRACK] if form == TRACK else []),
    }
    return info, arrays
