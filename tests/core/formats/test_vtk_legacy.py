"""Legacy .vtk, .vtp and .vtu frames: the same as VTK itself reads, or refused."""

from __future__ import annotations

import sys
import warnings
import zipfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from format_samples import (
    FACES,
    N_FRAMES,
    VERTICES,
    VTK_WRITERS,
    frame_zip,
    pvd,
    vtk_text,
    vtp_text,
    zipped,
)

from modalmotion.errors import InputError, LimitError, MalformedFileError
from modalmotion.formats import ParserProcess, ReadLimits, ReadOptions, read_sequence
from modalmotion.formats.vtk_legacy import numbers_in
from modalmotion.representation import FloatArray

MIXED = [*FACES.tolist(), [0, 1, 2, 3]]


def vtk(name: str) -> Any:
    return import_module(f"vtkmodules.{name}")


@pytest.fixture(scope="module")
def parser() -> Iterator[ParserProcess]:
    with ParserProcess(ReadLimits(decompressed_bytes=100_000_000), seconds=30) as process:
        yield process


@pytest.mark.parametrize("name", VTK_WRITERS)
def test_a_zip_of_frames_is_a_sequence(name: str, parser: ParserProcess) -> None:
    suffix, write = VTK_WRITERS[name]
    read = read_sequence(frame_zip(write, suffix), parser=parser)
    assert np.array_equal(read.sequence.vertices, VERTICES)
    assert np.array_equal(read.sequence.faces, FACES)
    assert read.format == suffix


@pytest.mark.parametrize("write", [vtk_text, vtp_text])
def test_polygons_become_fans_from_their_first_corner(
    write: Callable[..., bytes], parser: ParserProcess
) -> None:
    read = read_sequence(write(VERTICES[0], MIXED), parser=parser)
    assert read.sequence.faces[len(FACES) :].tolist() == [[0, 1, 2], [0, 2, 3]]
    assert "(1)" in read.notes[0]


def surface(positions: np.ndarray[Any, Any], faces: np.ndarray[Any, Any]) -> Any:
    numpy_support = vtk("util.numpy_support")
    points, cells = vtk("vtkCommonCore").vtkPoints(), vtk("vtkCommonDataModel").vtkCellArray()
    points.SetData(numpy_support.numpy_to_vtk(positions, deep=1))
    cells.SetData(3, numpy_support.numpy_to_vtkIdTypeArray(faces.ravel().copy(), deep=1))
    made = vtk("vtkCommonDataModel").vtkPolyData()
    made.SetPoints(points)
    made.SetPolys(cells)
    return made


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize(
    ("module", "writer", "mode"),
    [
        ("vtkIOLegacy", "vtkPolyDataWriter", "SetFileTypeToASCII"),
        ("vtkIOLegacy", "vtkPolyDataWriter", "SetFileTypeToBinary"),
        ("vtkIOXML", "vtkXMLPolyDataWriter", "SetDataModeToAscii"),
        ("vtkIOXML", "vtkXMLPolyDataWriter", "SetDataModeToBinary"),
        ("vtkIOXML", "vtkXMLPolyDataWriter", "SetDataModeToAppended"),
    ],
)
def test_the_formats_own_library_reads_the_same_bits(
    tmp_path: Path, module: str, writer: str, mode: str, dtype: type, parser: ParserProcess
) -> None:
    positions: FloatArray = np.random.default_rng(4).normal(scale=50, size=(12, 3)).astype(dtype)
    path = tmp_path / "frame"
    write = getattr(vtk(module), writer)()
    write.SetInputData(surface(positions, FACES))
    write.SetFileName(str(path))
    getattr(write, mode)()
    write.Write()
    reader = getattr(vtk(module), writer.replace("Writer", "Reader"))()
    reader.SetFileName(str(path))
    reader.Update()
    to_numpy = vtk("util.numpy_support").vtk_to_numpy
    read = read_sequence(path, parser=parser).sequence
    assert np.array_equal(read.vertices[0], to_numpy(reader.GetOutput().GetPoints().GetData()))
    assert read.vertices.dtype == dtype
    corners = to_numpy(reader.GetOutput().GetPolys().GetConnectivityArray())
    assert np.array_equal(read.faces.ravel(), corners)


FIELD = """<FieldData><Array type="String" Name="SPACE" NumberOfTuples="1" format="ascii">
76 80 83 0</Array><DataArray type="Float64" Name="TimeValue" NumberOfTuples="1" format="ascii">
{}</DataArray></FieldData>"""


