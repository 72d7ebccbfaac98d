"""STL, PLY, OBJ and OFF: one mesh a file."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from format_samples import (
    FACES,
    MESH_WRITERS,
    VERTICES,
    obj,
    off,
    ply_binary,
    ply_header,
    ply_text,
    stl_binary,
    stl_text,
    vtk_text,
    vtp_text,
)
from hypothesis import given
from hypothesis import strategies as st

from modalmotion.errors import InputError, LimitError, MalformedFileError
from modalmotion.formats.frame import Frame, triangulate
from modalmotion.formats.ply import read_ply, write_ply
from modalmotion.formats.text_meshes import read_obj, read_off, read_stl
from modalmotion.formats.vtk_legacy import read_vtk_legacy
from modalmotion.formats.vtk_xml import read_vtk_xml
from modalmotion.limits import ReadLimits
from modalmotion.representation import FloatArray

READERS: dict[str, Callable[..., Frame]] = {
    "stl": read_stl,
    "ply": read_ply,
    "obj": read_obj,
    "off": read_off,
}
MIXED = [*FACES.tolist(), [0, 1, 2, 3, 4], [5, 6, 7, 8]]
MIXED_FANS = [*FACES.tolist(), [0, 1, 2], [0, 2, 3], [0, 3, 4], [5, 6, 7], [5, 7, 8]]


@pytest.mark.parametrize("name", MESH_WRITERS)
def test_vertices_and_faces_stand_in_the_order_of_the_file(name: str) -> None:
    suffix, write = MESH_WRITERS[name]
    frame = READERS[suffix](write(VERTICES[1]))
    if suffix == "stl":
        assert frame.is_soup
        assert np.array_equal(frame.positions[frame.faces], VERTICES[1][FACES])
    else:
        assert np.array_equal(frame.positions, VERTICES[1])
        assert np.array_equal(frame.faces, FACES)


@pytest.mark.parametrize("name", MESH_WRITERS)
def test_the_formats_own_library_reads_the_same_bits(name: str) -> None:
    trimesh: Any = pytest.importorskip("trimesh")
    suffix, write = MESH_WRITERS[name]
    rng = np.random.default_rng(5)
    positions = rng.normal(scale=100.0, size=(40, 3)).astype(np.float32)
    faces = np.concatenate([rng.permutation(40)[:39].reshape(-1, 3) for _ in range(5)])
    data = write(positions, faces)
    if suffix == "obj":
        # Of normals and textures it makes more vertices, in another order.
        data = data.replace(b"/1/1", b"")
    # The name of a solid is taken for a corner.
    data = data.replace(b"solid vertex 1 2 3", b"solid")
    theirs = trimesh.load(
        io.BytesIO(data), file_type=suffix, process=False, maintain_order=True, skip_materials=True
    )
    ours = READERS[suffix](data)
    assert np.array_equal(theirs.vertices, ours.positions)
    assert np.array_equal(theirs.faces, ours.faces)


@pytest.mark.parametrize("kind", ["stl", "ply", "obj", "off"])
def test_what_the_formats_own_library_writes_is_read(kind: str) -> None:
    trimesh: Any = pytest.importorskip("trimesh")
    mesh = trimesh.Trimesh(VERTICES[0], FACES, process=False)
    data = mesh.export(file_type=kind)
    frame = READERS[kind](data if isinstance(data, bytes) else data.encode())
    assert np.array_equal(frame.positions[frame.faces], VERTICES[0][FACES])


@pytest.mark.parametrize("write", [ply_text, ply_binary, obj, off])
def test_polygons_become_fans_from_their_first_corner(write: Callable[..., bytes]) -> None:
    suffix = write.__name__.partition("_")[0]
    frame = READERS[suffix](write(VERTICES[0], MIXED))
    assert frame.faces.tolist() == MIXED_FANS
    assert "(2)" in frame.notes[0]


@given(st.lists(st.integers(0, 7), max_size=8))
def test_fans_are_those_of_a_loop(sizes: list[int]) -> None:
    corners = np.random.default_rng(1).integers(0, 99, sum(sizes))
    offsets = np.cumsum([0, *sizes])
    expected = [
        [corners[start], corners[start + i], corners[start + i + 1]]
        for start, size in zip(offsets, sizes, strict=False)
        for i in range(1, size - 1)
    ]
    faces = triangulate(sizes, corners).faces
    assert faces.shape == (len(expected), 3)
    assert np.array_equal(faces, np.array(expected).reshape(-1, 3))


@pytest.mark.parametrize(
    ("write", "read"),
    [
        (ply_binary, read_ply),
        (ply_text, read_ply),
        (obj, read_obj),
        (off, read_off),
        (vtk_text, read_vtk_legacy),
        (vtp_text, read_vtk_xml),
    ],
)
def test_triangles_of_polygons_are_limited(
    write: Callable[..., bytes], read: Callable[..., Frame]
) -> None:
    data = write(VERTICES[0], [[*range(12)]])
    assert len(read(data, ReadLimits(faces=10)).faces) == 10
    with pytest.raises(LimitError):
        read(data, ReadLimits(faces=9))


def test_seams_of_textures_and_normals_move_no_vertex() -> None:
    lines = [b"v 0 0 0", b"v 1 0 0", b"v 1 1 0", b"v 0 1 0", b"v 9 9 9"]
    lines += [b"vn 0 0 1", b"vn 0 1 0", b"vt 0 0", b"vt 1 1"]
    lines += [b"usemtl b", b"f 4//1 3//1 2//2", b"usemtl a", b"f 1/1/2 2/2/1 3/1/1", b""]
    frame = read_obj(b"\n".join(lines))
    assert frame.positions[:, 0].tolist() == [0, 1, 1, 0, 9]
    assert frame.faces.tolist() == [[3, 2, 1], [0, 1, 2]]


def test_negative_indices_count_from_the_last_vertex_so_far() -> None:
    frame = read_obj(b"v 0 0 0\nv 1 0 0\nv 1 1 0\nf -3 -2 -1\nv 2 2 2\nf -1 -2 -3\n")
    assert frame.faces.tolist() == [[0, 1, 2], [3, 2, 1]]


def test_words_set_in_and_tabs_are_read() -> None:
    plain = obj(VERTICES[0])
    other = plain.replace(b"\nv ", b"\n  v\t").replace(b"\nf ", b"\nf\t") + b"f 1 2 3 4\n"
    first, second = read_obj(plain), read_obj(other)
    assert np.array_equal(first.positions, second.positions)
    assert np.array_equal(first.faces, second.faces[:-2])
    assert first.ignored == second.ignored


def test_several_solids_are_one_surface() -> None:
    twice = stl_text(VERTICES[0]) + stl_text(VERTICES[1]).replace(b"\n", b"\r\n")
    frame = read_stl(twice)
    both = np.concatenate([VERTICES[0][FACES], VERTICES[1][FACES]])
    assert np.array_equal(frame.positions.reshape(-1, 3, 3), both)


def test_a_line_that_goes_on_is_one_line() -> None:
    frame = read_obj(b"v 0 0 \\\n0\nv 1 0 0\nv 1 1 0\nf 1 2 \\\r\n3\n")
    assert frame.faces.tolist() == [[0, 1, 2]]


@pytest.mark.parametrize("order", ["<", ">"])
def test_both_byte_orders_read_alike(order: str) -> None:
    frame = read_ply(ply_binary(VERTICES[0], MIXED, order))
    assert np.array_equal(frame.positions, VERTICES[0])
    assert frame.faces.tolist() == MIXED_FANS
    assert frame.positions.dtype == np.float32


def test_the_type_in_a_ply_header_is_its_precision_in_text_too() -> None:
    body = b"0.1 0.1 0.1 7\n"
    single = read_ply(ply_header("ascii", 1, 0) + body).positions
    double = read_ply(ply_header("ascii", 1, 0, "double") + body).positions
    assert single.dtype == np.float32
    assert single[0, 0] == np.float32(0.1)
    assert double[0, 0] == 0.1


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_written_ply_reads_back_bit_for_bit(dtype: type) -> None:
    positions: FloatArray = np.random.default_rng(2).normal(size=(9, 3)).astype(dtype)
    frame = read_ply(write_ply(positions, FACES[:2] % 9, {"unit": "mm", "grid": "3 3"}))
    assert frame.positions.dtype == dtype
    assert np.array_equal(frame.positions, positions)
    assert np.array_equal(frame.faces, FACES[:2] % 9)
    assert (frame.stated("unit"), frame.stated("grid")) == ("mm", "3 3")


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("stl", stl_binary(VERTICES[0], header=b"3D Slicer output. SPACE=LPS")),
        ("stl", stl_text(VERTICES[0]).replace(b"solid vertex", b"solid SPACE=LPS", 1)),
        ("ply", ply_text(VERTICES[0]).replace(b"made by", b"SPACE=LPS")),
        ("obj", obj(VERTICES[0]).replace(b"# a", b"# 3D Slicer output. SPACE=LPS")),
    ],
)
def test_a_stated_coordinate_system_is_found(name: str, data: bytes) -> None:
    assert READERS[name](data).stated("coordinate_system") == "LPS"


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("stl", stl_binary(VERTICES[0])[:-1], "not a complete STL"),
        ("stl", stl_binary(VERTICES[0]) + b"\0", "685 bytes"),
        ("stl", stl_binary(VERTICES[0], FACES[:0]), "no triangle"),
        ("stl", stl_text(VERTICES[0]).rpartition(b"facet normal")[0], "ends within"),
        ("stl", stl_text(VERTICES[0]).replace(b"endfacet", b"", 1), "Facet 0"),
        ("stl", stl_text(VERTICES[0]).replace(b"loop\nvertex", b"loop\nvertex 1", 3), "Facet 0"),
        (
            "stl",
            stl_text(VERTICES[0]).replace(b"solid vertex", b"facet vertex", 1),
            "not a complete",
        ),
        ("stl", stl_text(VERTICES[0]).replace(b"endsolid", b"solid"), "Facet 12"),
        ("stl", stl_text(VERTICES[0] * 0).replace(b"vertex 0.0", b"vertex a", 1), "Facet 0"),
        ("off", off(VERTICES[0]).replace(b"12 12", b"12 13"), "fewer"),
        ("off", off(VERTICES[0]).replace(b"12 12", b"12 11"), "more"),
        ("off", off(VERTICES[0]).replace(b"12 12", b"40 12"), "fewer"),
        ("off", off(VERTICES[0]).replace(b"12 12", b"-1 12"), "counts"),
        ("off", off(VERTICES[0]).replace(b"12 12", b"a b"), "counts"),
        ("off", b"OFF BINARY\n", "counts"),
        ("off", off(VERTICES[0], [[0, 1, 2]]).replace(b"3 0 1 2", b"9 0 1 2"), "Polygon 0"),
        ("obj", b"# nothing\n", "no vertex"),
        ("obj", obj(VERTICES[0]).replace(b"f 1/", b"f 0/"), "counting starts at 1"),
        ("obj", obj(VERTICES[0]).replace(b"f 1/", b"f x/"), "face"),
        ("obj", b"v 0 0\n", "2 coordinates"),
        ("obj", b"v 0 0 0\nf 1 1 -2\n", "vertex -2"),
        ("obj", b"v 0 0 0\nhello\n", "hello"),
        ("obj", b"v 0 0 0\nf 1 1 99999999999999999999\n", "face"),
        ("ply", ply_binary(VERTICES[0])[:-1], "ends after"),
        ("ply", ply_binary(VERTICES[0], MIXED)[:-1], "ends after 13"),
        ("ply", ply_binary(VERTICES[0]) + b"x", "more than its header"),
        ("ply", ply_text(VERTICES[0])[:-6], "ends after 11"),
        ("ply", ply_header("ascii", 2, 0) + b"0 0 0\n7 1 1 1 7\n", "Row 0"),
        ("ply", ply_header("ascii", 4, 0) + b"0 0 0 7\n1 1 1 7\n2 2 2 7 3 3 3 7\n", "Row 2"),
        ("ply", ply_header("ascii", 1, 1) + b"0 0 0 7\n3 0 1 nan 0\n", "fractions"),
        ("ply", ply_header("ascii", 1, 0) + b"0 0 zero 7\n", "zero"),
        ("ply", ply_text(VERTICES[0]) + b"1 2 3\n", "more than its header"),
        ("ply", b"ply\nformat ascii 1.0\n", "no PLY header"),
        ("ply", b"ply\nelement vertex 0\nend_header\n", "states no format"),
        ("ply", b"ply\nformat ascii 1.0\nelement face 0\nend_header\n", "elements"),
        ("ply", ply_header("ascii", 1, 0).replace(b"float x", b"string x"), "header has a line"),
        ("ply", ply_header("ascii", -1, 0), "header has a line"),
        ("ply", ply_header("ascii", 1, 0).replace(b"float x", b"float u") + b"0 0 0 7\n", "x, y"),
        ("ply", b"ply\nformat ascii 1.0\nelement vertex 2\nend_header\n", "no properties"),
    ],
)
def test_what_cannot_be_read_says_why(name: str, data: bytes, words: str) -> None:
    with pytest.raises(MalformedFileError) as caught:
        READERS[name](data)
    assert words in str(caught.value)
    assert caught.value.remedy


def test_numbers_in_text_are_not_cut_to_whole_ones() -> None:
    head = ply_header("ascii", 1, 0).replace(b"float x", b"uchar x")
    assert read_ply(head + b"300.5 0 0 7\n").positions.tolist() == [[300.5, 0.0, 0.0]]


@pytest.mark.parametrize("name", MESH_WRITERS)
def test_limits_hold(name: str) -> None:
    suffix, write = MESH_WRITERS[name]
    data = write(VERTICES[0])
    limits = [ReadLimits(faces=11)] + ([] if suffix == "stl" else [ReadLimits(vertices=11)])
    for limit in limits:
        with pytest.raises(LimitError):
            READERS[suffix](data, limit)


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("ply", ply_header("ascii", 10**9, 0) + b"0 0 0 7\n"),
        ("ply", ply_header("binary_little_endian", 10**9, 0) + bytes(50)),
        ("ply", ply_header("binary_little_endian", 1, 10**9) + bytes(50)),
        ("off", b"OFF\n1000000000 0 0\n0 0 0\n"),
        ("stl", bytes(80) + (10**9).to_bytes(4, "little") + bytes(50)),
    ],
)
def test_a_thousand_million_declared_are_refused_without_limits_too(name: str, data: bytes) -> None:
    with pytest.raises(MalformedFileError):
        READERS[name](data)


@given(st.binary(max_size=200), st.sampled_from(sorted(READERS)))
def test_noise_is_refused(noise: bytes, name: str) -> None:
    start = {"stl": b"solid ", "ply": b"ply\n", "obj": b"v 0 0 0\n", "off": b"OFF\n"}[name]
    for data in (noise, start + noise):
        try:
            READERS[name](data)
        except InputError as error:
            assert error.remedy  # noqa: PT017 - both outcomes are allowed
