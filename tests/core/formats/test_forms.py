"""One simulated heart in all forms that people have: read, or refused with what converts it."""

from __future__ import annotations

import io
import json
import re
import zipfile
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np
import pytest
from click.testing import CliRunner
from project import ROOT

import modalmotion as mm
from modalmotion.cli import main
from modalmotion.formats import (
    DEFAULT_LIMITS,
    ParserHere,
    ReadLimits,
    ReadOptions,
    write_glb,
    write_npz,
    write_ply_zip,
    write_raw,
    write_vtkhdf,
)
from modalmotion.formats.glb_writing import frame_animation
from modalmotion.formats.ply import write_ply
from modalmotion.mesh.sequence import sequence_to_hdf5

BEAT: Final = mm.simulate_ventricle(
    grid=(8, 12), acquisition=mm.Acquisition(n_frames=4), rng=np.random.default_rng(1)
)
X: Final = BEAT.vertices.astype(np.float64)
FACES: Final = BEAT.faces
TIMES: Final = np.asarray(BEAT.times)

Maker = Callable[[Path], Path]


def frames(end: str, write: Callable[[int, Path], None]) -> Maker:
    """Write a file a frame into a folder."""

    def make(folder: Path) -> Path:
        for k in range(len(X)):
            write(k, folder / f"beat_{k}{end}")
        return folder

    return make


def one(name: str, data: Callable[[], bytes]) -> Maker:
    def make(folder: Path) -> Path:
        (folder / name).write_bytes(data())
        return folder / name

    return make


def ply(k: int, path: Path) -> None:
    path.write_bytes(write_ply(X[k], FACES, {}))


def text_mesh(head: str, vertex: str, face: str, first: int, tail: str = "") -> Any:
    def write(k: int, path: Path) -> None:
        rows = [vertex.format(*row) for row in X[k].tolist()]
        rows += [face.format(*row) for row in (FACES + first).tolist()]
        counts = {"n": len(X[k]), "m": len(FACES), "m4": 4 * len(FACES)}
        path.write_text("\n".join([head.format(**counts), *rows, tail]))

    return write


def stl(k: int, path: Path) -> None:
    corners = np.zeros(len(FACES), np.dtype([("n", "<f4", 3), ("x", "<f4", (3, 3)), ("a", "<u2")]))
    corners["x"] = X[k][FACES]
    path.write_bytes(b" " * 80 + len(FACES).to_bytes(4, "little") + corners.tobytes())


def legacy(k: int, path: Path) -> None:
    points = "\n".join("{} {} {}".format(*row) for row in X[k].tolist())
    polygons = "\n".join("3 {} {} {}".format(*row) for row in FACES.tolist())
    path.write_text(
        "# vtk DataFile Version 3.0\nbeat\nASCII\nDATASET POLYDATA\n"
        f"POINTS {len(X[k])} double\n{points}\nPOLYGONS {len(FACES)} {4 * len(FACES)}\n{polygons}\n"
    )


def by_vtk(kind: str) -> Callable[[int, Path], None]:
    """Write by VTK's own writers, as ParaView does."""

    def write(k: int, path: Path) -> None:
        vtk = pytest.importorskip("vtkmodules.all")

        support: Any = import_module("vtkmodules.util.numpy_support")

        points, cells = vtk.vtkPoints(), vtk.vtkCellArray()
        points.SetData(support.numpy_to_vtk(X[k], deep=True))
        at = np.arange(0, 3 * len(FACES) + 1, 3)
        of = (support.numpy_to_vtkIdTypeArray(a, deep=True) for a in (at, FACES.ravel().copy()))
        cells.SetData(*of)
        is_grid = kind == "XMLUnstructuredGrid"
        mesh = vtk.vtkUnstructuredGrid() if is_grid else vtk.vtkPolyData()
        mesh.SetPoints(points)
        if is_grid:
            mesh.SetCells(vtk.VTK_TRIANGLE, cells)
        else:
            mesh.SetPolys(cells)
        writer = getattr(vtk, f"vtk{kind}Writer")()
        writer.SetFileName(str(path))
        writer.SetInputData(mesh)
        if kind == "PolyData":
            writer.SetFileTypeToBinary()
        writer.Write()

    return write


def listed(name: str, text: Callable[[], str]) -> Maker:
    def make(folder: Path) -> Path:
        frames(".ply", ply)(folder)
        (folder / name).write_text(text())
        return folder / name

    return make


