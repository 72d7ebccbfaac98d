"""Legacy .vtk and .vtp surfaces through VTK's own readers, from bytes in memory.

Imported only inside the process of `parser.child`: VTK can crash the process it runs in.
"""

from __future__ import annotations

from functools import partial
from importlib import import_module
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import MalformedFileError
from modalmotion.formats.frame import space_in
from modalmotion.formats.result import Parsed
from modalmotion.limits import ReadLimits

_malformed: Final = partial(
    MalformedFileError, remedy="Save the frame again as a polygonal surface (vtkPolyData)."
)
# The first two lines are short, and the third and fourth.
_HEAD: Final = 1024
# ParaView stores the time of a frame under this name.
_TIME: Final = "TimeValue"
# Cells of an unstructured grid, by VTK's numbers: vertices and lines are left out as of a surface.
_POLYGONS: Final = (5, 7, 9)
_NO_FACES: Final = (1, 2, 3, 4)


def parse_legacy(data: bytes, limits: ReadLimits) -> Parsed:
    """Read a legacy .vtk file (text or binary)."""
    is_grid = b"unstructured_grid" in data[:_HEAD].lower()
    kind = "UnstructuredGrid" if is_grid else "PolyData"
    reader = getattr(_module("vtkIOLegacy"), f"vtk{kind}Reader")()
    reader.ReadFromInputStringOn()
    reader.SetBinaryInputString(data, len(data))
    return _parse(reader, limits)


def parse_xml(data: bytes, limits: ReadLimits) -> Parsed:
    """Read a .vtp file."""
    reader = _module("vtkIOXML").vtkXMLPolyDataReader()
    reader.ReadFromInputStringOn()
    reader.SetInputString(data)
    return _parse(reader, limits)


def parse_xml_grid(data: bytes, limits: ReadLimits) -> Parsed:
    """Read a .vtu file, of polygons."""
    reader = _module("vtkIOXML").vtkXMLUnstructuredGridReader()
    reader.ReadFromInputStringOn()
    reader.SetInputString(data)
    return _parse(reader, limits)


def _parse(reader: Any, limits: ReadLimits) -> Parsed:
    vtk_to_numpy = _module("util.numpy_support").vtk_to_numpy
    core = _module("vtkCommonCore")
    # VTK's log is coloured text on standard error, with pieces of the file.
    core.vtkLogger.SetStderrVerbosity(core.vtkLogger.VERBOSITY_OFF)
    log = core.vtkStringOutputWindow()
    core.vtkOutputWindow.SetInstance(log)
    reader.Update()
    # A reader that meets an error returns partial data, the rest being uninitialised memory.
    if (text := str(log.GetOutput())).strip():
        raise _malformed(f"VTK cannot read the file: {_last_words(text)}.")
    surface = reader.GetOutput()
    n_points = surface.GetNumberOfPoints()
    if n_points == 0:
        raise _malformed("The VTK file contains no points.")
    limits.require("vertices", n_points)
    is_grid = surface.IsA("vtkUnstructuredGrid")
    polygons = surface.GetCells() if is_grid else surface.GetPolys()
    limits.require("faces", polygons.GetNumberOfCells())
    if not is_grid and surface.GetNumberOfStrips():
        raise MalformedFileError(
            "The VTK file contains triangle strips.",
            remedy="Apply the filter 'Triangulate' and save again.",
        )
    points = vtk_to_numpy(surface.GetPoints().GetData())
    offsets = vtk_to_numpy(polygons.GetOffsetsArray()).astype(np.int64)
    corners = vtk_to_numpy(polygons.GetConnectivityArray()).astype(np.int64)
    if len(offsets) == 0:
        offsets = np.zeros(1, dtype=np.int64)
    _require_offsets(offsets, corners)
    ignored = _ignored(surface)
    if is_grid and len(offsets) > 1:
        types = vtk_to_numpy(surface.GetCellTypes())
        are_faces, sizes = np.isin(types, _POLYGONS), np.diff(offsets)
        if not (are_faces | np.isin(types, _NO_FACES)).all():
            raise MalformedFileError(
                "The VTK file's grid has cells that are no polygons.",
                remedy="Apply the filter 'Extract Surface' and save again.",
            )
        corners = corners[np.repeat(are_faces, sizes)]
        offsets = np.concatenate([[0], np.cumsum(sizes[are_faces])])
        ignored += [] if are_faces.all() else ["vertices or lines"]
    arrays = {
        "positions": points if points.dtype == np.float32 else points.astype(np.float64),
        "offsets": offsets,
        "corners": corners,
    }
    return {"ignored": ignored, "statements": _statements(reader, surface)}, arrays


def _module(name: str) -> Any:
    # The package is an extra: other code must not need it, the type checker included.
    return import_module(f"vtkmodules.{name}")


def _require_offsets(offsets: NDArray[np.int64], corners: NDArray[np.int64]) -> None:
    if offsets[0] != 0 or offsets[-1] != len(corners) or (np.diff(offsets) < 0).any():
        raise _malformed("The VTK file's polygons do not add up to its list of corners.")


def _ignored(surface: Any) -> list[str]:
    names = []
    for kind, data in (("point", surface.GetPointData()), ("cell", surface.GetCellData())):
        names += [f"{kind}.{data.GetArrayName(i)}" for i in range(data.GetNumberOfArrays())]
    if surface.IsA("vtkPolyData"):
        names += ["vertices"] * bool(surface.GetNumberOfVerts())
        names += ["lines"] * bool(surface.GetNumberOfLines())
    return names


def _statements(reader: Any, surface: Any) -> list[tuple[str, str]]:
    header = str(reader.GetHeader() or "") if hasattr(reader, "GetHeader") else ""
    field = surface.GetFieldData()
    space = field.GetAbstractArray("SPACE")
    if space is not None and space.GetNumberOfValues():
        header += f" SPACE={space.GetVariantValue(0).ToString()}"
    statements = list(space_in(header.encode()))
    time = field.GetArray(_TIME)
    if time is not None and time.GetNumberOfValues() == 1:
        statements.append(("time", repr(float(time.GetTuple1(0)))))
    return statements


def _last_words(text: str) -> str:
    # A line with the place in VTK's source, then the reader and its address, a colon, the words.
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    message = lines[1] if len(lines) > 1 else lines[0]
    return message.rpartition("): ")[2].rstrip(".")[:120]
