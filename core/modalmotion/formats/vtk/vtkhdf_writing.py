"""Writing VTKHDF PolyData over time, with fields, for ParaView and VTK."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ParameterError, ShapeError
from modalmotion.formats.vtk.vtkhdf import OURS, TOPOLOGIES
from modalmotion.mesh.sequence import MeshSequence

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
