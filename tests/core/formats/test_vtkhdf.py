"""VTKHDF surfaces over time and files of our own store, behind the gate."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from format_samples import FACES, N_FRAMES, N_VERTICES, TIMES, VERTICES, sequence

from modalmotion.errors import (
    ConnectivityError,
    InputError,
    LimitError,
    MalformedFileError,
    NonFiniteError,
    ParameterError,
    ShapeError,
)
from modalmotion.formats import ParserProcess, ReadLimits, read_sequence, write_vtkhdf
from modalmotion.hdf5.sealed import open_gated, seal
from modalmotion.mesh.sequence import mesh_sequence, sequence_to_hdf5

LIMITS = ReadLimits(frames=100, vertices=1000, faces=1000, decompressed_bytes=1_000_000)


@pytest.fixture(scope="module")
def parser() -> Iterator[ParserProcess]:
    with ParserProcess(LIMITS, seconds=30) as process:
        yield process


def edited(edit: Callable[[h5py.File], object], data: bytes | None = None) -> bytes:
    buffer = io.BytesIO(write_vtkhdf(sequence(times=TIMES)) if data is None else data)
    with h5py.File(buffer, "r+") as file:
        edit(file)
    return buffer.getvalue()


def replace(file: h5py.File, name: str, values: Any, **others: Any) -> None:
    del file[name]
    file.create_dataset(name, data=values, **others)


@pytest.mark.parametrize("timed", [True, False])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_written_file_reads_back_with_the_same_id(
    timed: bool, dtype: type, parser: ParserProcess
) -> None:
    given = mesh_sequence(
        np.random.default_rng(0).normal(size=(4, 12, 3)).astype(dtype),
        FACES,
        times=np.arange(4) / 7 + 3 if timed else None,
        unit="mm",
        topology="cup",
        grid=(3, 4),
    )
    data = write_vtkhdf(given, {"error": np.ones((4, 12))}, {"sequence_id": given.id})
    assert data == write_vtkhdf(given, {"error": np.ones((4, 12))}, {"sequence_id": given.id})
    read = read_sequence(data, parser=parser)
    assert read.sequence.id == given.id
    assert read.sequence.vertices.dtype == dtype
    assert (read.format, read.unit_from) == ("vtkhdf", "file")
    assert read.times_from == ("file" if timed else None)
    assert read.ignored == ("PointData.error",)


def test_a_surface_without_faces_shows_its_points(parser: ParserProcess) -> None:
    given = mesh_sequence(VERTICES)
    data = write_vtkhdf(given)
    assert read_sequence(data, parser=parser).sequence.id == given.id
    with h5py.File(io.BytesIO(data)) as file:
        assert file["VTKHDF/Vertices/NumberOfCells"][0] == N_VERTICES


def test_a_file_of_the_store_reads_back_with_the_same_id(parser: ParserProcess) -> None:
    given = sequence(times=TIMES, unit="mm", topology="cup", grid=(3, 4))
    read = read_sequence(sequence_to_hdf5(given), parser=parser)
    assert read.sequence.id == given.id
    assert read.format == "hdf5"


def test_a_changed_file_of_the_store_is_refused(parser: ParserProcess) -> None:
    data = bytearray(sequence_to_hdf5(sequence()))
    data[len(data) // 2] ^= 1
    with pytest.raises(MalformedFileError, match="sha256"):
        read_sequence(bytes(data), parser=parser)


def test_h5py_reads_the_same_bits() -> None:
    field = np.random.default_rng(0).normal(size=(N_FRAMES, N_VERTICES))
    data = write_vtkhdf(sequence(times=TIMES), {"error": field})
    with h5py.File(io.BytesIO(data)) as file:
        root = file["VTKHDF"]
        assert root.attrs["Type"] == b"PolyData"
        assert np.array_equal(root["Points"][()].reshape(VERTICES.shape), VERTICES)
        assert np.array_equal(root["PointData/error"][()].reshape(field.shape), field)
        assert root["Steps/Values"][()].tolist() == list(TIMES)


def test_vtk_plays_what_is_written(tmp_path: Path) -> None:
    pytest.importorskip("vtkmodules", reason="needs the extra 'vtk'")
    to_numpy = import_module("vtkmodules.util.numpy_support").vtk_to_numpy
    field = np.random.default_rng(0).normal(size=(N_FRAMES, N_VERTICES))
    path = tmp_path / "surface.vtkhdf"
    path.write_bytes(write_vtkhdf(sequence(times=TIMES), {"error": field, "u": VERTICES}))
    reader = import_module("vtkmodules.vtkIOHDF").vtkHDFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    pipeline = import_module("vtkmodules.vtkCommonExecutionModel").vtkStreamingDemandDrivenPipeline
    assert reader.GetOutputInformation(0).Get(pipeline.TIME_STEPS()) == TIMES
    for frame in (2, 0, 1):
        reader.UpdateTimeStep(TIMES[frame])
        surface = reader.GetOutputDataObject(0)
        assert np.array_equal(to_numpy(surface.GetPoints().GetData()), VERTICES[frame])
        corners = to_numpy(surface.GetPolys().GetConnectivityArray())
        assert np.array_equal(corners.reshape(-1, 3), FACES)
        assert np.array_equal(to_numpy(surface.GetPointData().GetArray("error")), field[frame])
        assert np.array_equal(to_numpy(surface.GetPointData().GetArray("u")), VERTICES[frame])


def step_by_step() -> bytes:
    """The layout that VTK's own writer chooses: cells anew for every step."""
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        root = file.create_group("VTKHDF")
        root.attrs["Version"], root.attrs["Type"] = (2, 3), np.bytes_(b"PolyData")
        root["NumberOfPoints"] = [N_VERTICES] * N_FRAMES
        plain = {"chunks": (7, 3), "compression": "gzip", "shuffle": True, "fletcher32": True}
        root.create_dataset("Points", data=VERTICES.reshape(-1, 3), **plain)
        for name in ("Vertices", "Lines", "Strips", "Polygons"):
            n = len(FACES) if name == "Polygons" else 0
            group = root.create_group(name)
            group["NumberOfCells"] = [n] * N_FRAMES
            group["NumberOfConnectivityIds"] = [3 * n] * N_FRAMES
            group["Offsets"] = np.tile(np.arange(n + 1) * 3, N_FRAMES)
            group["Connectivity"] = np.tile(FACES.ravel() if n else np.zeros(0, int), N_FRAMES)
        steps = root.create_group("Steps")
        steps.attrs["NSteps"] = N_FRAMES
        steps["Values"] = np.array(TIMES)
        steps["PartOffsets"] = np.arange(N_FRAMES)
        steps["PointOffsets"] = np.arange(N_FRAMES) * N_VERTICES
        for name, n in (("CellOffsets", len(FACES)), ("ConnectivityIdOffsets", FACES.size)):
            steps[name] = np.arange(N_FRAMES)[:, None] * [0, 0, n, 0]
    return buffer.getvalue()


