"""Frames in files of their own: archives, folders, order, times, one connectivity."""

from __future__ import annotations

import io
import stat
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from format_samples import (
    FACES,
    MESH_WRITERS,
    N_FRAMES,
    TIMES,
    VERTICES,
    frame_zip,
    obj,
    off,
    ply_binary,
    pvd,
    sequence,
    series,
    stl_binary,
    zipped,
)
from hypothesis import given
from hypothesis import strategies as st

from modalmotion.errors import (
    ConnectivityError,
    InputError,
    LimitError,
    MalformedFileError,
    NonFiniteError,
    ShapeError,
)
from modalmotion.formats import ReadLimits, ReadOptions, read_sequence, write_ply_zip
from modalmotion.formats.frame import merge_corners
from modalmotion.formats.frame_files import natural_key, read_series, write_series
from modalmotion.mesh.sequence import mesh_sequence
from modalmotion.progress import Progress
from modalmotion.representation import FloatArray


@pytest.mark.parametrize("name", MESH_WRITERS)
def test_a_zip_of_frames_is_a_sequence(name: str) -> None:
    suffix, write = MESH_WRITERS[name]
    read = read_sequence(frame_zip(write, suffix))
    positions = read.sequence.vertices
    assert read.format == suffix
    if suffix == "stl":
        # Numbered by first appearance: the same corners, whatever the vertices are called.
        assert np.array_equal(
            positions[:, read.sequence.faces], VERTICES[:, FACES].astype(positions.dtype)
        )
        assert positions.shape == (N_FRAMES, len(np.unique(FACES)), 3)
    else:
        assert np.array_equal(positions, VERTICES)
        assert np.array_equal(read.sequence.faces, FACES)


@pytest.mark.parametrize("timed", [True, False])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_written_zip_reads_back_with_the_same_id(timed: bool, dtype: type) -> None:
    positions: FloatArray = np.random.default_rng(1).normal(size=(12, 12, 3)).astype(dtype)
    given_ = mesh_sequence(
        positions,
        FACES,
        times=np.arange(12) / 7 if timed else None,
        unit="mm",
        topology="cup",
        grid=(3, 4),
    )
    data = write_ply_zip(given_)
    assert data == write_ply_zip(given_)
    read = read_sequence(data)
    assert read.sequence.id == given_.id
    assert read.sequence.vertices.dtype == dtype
    assert (read.unit_from, read.times_from) == ("file", "file" if timed else None)


def test_numbers_in_names_count_as_numbers() -> None:
    names = ["f10.ply", "f9.ply", "F2.ply", "f1.ply", "f001b.ply", "f" + "9" * 5000 + ".ply"]
    ordered = sorted(names, key=natural_key)
    assert ordered[:5] == ["f1.ply", "f001b.ply", "F2.ply", "f9.ply", "f10.ply"]


@given(st.lists(st.integers(0, 10**6), unique=True, min_size=1))
def test_natural_order_is_that_of_the_numbers(numbers: list[int]) -> None:
    names = [f"scan {n}.vtk" for n in numbers]
    assert sorted(names, key=natural_key) == [f"scan {n}.vtk" for n in sorted(numbers)]


def test_frames_come_in_natural_order() -> None:
    frames = np.arange(12)[:, None, None] + np.zeros((12, 12, 3))
    members = {f"a/f{i}.obj": obj(frames[i]) for i in reversed(range(12))}
    read = read_sequence(zipped(members | {"notes.txt": b"x", ".DS_Store": b"", "__MACOSX/a": b""}))
    assert np.array_equal(read.sequence.vertices, frames)
    assert set(read.ignored) == {"mtllib", "o", "vn", "vt", "usemtl", "notes.txt"}


