"""Surfaces of many sizes, and a real heart, as the libraries of others write them."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest
from numpy.typing import NDArray
from project import DATA

from modalmotion.formats import ParserProcess, read_sequence
from modalmotion.formats.volumes.reading import read_images
from modalmotion.limits import DEFAULT_LIMITS
from modalmotion.mesh.sequence import MeshSequence

pytest.importorskip("vtkmodules", reason="needs the extra 'vtk'")

HEART: Final = DATA / "heart" / "lv_endocardium.npz"
N_FRAMES: Final = 5
Floats = NDArray[Any]
Writer = Callable[[Path, Floats, NDArray[Any]], object]


@pytest.fixture(scope="module")
def parser() -> Iterator[ParserProcess]:
    with ParserProcess(DEFAULT_LIMITS, seconds=60) as process:
        yield process


def vtk(name: str) -> Any:
    return import_module(f"vtkmodules.{name}")


def to_vtk(array: Floats, name: str = "") -> Any:
    made = vtk("util.numpy_support").numpy_to_vtk(np.ascontiguousarray(array), deep=1)
    made.SetName(name)
    return made


def poly_data(positions: Floats, faces: NDArray[Any], *, has_data: bool) -> Any:
    points, cells = vtk("vtkCommonCore").vtkPoints(), vtk("vtkCommonDataModel").vtkCellArray()
    points.SetData(to_vtk(positions))
    cells.SetData(3, to_vtk(faces.astype(np.int64).ravel()))
    made = vtk("vtkCommonDataModel").vtkPolyData()
    made.SetPoints(points)
    made.SetPolys(cells)
    if has_data:
        unit = positions / np.linalg.norm(positions, axis=1, keepdims=True)
        of_points, of_cells = made.GetPointData(), made.GetCellData()
        # Below zero, and more than the bytes of the file: no sizes of a table of colours.
        of_points.SetScalars(to_vtk(positions[:, 2] - 1e3, "height"))
        of_points.SetNormals(to_vtk(unit, "normals"))
        of_points.AddArray(to_vtk(np.arange(len(positions), dtype=np.int32) % 7 - 3, "label"))
        of_cells.SetScalars(to_vtk(np.arange(len(faces), dtype=np.int32) + 10**7, "material"))
    return made


def legacy(path: Path, surface: Any, *, version: int, is_binary: bool) -> None:
    writer = vtk("vtkIOLegacy").vtkPolyDataWriter()
    writer.SetInputData(surface)
    writer.SetFileName(str(path))
    writer.SetFileVersion(version)
    (writer.SetFileTypeToBinary if is_binary else writer.SetFileTypeToASCII)()
    assert writer.Write() == 1


def sphere(n: int) -> tuple[Floats, NDArray[Any]]:
    """Surface of 2 + n (n - 2) vertices."""
    source = vtk("vtkFiltersSources").vtkSphereSource()
    source.SetThetaResolution(n)
    source.SetPhiResolution(n)
    source.Update()
    made, numbers = source.GetOutput(), vtk("util.numpy_support").vtk_to_numpy
    corners = numbers(made.GetPolys().GetConnectivityArray())
    return 31.7 * numbers(made.GetPoints().GetData()).astype(np.float64), corners.reshape(-1, 3)


@pytest.mark.parametrize("has_data", [False, True])
@pytest.mark.parametrize("version", [42, 51])
def test_legacy_files_of_every_size_are_read(
    tmp_path: Path, version: int, has_data: bool, parser: ParserProcess
) -> None:
    sizes = (4, 6, 8, 12, 16, 24, 32, 41, 64, 100)
    for n, dtype, is_binary in itertools.product(sizes, (np.float32, np.float64), (True, False)):
        positions, faces = sphere(n)
        positions = positions.astype(dtype)
        path = tmp_path / "sphere.vtk"
        surface = poly_data(positions, faces, has_data=has_data)
        legacy(path, surface, version=version, is_binary=is_binary)
        read = read_sequence(path, parser=parser).sequence
        # Text has six digits.
        most = 0.0 if is_binary else 5e-5
        assert np.abs(read.vertices[0] - positions).max() <= most
        assert np.array_equal(read.faces, faces)


def by_vtk(module: str, writer: str, **settings: Any) -> Writer:
    def write(path: Path, positions: Floats, faces: NDArray[Any]) -> None:
        made = getattr(vtk(module), writer)()
        made.SetInputData(poly_data(positions, faces, has_data="XML" in writer))
        made.SetFileName(str(path))
        for name, value in settings.items():
            getattr(made, name)(*([] if value is None else [value]))
        made.Write()

    return write


def by_vtk_legacy(path: Path, positions: Floats, faces: NDArray[Any], **form: Any) -> None:
    legacy(path, poly_data(positions, faces, has_data=True), **form)


def by_meshio(form: str, **settings: Any) -> Writer:
    def write(path: Path, positions: Floats, faces: NDArray[Any]) -> None:
        meshio = pytest.importorskip("meshio")
        mesh = meshio.Mesh(positions, [("triangle", faces)])
        meshio.write(path, mesh, file_format=form, **settings)

    return write


# Suffix and writer.
WRITERS: Final[dict[str, tuple[str, Writer]]] = {
    **{
        f"vtk {version} {'binary' if is_binary else 'text'}": (
            "vtk",
            partial(by_vtk_legacy, version=version, is_binary=is_binary),
        )
        for version, is_binary in itertools.product((42, 51), (True, False))
    },
    **{
        f"vtp {mode} {packing}": (
            "vtp",
            by_vtk(
                "vtkIOXML",
                "vtkXMLPolyDataWriter",
                **{f"SetDataModeTo{mode}": None, f"SetCompressorTypeTo{packing}": None},
            ),
        )
        for mode, packing in [
            ("Ascii", "None"),
            ("Binary", "None"),
            ("Binary", "ZLib"),
            ("Appended", "None"),
            ("Appended", "ZLib"),
        ]
    },
    "vtk's ply": ("ply", by_vtk("vtkIOPLY", "vtkPLYWriter")),
    "vtk's ply text": ("ply", by_vtk("vtkIOPLY", "vtkPLYWriter", SetFileTypeToASCII=None)),
    "vtk's obj": ("obj", by_vtk("vtkIOGeometry", "vtkOBJWriter")),
    "vtk's stl": ("stl", by_vtk("vtkIOGeometry", "vtkSTLWriter", SetFileTypeToBinary=None)),
    "vtk's stl text": ("stl", by_vtk("vtkIOGeometry", "vtkSTLWriter")),
    **{
        f"meshio's {form} {'binary' if is_binary else 'text'}": (
            form[:3],
            by_meshio(form, binary=is_binary),
        )
        for form, is_binary in itertools.product(("vtk42", "vtk", "ply", "stl"), (True, False))
    },
    "meshio's obj": ("obj", by_meshio("obj")),
    "meshio's off": ("off", by_meshio("off")),
}


@pytest.fixture(scope="module")
def heart() -> MeshSequence:
    if not HEART.is_file():
        pytest.skip("the real heart is absent")
    return read_sequence(HEART).sequence


@pytest.mark.filterwarnings("ignore::DeprecationWarning:meshio")
@pytest.mark.parametrize("name", WRITERS)
def test_a_real_heart_is_read_as_it_was_written(
    tmp_path: Path, name: str, heart: MeshSequence, parser: ParserProcess
) -> None:
    suffix, write = WRITERS[name]
    frames = heart.vertices[:N_FRAMES]
    for k, positions in enumerate(frames):
        write(tmp_path / f"frame_{k}.{suffix}", positions, heart.faces)
    read = read_sequence(tmp_path, parser=parser)
    assert read.format == suffix
    sent, came = frames, read.sequence.vertices
    if suffix == "stl":
        # It holds no vertices: the corners of its triangles are compared.
        assert read.sequence.n_vertices == heart.n_vertices
        sent, came = sent[:, heart.faces], came[:, read.sequence.faces]
    else:
        assert np.array_equal(read.sequence.faces, heart.faces)
    if name in ("vtk's obj", "vtk's ply text", "vtk's stl text"):
        # Six digits.
        assert np.abs(came - sent).max() <= 5e-4
    else:
        assert np.array_equal(came.astype(np.float32), sent)


def test_a_real_heart_as_vtkhdf_over_time(
    tmp_path: Path, heart: MeshSequence, parser: ParserProcess
) -> None:
    path = tmp_path / "heart.vtkhdf"
    by_vtk("vtkIOHDF", "vtkHDFWriter")(path, heart.vertices[0], heart.faces)
    read = read_sequence(path, parser=parser).sequence
    assert np.array_equal(read.vertices[0], heart.vertices[0])
    assert np.array_equal(read.faces, heart.faces)


@pytest.mark.parametrize("suffix", [".nii", ".nii.gz"])
@pytest.mark.parametrize("kind", ["Nifti1Image", "Nifti2Image"])
@pytest.mark.parametrize("dtype", ["<i2", ">i2", "<f4", "<f8"])
def test_images_of_a_real_heart_as_nibabel_writes_them(
    tmp_path: Path, suffix: str, kind: str, dtype: str, parser: ParserProcess
) -> None:
    nibabel = pytest.importorskip("nibabel")
    series = DATA / "cine" / "dicom" / "Se2"
    if not series.is_dir():
        pytest.skip("the real images are absent")
    images = read_images(series, parser=parser)
    planes = [plane for frame in images.frames for plane in getattr(frame, "planes", ())]
    values = np.stack([plane.values for plane in planes], axis=-1)[:, :, None]
    affine = np.column_stack(
        [planes[0].affine[:, :2], planes[0].thickness * planes[0].normal, planes[0].origin]
    )
    full = np.diag([-1.0, -1.0, 1.0, 1.0]) @ np.vstack([affine, [0, 0, 0, 1]])
    written = getattr(nibabel, kind)(values.astype(dtype), full)
    written.header.set_xyzt_units("mm", "sec")
    written.header["pixdim"][4] = 0.04
    nibabel.save(written, tmp_path / f"heart{suffix}")
    read = read_images(tmp_path / f"heart{suffix}", parser=parser)
    assert read.times is not None
    assert np.allclose(read.times, 0.04 * np.arange(len(planes)))
    for plane, frame in zip(planes, read.frames, strict=True):
        volume: Any = frame
        assert np.array_equal(volume.values[:, :, 0], plane.values)
        assert np.allclose(volume.affine[:, :2], plane.affine[:, :2], atol=1e-4)
        assert np.allclose(volume.affine[:, 3], plane.origin, atol=1e-3)