def test_time_and_coordinate_system_of_each_frame_are_read(parser: ParserProcess) -> None:
    members = {
        f"{i}.vtp": vtp_text(VERTICES[i], field=FIELD.format(0.25 * i)) for i in range(N_FRAMES)
    }
    read = read_sequence(zipped(members), parser=parser)
    assert read.coordinate_system == "LPS"
    assert read.sequence.times is not None
    assert read.sequence.times.tolist() == [0.0, 0.25, 0.5]
    listed = zipped(members | {"x.pvd": pvd([(float(i), f"{i}.vtp") for i in range(3)])})
    times = read_sequence(listed, parser=parser).sequence.times
    assert times is not None
    assert times.tolist() == [0.0, 1.0, 2.0]


def test_the_title_of_a_legacy_file_states_the_coordinate_system(parser: ParserProcess) -> None:
    data = vtk_text(VERTICES[0]).replace(b"made by a test", b"3D Slicer output. SPACE=RAS")
    assert read_sequence(data, parser=parser).coordinate_system == "RAS"


DOCTYPE = b"<!DOCTYPE VTKFile [<!ENTITY a SYSTEM 'file:///etc/passwd'>]><VTKFile"


@pytest.mark.parametrize(
    ("data", "error", "words"),
    [
        (vtk_text(VERTICES[0])[:300], MalformedFileError, "declares 36 numbers"),
        (vtk_text(VERTICES[0]).replace(b"POINTS 12", b"POINTS 13"), MalformedFileError, "VTK"),
        (vtk_text(VERTICES[0]).replace(b"POINTS 12", b"POINTS 11"), MalformedFileError, "VTK"),
        (vtk_text(VERTICES[0]).replace(b"POINTS 12", b"POINTS 1000000000"), LimitError, "vertices"),
        (vtk_text(VERTICES[0]).replace(b"POLYGONS 12", b"POLYGONS 99999999"), LimitError, "faces"),
        (vtk_text(VERTICES[0]).replace(b"POLYDATA", b"UNSTRUCTURED_GRID"), MalformedFileError, "V"),
        (
            vtk_text(VERTICES[0]).replace(b"POLYGONS", b"TRIANGLE_STRIPS"),
            MalformedFileError,
            "strips",
        ),
        (
            vtk_text(VERTICES[0], [[0, 1, 2, 3]])
            .replace(b"POLYDATA", b"UNSTRUCTURED_GRID")
            .replace(b"POLYGONS", b"CELLS")
            + b"CELL_TYPES 1\n10\n",
            MalformedFileError,
            "no polygons",
        ),
        (vtk_text(VERTICES[0], [[0, 1, 99]]), InputError, "Face 0 names vertex 99"),
        (vtk_text(VERTICES[0]).replace(b"made by", b"nan"), None, ""),
        (vtk_text(VERTICES[0] * np.nan), InputError, "vertex 0: x is nan"),
        (vtp_text(VERTICES[0])[:600], MalformedFileError, "not readable XML"),
        (vtp_text(VERTICES[0]).replace(b'Points="12"', b'Points="13"'), MalformedFileError, "VTK"),
        (vtp_text(VERTICES[0]).replace(b'Points="12"', b'Points="999999999"'), LimitError, "vert"),
        (vtp_text(VERTICES[0]).replace(b"<VTKFile", DOCTYPE, 1), MalformedFileError, "document"),
        (vtp_text(VERTICES[0]).replace(b"PolyData", b"ImageData"), MalformedFileError, "ImageData"),
    ],
)
def test_what_cannot_be_read_says_why(
    data: bytes, error: type[InputError] | None, words: str, parser: ParserProcess
) -> None:
    if error is None:
        read_sequence(data, parser=parser)
        return
    with pytest.raises(error) as caught:
        read_sequence(data, parser=parser)
    assert words in str(caught.value)
    assert caught.value.remedy


def test_a_stored_frame_reads_as_a_compressed_one(parser: ParserProcess) -> None:
    members = {f"{i}.vtk": vtk_text(VERTICES[i]) for i in range(N_FRAMES)}
    stored = read_sequence(zipped(members, zipfile.ZIP_STORED), parser=parser)
    assert stored.sequence.id == read_sequence(zipped(members), parser=parser).sequence.id


def test_limits_of_the_options_hold() -> None:
    with pytest.raises(LimitError):
        read_sequence(vtk_text(VERTICES[0]), ReadOptions(limits=ReadLimits(vertices=11)))