@pytest.mark.parametrize(("name", "write"), [("x.pvd", pvd), ("x.ply.series", series)])
def test_a_list_of_frames_gives_order_and_times(
    name: str, write: Callable[[list[tuple[float, str]]], bytes]
) -> None:
    members = {f"data/{c}.ply": ply_binary(VERTICES[i]) for i, c in enumerate("bca")}
    listed = [(t, f"data/{c}.ply") for t, c in zip(TIMES, "bca", strict=True)]
    for entries in (listed, listed[::-1]):
        read = read_sequence(zipped(members | {name: write(entries)}))
        assert np.array_equal(read.sequence.vertices, VERTICES)
        assert read.sequence.times is not None
        assert read.sequence.times.tolist() == list(TIMES)
        assert read.times_from == "file"
        assert any("sorted" in note for note in read.notes) == (entries != listed)


def test_what_is_written_as_a_series_reads_back() -> None:
    written = write_series(["a", "b"], [0.1, 1 / 3])
    assert read_series(written).times == (0.1, 1 / 3)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "not of the form"),
        (b"[]", "not of the form"),
        (b'{"files": []}', "no frames"),
        (b'{"files": [{"name": "a"}]}', "not of the form"),
        (b'{"files": [{"name": "a", "time": "x"}]}', "could not convert"),
        (b'{"files": [{"name": 3, "time": 1}]}', "file '3'"),
        (b"[" * 100_000, "not of the form"),
        (b"<", "not readable XML"),
        (b"<VTKFile type='PolyData'/>", "type 'PolyData'"),
        (b"<VTKFile type='Collection'><DataSet/></VTKFile>", "could not convert"),
        (
            b"<VTKFile type='Collection'><DataSet timestep='0' part='1' file='a'/></VTKFile>",
            "several parts",
        ),
        (b"<!DOCTYPE x SYSTEM 'file:///etc/passwd'><VTKFile type='Collection'/>", "document type"),
        (
            b"<!DOCTYPE x [<!ENTITY a 'ha'><!ENTITY b '&a;&a;&a;'>]><VTKFile>&b;</VTKFile>",
            "document type",
        ),
    ],
)
def test_a_list_that_is_none_says_why(data: bytes, words: str) -> None:
    with pytest.raises(MalformedFileError) as caught:
        read_series(data)
    assert words in str(caught.value)
    assert caught.value.remedy


def test_a_list_may_be_no_longer_than_the_limit() -> None:
    with pytest.raises(LimitError):
        read_series(series([(float(i), "a") for i in range(11)]), ReadLimits(frames=10))


def changed(write: Callable[..., bytes], suffix: str, frame: int, content: bytes) -> bytes:
    members = {f"f{i}.{suffix}": write(VERTICES[i]) for i in range(N_FRAMES)}
    return zipped(members | {f"f{frame}.{suffix}": content})


TURNED = FACES[:, [1, 2, 0]]


@pytest.mark.parametrize(
    ("data", "error", "frame", "vertex", "words"),
    [
        (changed(obj, "obj", 2, obj(VERTICES[2][:-1], FACES[:6])), ShapeError, 2, None, "11"),
        (changed(off, "off", 1, off(VERTICES[1], FACES[1:])), ConnectivityError, 1, None, "11"),
        (changed(off, "off", 2, off(VERTICES[2], TURNED)), ConnectivityError, 2, None, "Face 0"),
        (changed(obj, "obj", 1, ply_binary(VERTICES[1])), ShapeError, 1, None, "PLY"),
        (changed(obj, "obj", 1, b""), MalformedFileError, 1, None, "empty"),
        (changed(obj, "obj", 1, b"\x00\x01"), MalformedFileError, 1, None, "Unrecognised"),
        (changed(obj, "obj", 1, zipped({})), MalformedFileError, 1, None, "ZIP"),
        (changed(obj, "obj", 1, obj(VERTICES[1])[:9]), MalformedFileError, 1, None, "recognised"),
        (
            changed(
                obj, "obj", 2, obj(np.where(VERTICES[2] == VERTICES[2][4], np.nan, VERTICES[2]))
            ),
            NonFiniteError,
            2,
            4,
            "f2.obj",
        ),
        (
            changed(stl_binary, "stl", 1, stl_binary(VERTICES[1], FACES[:-1])),
            ShapeError,
            1,
            None,
            "11 triangles",
        ),
        (
            changed(stl_binary, "stl", 2, stl_binary(VERTICES[2], FACES[::-1])),
            ConnectivityError,
            2,
            1,
            "are apart",
        ),
        (
            changed(obj, "obj", 1, obj(VERTICES[1]).replace(b"# a comment", b"# SPACE=RAS")),
            ShapeError,
            1,
            None,
            "RAS",
        ),
    ],
)
def test_a_frame_that_does_not_belong_is_named(
    data: bytes, error: type[InputError], frame: int, vertex: int | None, words: str
) -> None:
    with pytest.raises(error) as caught:
        read_sequence(data)
    assert type(caught.value) is error
    assert (caught.value.frame, caught.value.vertex) == (frame, vertex)
    assert f"Frame {frame} ('f{frame}." in str(caught.value)
    assert words in str(caught.value)
    assert caught.value.remedy