def test_cells_written_anew_for_every_step_are_read(parser: ParserProcess) -> None:
    read = read_sequence(step_by_step(), parser=parser)
    assert read.sequence.id == sequence(times=TIMES).id
    assert "seconds" in read.notes[0]


def test_what_vtk_writes_is_read(tmp_path: Path, parser: ParserProcess) -> None:
    pytest.importorskip("vtkmodules", reason="needs the extra 'vtk'")
    source = import_module("vtkmodules.vtkFiltersSources").vtkSphereSource()
    source.Update()
    path = tmp_path / "sphere.vtkhdf"
    writer = import_module("vtkmodules.vtkIOHDF").vtkHDFWriter()
    writer.SetInputData(source.GetOutput())
    writer.SetFileName(str(path))
    writer.SetCompressionLevel(4)
    writer.Write()
    to_numpy = import_module("vtkmodules.util.numpy_support").vtk_to_numpy
    read = read_sequence(path, parser=parser).sequence
    output = source.GetOutput()
    assert np.array_equal(read.vertices[0], to_numpy(output.GetPoints().GetData()))
    assert np.array_equal(read.faces.ravel(), to_numpy(output.GetPolys().GetConnectivityArray()))


def set_value(name: str, index: Any, value: Any) -> Callable[[h5py.File], object]:
    def edit(file: h5py.File) -> None:
        file[name][index] = value

    return edit