def pvd() -> str:
    sets = [f'<DataSet timestep="{t}" file="beat_{k}.ply"/>' for k, t in enumerate(TIMES.tolist())]
    return f'<VTKFile type="Collection"><Collection>{"".join(sets)}</Collection></VTKFile>'


def series() -> str:
    entries = [{"name": f"beat_{k}.ply", "time": t} for k, t in enumerate(TIMES.tolist())]
    return json.dumps({"file-series-version": "1.0", "files": entries})


def xdmf(folder: Path) -> Path:
    def item(place: str, shape: tuple[int, ...]) -> str:
        size = " ".join(map(str, shape))
        return f'<DataItem Dimensions="{size}" Format="HDF">beat.h5:/{place}</DataItem>'

    with h5py.File(folder / "beat.h5", "w") as file:
        file["faces"] = FACES
        for k in range(len(X)):
            file[f"steps/{k}"] = X[k]
    grids = [
        f'<Grid GridType="Uniform"><Time Value="{t}"/>'
        f'<Topology TopologyType="Triangle">{item("faces", FACES.shape)}</Topology>'
        f'<Geometry GeometryType="XYZ">{item(f"steps/{k}", X[k].shape)}</Geometry></Grid>'
        for k, t in enumerate(TIMES.tolist())
    ]
    head = '<?xml version="1.0"?><!DOCTYPE Xdmf SYSTEM "Xdmf.dtd" []>'
    grid = f'<Grid GridType="Collection" CollectionType="Temporal">{"".join(grids)}</Grid>'
    path = folder / "beat.xdmf"
    path.write_text(f'{head}<Xdmf Version="3.0"><Domain>{grid}</Domain></Xdmf>')
    return path


def matlab(folder: Path) -> Path:
    savemat = pytest.importorskip("scipy.io").savemat
    savemat(folder / "beat.mat", {"V": X.transpose(1, 2, 0), "F": FACES + 1.0})
    return folder / "beat.mat"


def matlab_7_3(folder: Path) -> Path:
    path = folder / "beat.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        # As MATLAB writes them: axes in the other order, numbers as double.
        for name, value in (("vertices", X.transpose(1, 2, 0)), ("faces", FACES + 1.0)):
            file[name] = value.T
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512))
    return path


def npz_of(**arrays: Any) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()


def npy() -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, X)
    return buffer.getvalue()


def zipped() -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for k in range(len(X)):
            archive.writestr(f"beat_{k}.ply", write_ply(X[k], FACES, {}))
    return buffer.getvalue()


def plain_hdf5() -> bytes:
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        file["points"], file["triangles"] = X, FACES
    return buffer.getvalue()


def csv_table() -> bytes:
    rows = [f"{k},{x},{y},{z}" for k, frame in enumerate(X.tolist()) for x, y, z in frame]
    return "\n".join(["frame,x,y,z", *rows]).encode()


def text_of(text: str) -> Callable[[int, Path], None]:
    def write(_: int, path: Path) -> None:
        path.write_text(text)

    return write


MSH: Final = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n"
INP: Final = "*HEADING\nbeat\n*NODE\n1, 0, 0, 0\n"

READ: Final[dict[str, Maker]] = {
    "npz": one("beat.npz", lambda: write_npz(BEAT)),
    "npz with points and triangles": one("b.npz", lambda: npz_of(points=X, triangles=FACES)),
    "VTKHDF": one("beat.vtkhdf", lambda: write_vtkhdf(BEAT)),
    "HDF5 of our own": one("beat.h5", lambda: sequence_to_hdf5(BEAT)),
    "HDF5 with points and triangles": one("beat.hdf5", plain_hdf5),
    "GLB": one("beat.glb", lambda: write_glb(frame_animation(BEAT))),
    "zip of frames": one("beat.zip", zipped),
    "zip of PLY and times": one("beat.zip", lambda: write_ply_zip(BEAT)),
    "folder of PLY": frames(".ply", ply),
    "folder of STL": frames(".stl", stl),
    "folder of OBJ": frames(".obj", text_mesh("# beat", "v {} {} {}", "f {} {} {}", 1)),
    "folder of OFF": frames(".off", text_mesh("OFF\n{n} {m} 0", "{} {} {}", "3 {} {} {}", 0)),
    "folder of legacy .vtk": frames(".vtk", legacy),
    "folder of binary .vtk 5.1": frames(".vtk", by_vtk("PolyData")),
    "folder of .vtp": frames(".vtp", by_vtk("XMLPolyData")),
    "folder of .vtu": frames(".vtu", by_vtk("XMLUnstructuredGrid")),
    ".pvd": listed("beat.pvd", pvd),
    ".series": listed("beat.ply.series", series),
    ".xdmf with .h5": xdmf,
    "MATLAB .mat": matlab,
    "MATLAB .mat 7.3": matlab_7_3,
    "raw numbers": one("beat.f32", lambda: write_raw(BEAT)),
}
REFUSED: Final[dict[str, tuple[Maker, str]]] = {
    "Abaqus .inp": (frames(".inp", text_of(INP)), "meshio convert"),
    "Gmsh .msh": (frames(".msh", text_of(MSH)), "meshio convert"),
    "NumPy .npy": (one("beat.npy", npy), "numpy.savez('beat.npz'"),
    "glTF as JSON": (one("beat.gltf", lambda: b'{"asset": {"version": "2.0"}}'), "gltf-pipeline"),
    "CSV of points": (one("beat.csv", csv_table), "modalmotion track"),
}