def test_faces_of_all_frames_that_name_no_vertex_are_refused() -> None:
    with pytest.raises(ConnectivityError, match="Face 11 names vertex 99"):
        read_sequence(frame_zip(lambda p: obj(p, [*FACES[:-1], [0, 1, 99]]), "obj"))


def test_one_map_of_the_first_frame_serves_all() -> None:
    # In frame 1 two vertices meet by chance; a map of its own would make them one.
    met = VERTICES[1].copy()
    met[3] = met[7]
    read = read_sequence(changed(stl_binary, "stl", 1, stl_binary(met)))
    assert read.sequence.n_vertices == 12
    assert np.array_equal(read.sequence.vertices[1][read.sequence.faces], met[FACES])


@given(st.integers(0, 2**32 - 1), st.integers(1, 6))
def test_merging_is_that_of_a_dictionary(seed: int, spread: int) -> None:
    corners = np.random.default_rng(seed).integers(-spread, spread, size=(30, 3)) * 0.5
    corners[corners == 0.5] = -0.0
    first: dict[tuple[float, ...], int] = {}
    for row in corners.tolist():
        first.setdefault(tuple(x + 0.0 for x in row), len(first))
    merged = merge_corners(corners)
    assert merged.vertex_of.tolist() == [first[tuple(x + 0.0 for x in r)] for r in corners.tolist()]
    assert np.array_equal(merged.apply(corners, 0)[merged.vertex_of], corners)


def with_member(name: str, content: bytes = b"x", attributes: int = 0) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("f0.obj", obj(VERTICES[0]))
        info = zipfile.ZipInfo("placeholder")
        info.filename, info.external_attr = name, attributes
        archive.writestr(info, content)
    return buffer.getvalue()


LINK = (stat.S_IFLNK | 0o777) << 16


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (with_member("../f1.obj"), "leads out"),
        (with_member("a/../../f1.obj"), "leads out"),
        (with_member("/etc/f1.obj"), "leads out"),
        (with_member("..\\f1.obj"), "leads out"),
        (with_member("C:f1.obj"), "leads out"),
        (with_member("f1.obj", b"/etc/passwd", LINK), "a link"),
        (with_member("sub", b"/etc", LINK), "a link"),
        (zipped({}), "no frames"),
        (zipped({"readme.txt": b"x"}), "no frames"),
        (zipped({"a.obj": b"x", "a.ply": b"x"}), "several kinds"),
        (zipped({"a.pvd": b"x", "b.pvd": b"x"}), "several lists"),
        (zipped({"a.pvd": pvd([(0, "b.ply")])}), "not there"),
        (zipped({"a.pvd": pvd([(0, "../b.ply")])}), "leads out"),
        (zipped({"a.pvd": pvd([(0, "/etc/passwd")])}), "leads out"),
        (zipped({"a.obj": obj(VERTICES[0])}, zipfile.ZIP_LZMA), "deflate"),
        (frame_zip(obj, "obj")[:-200], "not a readable .zip"),
        (frame_zip(obj, "obj")[:700], "not a readable .zip"),
        (frame_zip(obj, "obj").replace(b"frame_1.obj", b"frame_0.obj"), "twice"),
        (frame_zip(obj, "obj").replace(b"frame_1.obj", b"\0rame_1.obj"), ""),
        (zipped({"": b"x", "a.obj": obj(VERTICES[0])}), "without a name"),
    ],
)
@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_an_archive_that_leads_elsewhere_is_refused(data: bytes, words: str) -> None:
    with pytest.raises(MalformedFileError) as caught:
        read_sequence(data)
    assert words in str(caught.value)
    assert caught.value.remedy


