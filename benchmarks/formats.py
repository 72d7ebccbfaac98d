"""Reading a sequence of 25 frames of 4,000 vertices from each format, beside its own library."""

from __future__ import annotations

import io
import tempfile
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from measure import Table, in_words, side_by_side
from numpy.typing import NDArray

from modalmotion.formats import (
    DEFAULT_LIMITS,
    Format,
    MorphAnimation,
    ParserHere,
    ParserProcess,
    ReadOptions,
    read_sequence,
    write_glb,
    write_npz,
    write_ply_zip,
    write_raw,
    write_vtkhdf,
)
from modalmotion.mesh import lattice_faces
from modalmotion.mesh.hdf5 import sequence_to_hdf5
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.modes.topology import CYLINDER

N_FRAMES, SHAPE = 25, (40, 100)
N_SAMPLES = 5


@dataclass(frozen=True)
class Case:
    """A file, and how its format's own library reads positions and faces from it."""

    name: str
    data: bytes
    library: str
    read: Callable[[], object] | None
    options: ReadOptions = field(default_factory=ReadOptions)


def run(_folder: Path | None = None) -> list[Table]:
    """Time every format; nothing is drawn."""
    table = Table(
        f"Reading {N_FRAMES} frames of {SHAPE[0] * SHAPE[1]} vertices from bytes (medians)",
        ("format", "MB", "read_sequence", "library", "its time", "ratio"),
    )
    with tempfile.TemporaryDirectory() as place, ParserProcess(DEFAULT_LIMITS) as process:
        for case in _cases(Path(place)):
            _add(table, case, process)
        _add_start(table)
    return [table]


def _add(table: Table, case: Case, process: ParserProcess) -> None:
    isolated = case.name.startswith(("VTKHDF", "HDF5", "zip of .vt"))
    calls = {"ours": lambda: read_sequence(case.data, case.options, parser=process)}
    if isolated:
        calls["here"] = lambda: read_sequence(case.data, parser=ParserHere(DEFAULT_LIMITS))
    if case.read is not None:
        calls["library"] = case.read  # type: ignore[assignment]
    times = {name: t.median for name, t in side_by_side(calls, N_SAMPLES).items()}
    size, theirs = f"{len(case.data) / 1e6:.2f}", times.get("library")
    for key, name in (("ours", case.name), ("here", f"{case.name}, in this process")):
        if key not in times:
            continue
        ratio = "" if theirs is None else f"{times[key] / theirs:.2f}"
        its = "" if theirs is None else in_words(theirs)
        table.add(name, size, in_words(times[key]), case.library, its, ratio)


def _add_start(table: Table) -> None:
    def start() -> None:
        with ParserProcess(DEFAULT_LIMITS) as fresh:
            read_sequence(small, parser=fresh)

    small = write_vtkhdf(mesh_sequence(np.zeros((1, 1, 3))))
    seconds = side_by_side({"start": start}, N_SAMPLES)["start"].median
    table.add("start of the parser's process", "", in_words(seconds), "", "", "")


def _cases(place: Path) -> list[Case]:
    sequence = _beating()
    positions, faces = sequence.vertices, sequence.faces
    options = ReadOptions(format=Format.RAW, grid=SHAPE)
    npz, hdf5, raw = write_npz(sequence), write_vtkhdf(sequence), write_raw(sequence)
    ours = sequence_to_hdf5(sequence)
    cases = [
        Case("npz", npz, "numpy", lambda: dict(np.load(io.BytesIO(npz)))),
        Case("raw float32", raw, "numpy", lambda: np.frombuffer(raw, "<f4").copy(), options),
        Case("VTKHDF", hdf5, "h5py", lambda: _read_hdf5(hdf5)),
        Case("HDF5 of the store", ours, "h5py", lambda: _read_hdf5(ours)),
    ]
    if find_spec("trimesh") is not None:
        trimesh = import_module("trimesh")
        files = {"ply": write_ply_zip(sequence)}
        for kind, options_of in (("stl", {}), ("obj", {}), ("off", {"digits": 9})):
            files[kind] = _zip(kind, trimesh, positions, faces, options_of)
        files["stl_ascii"] = _zip("stl_ascii", trimesh, positions, faces, {})
        cases += [
            Case(f"zip of {kind}", data, "trimesh", _with_trimesh(trimesh, data))
            for kind, data in files.items()
        ]
    if find_spec("vtkmodules") is not None:
        for suffix, mode in (("vtk", "FileTypeToBinary"), ("vtp", "DataModeToAppended")):
            data = _vtk_zip(suffix, mode, positions, faces, place)
            cases.append(Case(f"zip of .{suffix}", data, "vtk", _with_vtk(suffix, data, place)))
    glb = write_glb(_animation(sequence))
    player = _gltf_player(glb, place) if find_spec("vtkmodules") is not None else None
    cases.append(Case("GLB of 21 targets", glb, "vtk", player))
    return cases