@pytest.mark.parametrize("form", READ)
def test_a_form_is_read_as_the_same_heart(form: str, tmp_path: Path) -> None:
    source = READ[form](tmp_path)
    options = ReadOptions(n_vertices=BEAT.n_vertices) if form == "raw numbers" else ReadOptions()
    sequence = mm.read_sequence(source, options).sequence
    if "STL" in form:
        # It has corners: vertices come in their order.
        corners = sequence.vertices[:, sequence.faces]
        assert np.abs(corners - X[:, FACES]).max() < 1e-4
        return
    assert np.abs(sequence.vertices - X).max() < 1e-4
    if form != "raw numbers":
        assert np.array_equal(sequence.faces, FACES)
    if form in (".pvd", ".series", ".xdmf with .h5"):
        assert np.array_equal(sequence.times, TIMES)  # type: ignore[arg-type]


@pytest.mark.parametrize("form", REFUSED)
def test_a_form_is_refused_with_the_command_that_converts_it(form: str, tmp_path: Path) -> None:
    make, remedy = REFUSED[form]
    source = make(tmp_path)
    for path in (
        [source] if source.is_file() else [source, source / min(p.name for p in source.iterdir())]
    ):
        with pytest.raises(mm.MalformedFileError) as caught:
            mm.read_sequence(path)
        assert remedy in caught.value.remedy


def test_points_in_a_table_are_tracked(tmp_path: Path) -> None:
    path = REFUSED["CSV of points"][0](tmp_path)
    track = mm.track(path, modes=7, unit="mm")
    assert track.n_frames == len(X)
    path.write_text("frame,x,y,z\n0,1,2,three\n")
    with pytest.raises(mm.MalformedFileError, match="not a number"):
        mm.track(path)


def test_displacements_of_xdmf_are_added(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "u.h5", "w") as file:
        file["x"], file["faces"] = X[0], FACES
        for k in range(len(X)):
            file[f"u{k}"] = X[k] - X[0]

    def item(place: str) -> str:
        return f'<DataItem Format="HDF">u.h5:/{place}</DataItem>'

    mesh = (
        f'<Topology TopologyType="Triangle">{item("faces")}</Topology>'
        f"<Geometry>{item('x')}</Geometry>"
    )
    grids = "".join(
        f'<Grid><Time Value="{k}"/>{mesh if k == 0 else ""}'
        f'<Attribute Name="u" AttributeType="Vector">{item(f"u{k}")}</Attribute></Grid>'
        for k in range(len(X))
    )
    (tmp_path / "u.xdmf").write_text(f"<Xdmf><Domain>{grids}</Domain></Xdmf>")
    reading = mm.read_sequence(tmp_path)
    assert np.abs(reading.sequence.vertices - X).max() < 1e-6
    assert "displacement" in " ".join(map(str, reading.notes))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("F", "abc"),
        ("F", np.full((12, 3), 1.0, dtype=object)),
        ("F", FACES + 1j),
        ("F", np.full((12, 3), np.inf)),
        ("F", np.full((12, 3), np.nan)),
        ("F", np.full((12, 3), 1e30)),
        ("V", "abc"),
        ("V", {"a": 1}),
        ("V", X.transpose(1, 2, 0) + 1j),
        ("times", "abc"),
        ("times", np.full(3, 1.0, dtype=object)),
    ],
)
def test_what_is_no_number_in_a_matlab_file_is_refused(
    name: str, value: object, tmp_path: Path
) -> None:
    savemat = pytest.importorskip("scipy.io").savemat
    arrays = {"V": X.transpose(1, 2, 0), "F": FACES + 1.0} | {name: value}
    savemat(tmp_path / "beat.mat", arrays)
    with pytest.raises(mm.InputError) as caught:
        # In a process of its own any error would become one of ours.
        mm.read_sequence(tmp_path / "beat.mat", parser=ParserHere(DEFAULT_LIMITS))
    assert caught.value.remedy