def test_a_damaged_member_is_named() -> None:
    data = bytearray(frame_zip(obj, "obj"))
    data[60] ^= 0xFF
    with pytest.raises(MalformedFileError, match=r"frame_0\.obj"):
        read_sequence(bytes(data))


@pytest.mark.parametrize(
    ("limits", "name"),
    [
        (ReadLimits(frames=2), "frames"),
        (ReadLimits(vertices=11), "vertices"),
        (ReadLimits(faces=11), "faces"),
        (ReadLimits(decompressed_bytes=1500), "decompressed_bytes"),
    ],
)
def test_each_limit_is_named_by_its_error(limits: ReadLimits, name: str) -> None:
    with pytest.raises(LimitError) as caught:
        read_sequence(frame_zip(ply_binary, "ply"), ReadOptions(limits=limits))
    assert caught.value.limit == name


def test_a_bomb_is_refused_by_what_it_declares() -> None:
    data = zipped({"a.obj": bytes(1_000_000)})
    assert len(data) < 2_000
    with pytest.raises(LimitError) as caught:
        read_sequence(data, ReadOptions(limits=ReadLimits(decompressed_bytes=999_999)))
    assert caught.value.limit == "decompressed_bytes"


def test_a_folder_or_a_pattern_is_a_sequence(tmp_path: Path) -> None:
    for i in range(N_FRAMES):
        (tmp_path / f"scan{i * 6}.obj").write_bytes(obj(VERTICES[i]))
        (tmp_path / f"other{i}.off").write_bytes(off(VERTICES[-1 - i]))
    seen: list[Progress] = []
    read = read_sequence(tmp_path / "scan*.obj", progress=seen.append)
    assert np.array_equal(read.sequence.vertices, VERTICES)
    assert seen == [Progress(k, 3) for k in (1, 2, 3)]
    with pytest.raises(MalformedFileError, match="several kinds"):
        read_sequence(tmp_path)
    for path in tmp_path.glob("other*"):
        path.unlink()
    assert read_sequence(tmp_path).sequence.id == read.sequence.id


def test_a_list_in_a_folder_names_frames_beneath_it(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    for i in range(N_FRAMES):
        (tmp_path / "run" / f"{i}.ply").write_bytes(ply_binary(VERTICES[-1 - i]))
    entries = [(TIMES[i], f"run/{N_FRAMES - 1 - i}.ply") for i in range(N_FRAMES)]
    (tmp_path / "run.pvd").write_bytes(pvd(entries))
    read = read_sequence(tmp_path)
    assert read.sequence.id == sequence(times=TIMES).id


@pytest.mark.parametrize("name", ["absent.ply", "absent*.ply", "."])
def test_what_is_not_there_is_an_error_of_ours(tmp_path: Path, name: str) -> None:
    with pytest.raises(MalformedFileError) as caught:
        read_sequence(tmp_path / name)
    assert caught.value.remedy


def test_a_folder_of_images_says_what_reads_it(tmp_path: Path) -> None:
    folder = tmp_path / "x.nii.gz"
    folder.mkdir()
    (folder / "frame.nii.gz").write_bytes(b"\x1f\x8b")
    with pytest.raises(MalformedFileError, match="no frames among 1 file") as caught:
        read_sequence(folder)
    assert "modalmotion report" in caught.value.remedy