# Words of a legacy file are in any case, on any line; sizes are compared with what is there.
@pytest.mark.parametrize("size", [b"1900000", b"99999999999999999999", b"-12", b"+9", b"12x"])
@pytest.mark.parametrize("word", [b"\npoints ", b"  Points\t", b"\npOINTS\n\n", b"\npoints \r\n"])
def test_a_size_is_read_however_it_is_written(
    word: bytes, size: bytes, parser: ParserProcess
) -> None:
    data = vtk_text(VERTICES[0])
    good = read_sequence(data.replace(b"\nPOINTS 12", word + b"12"), parser=parser)
    assert np.array_equal(good.sequence.vertices[0], VERTICES[0])
    with pytest.raises(MalformedFileError, match="declares"):
        read_sequence(data.replace(b"\nPOINTS 12", word + size), parser=parser)


@pytest.mark.parametrize(
    "section",
    [
        b"polygons 99999 9\n",
        b"LINES 1 9999999\n",
        b"vertices 9999999 1\n",
        b"FIELD a 9999999\n",
        b"field a 1 b 99999 99999 FLOAT\n",
        b"field a 1 b 1 1 word\n0\n",
        b"field a 1 b 1 9999999 string\n",
        b"x" * 1000,
        b"x 1 2 3\n",
        b"polygons 1 4 900000000 0 1 2\n",
        b"polygons 1 4 -3 0 1 2\n",
        b"polygons 1 4 2 0 1 2\n",
        b"polygons 2 3 offsets int 1 3 connectivity int 0 1 2\n",
        b"polygons 2 3 offsets int 0 3 connectivity int 0 1\n",
        b"polygons 2 3 offsets int 0 3 connectivity float 0 1.5 2\n",
        b"polygons 2 3 offsets double 0 3.5 connectivity int 0 1 2\n",
        b"polygons 1 4 3 0 1 4294967298\n",
        b"polygons 1 4 3 0 1 99999999999999999999\n",
        b"polygons 2 3 offsets int 0 3 connectivity unsigned_char 0 1 258\n",
        b"field a 1 b 1 1 double\n \n",
        b"lines 1 3 9 0 1\n",
    ],
)
def test_sections_that_do_not_add_up_are_refused(section: bytes, parser: ParserProcess) -> None:
    with pytest.raises(InputError) as caught:
        read_sequence(vtk_text(VERTICES[0]) + section, parser=parser)
    assert caught.value.remedy


@pytest.mark.parametrize(
    "section",
    [b"lines 0 0\n", b"vertices 1 0\noffsets int\n0\nconnectivity int\n", b"field a 0\n \n"],
)
def test_what_is_empty_is_read(section: bytes, parser: ParserProcess) -> None:
    read = read_sequence(vtk_text(VERTICES[0]) + section, parser=parser)
    assert np.array_equal(read.sequence.faces, FACES)


def test_files_read_in_threads_leave_the_warnings_of_the_process_alone() -> None:
    def read(_: int) -> None:
        for _ in range(2000):
            numbers_in(b"1 2", np.dtype(np.float64))

    before, interval = [*warnings.filters], sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(8) as pool:
            list(pool.map(read, range(8)))
    finally:
        sys.setswitchinterval(interval)
    assert warnings.filters == before


@pytest.mark.parametrize("is_binary", [True, False])
def test_fields_of_a_legacy_file_state_time_and_coordinate_system(
    is_binary: bool, tmp_path: Path, parser: ParserProcess
) -> None:
    made = surface(VERTICES[0], FACES)
    core = vtk("vtkCommonCore")
    text, time, other = core.vtkStringArray(), core.vtkDoubleArray(), core.vtkFloatArray()
    for array, name, values in (
        (other, "a b", (1.0, 2.0)),
        (text, "SPACE", ("LPS",)),
        (time, "TimeValue", (0.25,)),
    ):
        array.SetName(name)
        for value in values:
            array.InsertNextValue(value)
        made.GetFieldData().AddArray(array)
    scalars = core.vtkFloatArray()
    scalars.SetName("wall thickness")
    for _ in VERTICES[0]:
        scalars.InsertNextValue(1.5)
    made.GetPointData().SetScalars(scalars)
    write = vtk("vtkIOLegacy").vtkPolyDataWriter()
    write.SetInputData(made)
    write.SetFileName(str(tmp_path / "frame.vtk"))
    (write.SetFileTypeToBinary if is_binary else write.SetFileTypeToASCII)()
    write.Write()
    read = read_sequence(tmp_path / "frame.vtk", parser=parser)
    assert read.coordinate_system == "LPS"
    assert read.sequence.times is not None
    assert read.sequence.times.tolist() == [0.25]
    assert read.ignored == ("point_data",)
    # Text has six digits.
    assert np.allclose(read.sequence.vertices[0], VERTICES[0], rtol=1e-5)