def set_attribute(name: str, key: str, value: Any) -> Callable[[h5py.File], object]:
    def edit(file: h5py.File) -> None:
        file[name].attrs[key] = value

    return edit


@pytest.mark.parametrize(
    ("data", "error", "words", "frame"),
    [
        (
            edited(set_value("VTKHDF/Polygons/Connectivity", 40, 0), step_by_step()),
            ConnectivityError,
            "Frame 1 has other faces",
            1,
        ),
        (
            edited(set_value("VTKHDF/NumberOfPoints", 2, 11), step_by_step()),
            ShapeError,
            "Frame 2 has 11 vertices",
            2,
        ),
        (
            edited(set_value("VTKHDF/Polygons/Offsets", 5, 99), step_by_step()),
            MalformedFileError,
            "Frame 0",
            0,
        ),
        (
            edited(set_value("VTKHDF/Steps/CellOffsets", (1, 2), -20), step_by_step()),
            MalformedFileError,
            "Frame 1",
            1,
        ),
        (
            edited(set_value("VTKHDF/Steps/PointOffsets", 1, 30)),
            MalformedFileError,
            "fewer than its steps name",
            None,
        ),
        (
            edited(set_value("VTKHDF/Steps/PartOffsets", 1, 3)),
            MalformedFileError,
            "names no part",
            None,
        ),
        (
            edited(set_value("VTKHDF/Polygons/Connectivity", 0, 12)),
            ConnectivityError,
            "names vertex 12",
            None,
        ),
        (edited(set_value("VTKHDF/Points", (5, 0), np.nan)), NonFiniteError, "vertex 5", 0),
        (edited(set_attribute("VTKHDF", "Type", "ImageData")), MalformedFileError, "Image", None),
        (edited(set_attribute("VTKHDF/Steps", "NSteps", 4)), MalformedFileError, "[3, 4]", None),
        (edited(set_value("VTKHDF/Steps/Values", 1, 0.0)), ShapeError, "Frames 0 and 1", 1),
        (
            edited(set_value("VTKHDF/Steps/NumberOfParts", 0, 2)),
            MalformedFileError,
            "2 parts",
            None,
        ),
        (
            edited(lambda file: replace(file, "VTKHDF/Strips/NumberOfCells", [1])),
            MalformedFileError,
            "strips",
            None,
        ),
        (
            edited(lambda file: replace(file, "VTKHDF/Points", np.zeros((36, 2)))),
            MalformedFileError,
            "(36, 2)",
            None,
        ),
        (
            edited(lambda file: replace(file, "VTKHDF/NumberOfPoints", [12.0])),
            MalformedFileError,
            "float64",
            None,
        ),
        (edited(lambda file: file.pop("VTKHDF")), MalformedFileError, "'modalmotion'", None),
        (edited(lambda file: file["VTKHDF"].pop("Points")), MalformedFileError, "Points", None),
        (write_vtkhdf(sequence())[:9000], MalformedFileError, "cut short", None),
        (write_vtkhdf(sequence())[:7], MalformedFileError, "Unrecognised file format", None),
        (seal(b"\x89HDF\r\n\x1a\n" + bytes(900)), MalformedFileError, "cannot be read", None),
    ],
)
def test_what_is_no_sequence_says_why(
    data: bytes, error: type[InputError], words: str, frame: int | None, parser: ParserProcess
) -> None:
    with pytest.raises(error) as caught:
        read_sequence(data, parser=parser)
    assert type(caught.value) is error
    assert words in str(caught.value)
    assert caught.value.frame == frame
    assert caught.value.remedy


def external_storage(file: h5py.File) -> None:
    del file["VTKHDF/Points"]
    file["VTKHDF"].create_dataset("Points", (36, 3), "f4", external=[("/etc/passwd", 0, 432)])


def virtual_layout(file: h5py.File) -> None:
    layout = h5py.VirtualLayout((36, 3), "f4")
    layout[:] = h5py.VirtualSource("/etc/passwd", "x", (36, 3))
    del file["VTKHDF/Points"]
    file["VTKHDF"].create_virtual_dataset("Points", layout)