def test_a_matlab_file_beyond_a_limit_names_the_limit(tmp_path: Path) -> None:
    savemat = pytest.importorskip("scipy.io").savemat
    savemat(tmp_path / "beat.mat", {"V": X.transpose(1, 2, 0), "F": FACES + 1.0})
    parser = ParserHere(ReadLimits(decompressed_bytes=100))
    with pytest.raises(mm.LimitError) as caught:
        mm.read_sequence(tmp_path / "beat.mat", parser=parser)
    assert caught.value.limit == "decompressed_bytes"


@pytest.mark.parametrize("stated", ["time soon", "grid 8 x 12"])
def test_frames_that_state_numbers_in_words_are_refused(stated: str) -> None:
    name, _, words = stated.partition(" ")
    with pytest.raises(mm.MalformedFileError, match="in words"):
        mm.read_sequence(write_ply(X[0], FACES, {name: words}))


def test_a_frame_of_xdmf_that_differs_is_named(tmp_path: Path) -> None:
    three, four = (INLINE.format(x, 0, "0 1 2") for x in ("0 0 0 1 0 0 0 1 0", "0 " * 12))
    (tmp_path / "beat.xdmf").write_text(three.replace("</Xdmf>", four.removeprefix("<Xdmf>")))
    with pytest.raises(mm.ShapeError, match="Frame 1: It has 4 vertices"):
        mm.read_sequence(tmp_path / "beat.xdmf")


INLINE: Final = (
    '<Xdmf><Grid><Time Value="{1}"/><Geometry><DataItem>{0}</DataItem></Geometry>'
    '<Topology TopologyType="Triangle"><DataItem>{2}</DataItem></Topology></Grid></Xdmf>'
)
OUTSIDE: Final = (
    '<Xdmf><Grid><Topology TopologyType="Triangle"/><Geometry>'
    '<DataItem Format="HDF">../b.h5:/x</DataItem></Geometry></Grid></Xdmf>'
)


@pytest.mark.parametrize(
    "text",
    [
        "<Xdmf><Domain/></Xdmf>",
        "<Xdmf><Domain><Grid/></Domain></Xdmf>",
        '<!DOCTYPE Xdmf [<!ENTITY a "b">]><Xdmf/>',
        "<Xdmf>" * 30,
        '<Xdmf><Grid><Topology TopologyType="Hexahedron"/><Geometry/></Grid></Xdmf>',
        OUTSIDE,
        INLINE.format("0 0 0 1 0 0 0 1", "0", "0 1 2"),
        INLINE.format("0 0 0 1 0 0 0 1 x", "0", "0 1 2"),
        INLINE.format("0 0 0 1 0 0 0 1 0", "early", "0 1 2"),
        INLINE.format("0 0 0 1 0 0 0 1 0", "0", "0 1"),
    ],
)
def test_xdmf_that_is_none_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "b.xdmf").write_text(text)
    with pytest.raises((mm.MalformedFileError, mm.LimitError)):
        mm.read_sequence(tmp_path / "b.xdmf")


@pytest.mark.parametrize("end", [".npz", ".h5", ".vtkhdf", ".glb", ".zip", ".raw"])
def test_forms_that_are_written_are_converted_to(end: str, tmp_path: Path) -> None:
    source, output = tmp_path / "frames", tmp_path / f"beat{end}"
    source.mkdir()
    READ["folder of PLY"](source)
    done = CliRunner().invoke(main, ["convert", str(source), str(output), "--unit", "mm"])
    assert done.exit_code == 0, done.output
    options = ReadOptions(n_vertices=BEAT.n_vertices) if end == ".raw" else ReadOptions()
    again = mm.read_sequence(output, options).sequence
    assert np.abs(again.vertices - X).max() < 1e-4
    assert again.unit == (None if end == ".raw" else "mm")


def test_the_document_lists_the_forms() -> None:
    text = (ROOT / "docs" / "formats.md").read_text()
    table = text.partition("## The same heart in all forms")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| (.+?) \| (read|refused)", table, flags=re.MULTILINE)
    assert {form for form, result in rows if result == "read"} == READ.keys()
    assert {form for form, result in rows if result == "refused"} == REFUSED.keys()
    assert len(rows) == len(READ) + len(REFUSED)