def _beating() -> MeshSequence:
    """Make a tube that contracts, in the numbers of a real scan: float32, mm."""
    s, theta = np.meshgrid(
        np.arange(SHAPE[0]) / SHAPE[0], 2 * np.pi * np.arange(SHAPE[1]) / SHAPE[1], indexing="ij"
    )
    frames = []
    for t in np.linspace(0, 2 * np.pi, N_FRAMES):
        radius = 25 - 6 * np.sin(t) * s + np.cos(3 * theta)
        frames.append(np.stack([radius * np.cos(theta), radius * np.sin(theta), 80 * s], axis=-1))
    return mesh_sequence(
        np.array(frames, dtype=np.float32).reshape(N_FRAMES, -1, 3),
        lattice_faces(CYLINDER, SHAPE),
        times=np.arange(N_FRAMES) / 25,
        unit="mm",
    )


def _animation(sequence: MeshSequence) -> MorphAnimation:
    rng = np.random.default_rng(1)
    return MorphAnimation(
        base=sequence.vertices[0].astype(np.float64),
        targets=rng.normal(size=(21, sequence.n_vertices, 3)),
        target_names=tuple(f"mode {i}" for i in range(21)),
        weights=rng.normal(size=(N_FRAMES, 21)),
        rotations=np.tile(np.eye(3), (N_FRAMES, 1, 1)),
        translations=np.zeros((N_FRAMES, 3)),
        faces=sequence.faces,
        times=sequence.times,
    )


def _read_hdf5(data: bytes) -> list[Any]:
    found: list[Any] = []

    def read(_: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            found.append(item[()])

    with h5py.File(io.BytesIO(data)) as file:
        file.visititems(read)
    return found


def _zip(
    kind: str, trimesh: Any, positions: NDArray[Any], faces: NDArray[Any], options: dict[str, Any]
) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for i, frame in enumerate(positions):
            mesh = trimesh.Trimesh(frame, faces, process=False)
            archive.writestr(f"{i}.{kind[:3]}", mesh.export(file_type=kind, **options))
    return buffer.getvalue()


def _with_trimesh(trimesh: Any, data: bytes) -> Callable[[], object]:
    def read() -> list[Any]:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            return [
                trimesh.load(io.BytesIO(archive.read(name)), file_type=name[-3:], process=False)
                for name in archive.namelist()
                if not name.endswith(".series")
            ]

    return read


def _vtk_zip(
    suffix: str, mode: str, positions: NDArray[Any], faces: NDArray[Any], place: Path
) -> bytes:
    support = import_module("vtkmodules.util.numpy_support")
    core, model = (import_module(f"vtkmodules.vtkCommon{n}") for n in ("Core", "DataModel"))
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for i, frame in enumerate(positions):
            points, cells, surface = core.vtkPoints(), model.vtkCellArray(), model.vtkPolyData()
            points.SetData(support.numpy_to_vtk(frame))
            cells.SetData(3, support.numpy_to_vtkIdTypeArray(faces.ravel().copy(), deep=1))
            surface.SetPoints(points)
            surface.SetPolys(cells)
            writer = _vtk_class(suffix, "Writer")()
            writer.SetInputData(surface)
            writer.SetFileName(str(place / "frame"))
            getattr(writer, f"Set{mode}")()
            writer.Write()
            archive.write(place / "frame", f"{i}.{suffix}")
    return buffer.getvalue()


def _with_vtk(suffix: str, data: bytes, place: Path) -> Callable[[], object]:
    to_numpy = import_module("vtkmodules.util.numpy_support").vtk_to_numpy

    def read() -> list[Any]:
        found = []
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            for name in archive.namelist():
                (place / "frame").write_bytes(archive.read(name))
                reader = _vtk_class(suffix, "Reader")()
                reader.SetFileName(str(place / "frame"))
                reader.Update()
                surface = reader.GetOutput()
                found += [
                    to_numpy(surface.GetPoints().GetData()),
                    to_numpy(surface.GetPolys().GetConnectivityArray()),
                ]
        return found

    return read


def _vtk_class(suffix: str, kind: str) -> Any:
    module, name = {"vtk": ("vtkIOLegacy", "vtkPolyData"), "vtp": ("vtkIOXML", "vtkXMLPolyData")}[
        suffix
    ]
    return getattr(import_module(f"vtkmodules.{module}"), name + kind)


def _gltf_player(data: bytes, place: Path) -> Callable[[], object]:
    (place / "surface.glb").write_bytes(data)
    reader_class = import_module("vtkmodules.vtkIOGeometry").vtkGLTFReader

    def play() -> list[Any]:
        reader = reader_class()
        reader.SetFileName(str(place / "surface.glb"))
        reader.SetApplyDeformationsToGeometry(True)
        reader.UpdateInformation()
        reader.EnableAnimation(0)
        bounds = [0.0] * 6
        for i in range(N_FRAMES):
            reader.UpdateTimeStep(i / 25)
            reader.GetOutputDataObject(0).GetBounds(bounds)
        return bounds

    return play


if __name__ == "__main__":
    for made in run():
        print(made)