def other_filter(file: h5py.File) -> None:
    replace(file, "VTKHDF/Points", VERTICES.reshape(-1, 3), chunks=(7, 3), compression="lzf")


def declared(shape: tuple[int, ...], **others: Any) -> Callable[[h5py.File], object]:
    def edit(file: h5py.File) -> None:
        file["VTKHDF"].create_dataset("more", shape, "f8", **others)

    return edit


def cycle(file: h5py.File) -> None:
    file["VTKHDF/again"] = file["VTKHDF"]


@pytest.mark.parametrize(
    ("edit", "error", "words"),
    [
        (external_storage, MalformedFileError, "data in another file"),
        (virtual_layout, MalformedFileError, "virtual layout"),
        (other_filter, MalformedFileError, "the filter"),
        (
            lambda file: file.__setitem__("x", h5py.ExternalLink("/etc/passwd", "/")),
            MalformedFileError,
            "a link",
        ),
        (
            lambda file: file["VTKHDF"].__setitem__("x", h5py.SoftLink("/VTKHDF/Points")),
            MalformedFileError,
            "a link",
        ),
        (declared((10**9, 3)), LimitError, "decompressed bytes"),
        (declared((10**9, 3), chunks=(1000, 3)), LimitError, "decompressed bytes"),
        (declared((1, 3), chunks=(10**6, 3), maxshape=(None, 3)), LimitError, "decompressed"),
        (declared((100_000, 3), chunks=(1000, 3)), LimitError, "decompressed bytes"),
        (set_attribute("VTKHDF", "long", np.zeros(7000)), MalformedFileError, "an attribute"),
    ],
)
def test_the_gate_lets_nothing_else_through(
    edit: Callable[[h5py.File], object],
    error: type[InputError],
    words: str,
    parser: ParserProcess,
) -> None:
    data = edited(edit)
    for read in (lambda: read_sequence(data, parser=parser), lambda: gated(data)):
        with pytest.raises(error) as caught:
            read()
        assert words in str(caught.value)
        assert caught.value.remedy


def gated(data: bytes) -> None:
    with open_gated(data, LIMITS):
        pass


@pytest.mark.parametrize("name", ["MOST_OBJECTS", "MOST_ATTRIBUTES"])
def test_the_gate_counts(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def edit(file: h5py.File) -> None:
        for i in range(60):
            file.create_group(f"g/{i}")
            file.attrs[f"a{i}"] = i

    data = edited(edit)
    gated(data)
    monkeypatch.setattr(f"modalmotion.hdf5.sealed.{name}", 50)
    with pytest.raises(LimitError) as caught:
        gated(data)
    assert caught.value.limit == "hdf5_objects"


def test_the_gate_follows_cycles_once(parser: ParserProcess) -> None:
    assert read_sequence(edited(cycle), parser=parser).sequence.id == sequence(times=TIMES).id


def test_other_objects_and_attributes_do_no_harm(parser: ParserProcess) -> None:
    def edit(file: h5py.File) -> None:
        file["words"] = ["of", "any", "length"]
        file.attrs["note"] = "text of any length"
        file["type"] = np.dtype("f8")
        file.create_dataset("empty", data=h5py.Empty("f4"))

    assert read_sequence(edited(edit), parser=parser).sequence.id == sequence(times=TIMES).id


@pytest.mark.parametrize(
    ("name", "values", "error"),
    [
        ("error", np.zeros((N_FRAMES, N_VERTICES - 1)), ShapeError),
        ("error", np.zeros(N_FRAMES), ShapeError),
        ("error", np.zeros((N_FRAMES, N_VERTICES, 3, 3)), ShapeError),
        ("error", np.zeros((N_FRAMES, N_VERTICES), dtype="U1"), ShapeError),
        ("", np.zeros((N_FRAMES, N_VERTICES)), ParameterError),
        ("a/b", np.zeros((N_FRAMES, N_VERTICES)), ParameterError),
    ],
)
def test_a_field_must_fit_the_sequence(
    name: str, values: np.ndarray[Any, Any], error: type[InputError]
) -> None:
    with pytest.raises(error):
        write_vtkhdf(sequence(), {name: values})
