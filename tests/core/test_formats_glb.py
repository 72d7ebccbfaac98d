"""GLB animations of morph targets, in and out."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from format_samples import FACES, N_FRAMES, N_VERTICES, TIMES, VERTICES, animation, edited_glb
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from modalmotion.errors import (
    InputError,
    LimitError,
    MalformedFileError,
    NonFiniteError,
    ParameterError,
    ShapeError,
)
from modalmotion.formats import ReadLimits, ReadOptions, read_sequence, write_glb
from modalmotion.formats.gltf.channels import Channel
from modalmotion.formats.gltf.container import read_container, write_container
from modalmotion.formats.gltf.morph_animation import MorphAnimation
from modalmotion.formats.gltf.quaternions import to_matrices, to_quaternions

# Positions are float32; the base holds the least weights' share, so a few roundings add up.
SINGLE = 16 * float(np.spacing(np.float32(np.abs(VERTICES).max())))


def played(data: bytes) -> NDArray[np.float64]:
    """The simplest player of files as we write them, from the bytes on."""
    (length,) = struct.unpack_from("<I", data, 12)
    document = json.loads(data[20 : 20 + length])
    binary = data[20 + length + 8 :]

    def numbers(accessor: int) -> NDArray[np.float64]:
        view = document["bufferViews"][document["accessors"][accessor]["bufferView"]]
        start = view["byteOffset"]
        return np.frombuffer(binary[start : start + view["byteLength"]], "<f4").astype(float)

    primitive = document["meshes"][0]["primitives"][0]
    base = numbers(primitive["attributes"]["POSITION"]).reshape(-1, 3)
    targets = [numbers(t["POSITION"]).reshape(-1, 3) for t in primitive.get("targets", [])]
    moved = document["animations"][0]
    by_path = {
        c["target"]["path"]: numbers(moved["samplers"][c["sampler"]]["output"])
        for c in moved["channels"]
    }
    frames = []
    for i, turn in enumerate(Rotation.from_quat(by_path["rotation"].reshape(-1, 4))):
        weights = by_path["weights"].reshape(-1, len(targets))[i] if targets else []
        shape = base + sum(w * t for w, t in zip(weights, targets, strict=True))
        frames.append(turn.apply(shape) + by_path["translation"].reshape(-1, 3)[i])
    return np.array(frames)


@pytest.mark.parametrize("n_targets", [0, 1, 5])
def test_what_is_played_is_what_was_given(n_targets: int) -> None:
    given = animation(n_targets)
    data = write_glb(given)
    assert data == write_glb(given)
    expected = given.positions()
    assert np.abs(played(data) - expected).max() < SINGLE
    read = read_sequence(data)
    assert np.abs(read.sequence.vertices - expected).max() < SINGLE
    assert np.array_equal(read.sequence.faces, FACES)
    assert read.sequence.times is not None
    assert read.sequence.times.tolist() == list(TIMES)
    assert (read.sequence.unit, read.unit_from, read.times_from) == ("mm", "file", "file")


def test_a_second_loader_finds_the_same_bounding_box(tmp_path: Path) -> None:
    pytest.importorskip("vtkmodules", reason="needs the extra 'vtk'")
    given = animation(5)
    path = tmp_path / "surface.glb"
    path.write_bytes(write_glb(given))
    reader = import_module("vtkmodules.vtkIOGeometry").vtkGLTFReader()
    reader.SetFileName(str(path))
    reader.SetApplyDeformationsToGeometry(True)
    reader.UpdateInformation()
    assert reader.GetAnimationDuration(0) == TIMES[-1]
    reader.EnableAnimation(0)
    for time, expected in zip(TIMES, given.positions(), strict=True):
        reader.UpdateTimeStep(time)
        bounds = [0.0] * 6
        reader.GetOutputDataObject(0).GetBounds(bounds)
        assert np.abs(np.array(bounds[0::2]) - expected.min(axis=0)).max() < SINGLE
        assert np.abs(np.array(bounds[1::2]) - expected.max(axis=0)).max() < SINGLE


def test_weights_run_from_zero_to_one_and_their_ranges_are_kept() -> None:
    given = animation(2)
    container = read_container(write_glb(given))
    document = container.document
    ranges = document["asset"]["extras"]["modalmotion"]["weight_ranges"]
    assert np.allclose(ranges, np.stack([given.weights.min(0), given.weights.max(0)], axis=1))
    output = document["accessors"][document["animations"][0]["samplers"][2]["output"]]
    start = document["bufferViews"][output["bufferView"]]["byteOffset"]
    weights = np.frombuffer(container.binary, "<f4", output["count"], start).reshape(-1, 2)
    assert weights.min() == 0.0
    assert weights.max() == 1.0
    assert document["meshes"][0]["extras"]["targetNames"] == ["target 0", "target 1"]


def test_frames_without_times_play_at_a_stated_rate_and_read_back_without() -> None:
    data = write_glb(replace(animation(), times=None, unit=None))
    read = read_sequence(data)
    assert read.sequence.times is None
    assert read.sequence.unit is None
    accessors = read_container(data).document["accessors"]
    assert [a["max"] for a in accessors if a["type"] == "SCALAR" and "max" in a] == [
        [np.float32(2 / 25)]
    ]


def test_late_times_survive_and_times_too_close_are_refused() -> None:
    late = replace(animation(), times=np.array([1.7e9, 1.7e9 + 0.5, 1.7e9 + 1.25]))
    times = read_sequence(write_glb(late)).sequence.times
    assert times is not None
    assert times.tolist() == [1.7e9, 1.7e9 + 0.5, 1.7e9 + 1.25]
    with pytest.raises(ParameterError) as caught:
        write_glb(replace(animation(), times=np.array([0.0, 1.0, 1.0 + 1e-9])))
    assert caught.value.frame == 2


@pytest.mark.parametrize("name", ["targets", "rotations", "translations", "times"])
def test_arrays_that_do_not_fit_each_other_are_refused(name: str) -> None:
    given = animation(2)
    with pytest.raises(ShapeError, match=name):
        replace(given, **{name: getattr(given, name)[:-1]})


def test_a_contour_is_written_as_points() -> None:
    read = read_sequence(write_glb(replace(animation(), faces=FACES[:0])))
    assert not len(read.sequence.faces)


def test_rotations_survive_quaternions_at_every_angle() -> None:
    turns = Rotation.random(500, random_state=1).as_matrix()
    halves = [np.diag(d) for d in ([1, -1, -1], [-1, 1, -1], [-1, -1, 1], [1.0, 1, 1])]
    matrices = np.concatenate([turns, halves])
    quaternions = to_quaternions(matrices)
    eps = np.finfo(float).eps
    assert np.abs(to_matrices(quaternions) - matrices).max() < 8 * eps
    theirs = Rotation.from_matrix(matrices).as_quat()
    assert np.abs(np.abs((theirs * quaternions).sum(axis=1)) - 1).max() < 8 * eps
    assert ((quaternions[1:] * quaternions[:-1]).sum(axis=1) >= 0).all()


def channel(path: str, mode: str, values: NDArray[np.float64]) -> Channel:
    return Channel(path, mode, np.array([1.0, 2.0, 4.0]), values)


MOMENTS = np.array([0.0, 1.0, 1.25, 1.9, 2.0, 3.0, 4.0, 9.0])


def test_between_keys_values_are_those_of_the_specification() -> None:
    keys = np.random.default_rng(0).normal(size=(3, 1, 2))
    linear = channel("weights", "LINEAR", keys).at(MOMENTS)
    for i in range(2):
        assert np.allclose(linear[:, i], np.interp(MOMENTS, [1, 2, 4], keys[:, 0, i]))
    step = channel("weights", "STEP", keys).at(MOMENTS)
    assert np.array_equal(step, keys[[0, 0, 0, 0, 1, 1, 2, 2], 0])
    turns = Rotation.random(3, random_state=3)
    quaternions = to_quaternions(turns.as_matrix())
    turned = channel("rotation", "LINEAR", quaternions[:, None]).at(MOMENTS)
    expected = Slerp([1, 2, 4], turns)(np.clip(MOMENTS, 1, 4)).as_matrix()
    assert np.allclose(to_matrices(turned), expected, atol=1e-14)


def test_a_spline_has_its_tangents_at_its_keys() -> None:
    keys = np.random.default_rng(0).normal(size=(3, 3, 2))
    spline = channel("weights", "CUBICSPLINE", keys)
    assert np.allclose(spline.at(np.array([1.0, 2.0, 4.0])), keys[:, 1])
    h = 1e-6
    after = (spline.at(np.array([2 + h])) - spline.at(np.array([2.0]))) / h
    before = (spline.at(np.array([2.0])) - spline.at(np.array([2 - h]))) / h
    assert np.allclose(after, keys[1, 2], atol=1e-4)
    assert np.allclose(before, keys[1, 0], atol=1e-4)


def glb(document: dict[str, Any], *arrays: NDArray[Any]) -> bytes:
    """A file from a document that names its arrays' bytes as views, in order."""
    pieces = [a.tobytes() + bytes(-a.nbytes % 4) for a in arrays]
    starts = np.cumsum([0] + [len(p) for p in pieces])
    views = [
        {"buffer": 0, "byteOffset": int(s), "byteLength": a.nbytes}
        for s, a in zip(starts, arrays, strict=False)
    ]
    return write_container(
        {
            "asset": {"version": "2.0"},
            "buffers": [{"byteLength": int(starts[-1])}],
            "bufferViews": views,
            **document,
        },
        b"".join(pieces),
    )


def scene(**changes: Any) -> dict[str, Any]:
    """A mesh of two primitives below a turned parent, weights moved by a spline."""
    return {
        "scene": 0,
        "scenes": [{"nodes": [1]}],
        "nodes": [
            {"mesh": 0, "scale": [2, 2, 2]},
            {"children": [0], "rotation": [0, 0, 1, 0], "translation": [1, 0, 0]},
        ],
        "meshes": [
            {
                "primitives": [
                    {"attributes": {"POSITION": 0}, "targets": [{"POSITION": 1}], "indices": 2},
                    {"attributes": {"POSITION": 0}, "targets": [{"POSITION": 1}], "indices": 3},
                ]
            }
        ],
        "animations": [
            {
                "name": "beat",
                "channels": [{"sampler": 0, "target": {"node": 0, "path": "weights"}}],
                "samplers": [{"input": 4, "output": 5, "interpolation": "STEP"}],
            }
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 12, "type": "VEC3"},
            {
                "componentType": 5126,
                "count": 12,
                "type": "VEC3",
                "sparse": {
                    "count": 1,
                    "indices": {"bufferView": 1, "componentType": 5123},
                    "values": {"bufferView": 2},
                },
            },
            {"bufferView": 3, "componentType": 5121, "count": 18, "type": "SCALAR"},
            {"bufferView": 4, "componentType": 5125, "count": 18, "type": "SCALAR"},
            {"bufferView": 5, "componentType": 5126, "count": 3, "type": "SCALAR"},
            {
                "bufferView": 6,
                "componentType": 5121,
                "normalized": True,
                "count": 3,
                "type": "SCALAR",
            },
        ],
    } | changes


ARRAYS = (
    VERTICES[0].astype("<f4"),
    np.array([7], "<u2"),
    np.array([[0, 0, 3]], "<f4"),
    FACES[:6].ravel().astype("u1"),
    FACES[6:].ravel().astype("<u4"),
    np.array(TIMES, "<f4"),
    np.array([0, 255, 51], "u1"),
)


def test_primitives_parents_sparse_and_normalised_numbers_are_read() -> None:
    read = read_sequence(glb(scene(), *ARRAYS))
    moved = np.tile(VERTICES[0].astype(float), (3, 1, 1))
    moved[:, 7, 2] += 3 * np.array([0.0, 1.0, 0.2])
    # Half a turn about z, twice the size, one to the side.
    expected = 2 * moved * [-1, -1, 1] + [1, 0, 0]
    assert np.allclose(read.sequence.vertices, expected, atol=1e-12)
    assert np.array_equal(read.sequence.faces, FACES)
    assert (read.sequence.unit, read.unit_from, read.coordinate_system) == ("m", "format", "Y up")


def test_a_matrix_and_a_parent_that_moves_are_applied() -> None:
    document = scene()
    # Column by column: y becomes x, x becomes -y.
    document["nodes"][0] = {"mesh": 0, "matrix": [0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1, 0, 0, 0, 5, 1]}
    document["nodes"][1] = {"children": [0]}
    document["animations"][0] = {
        "channels": [{"sampler": 0, "target": {"node": 1, "path": "translation"}}],
        "samplers": [{"input": 4, "output": 6}],
    }
    shifts = np.array([[0, 0, 0], [1, 2, 3], [9, 9, 9]], "<f4")
    document["accessors"].append(
        {"bufferView": 7, "componentType": 5126, "count": 3, "type": "VEC3"}
    )
    read = read_sequence(glb(document, *ARRAYS, shifts))
    x, y, z = VERTICES[0].astype(float).T
    placed = np.stack([y, -x, z + 5], axis=1)
    assert np.allclose(read.sequence.vertices, placed + shifts[:, None, :])


def test_a_mesh_shown_twice_is_there_twice() -> None:
    document = scene(nodes=[{"mesh": 0}, {"children": [0, 2]}, {"mesh": 0}])
    read = read_sequence(glb(document, *ARRAYS))
    assert read.sequence.n_vertices == 2 * N_VERTICES
    assert np.array_equal(read.sequence.faces[len(FACES) :], FACES + N_VERTICES)
    assert "coincide" in read.notes[-1]


def test_an_animation_is_chosen_by_its_name() -> None:
    document = scene()
    other = json.loads(json.dumps(document["animations"][0])) | {"name": "rest"}
    other["samplers"][0]["output"] = 4
    document["animations"].append(other)
    data = glb(document, *ARRAYS)
    first = read_sequence(data)
    assert first.ignored == ("animation rest",)
    second = read_sequence(data, ReadOptions(animation="rest"))
    assert second.ignored == ("animation beat",)
    assert not np.array_equal(first.sequence.vertices, second.sequence.vertices)
    with pytest.raises(ParameterError, match="beat, rest"):
        read_sequence(data, ReadOptions(animation="dance"))


def test_a_file_without_animation_is_one_frame() -> None:
    read = read_sequence(glb(scene(animations=[]), *ARRAYS))
    assert read.sequence.n_frames == 1
    assert read.sequence.times is None
    assert "no animation" in read.notes[0]


def test_trimesh_finds_the_same_base(tmp_path: Path) -> None:
    trimesh: Any = pytest.importorskip("trimesh")
    import io

    document = scene(animations=[], nodes=[{"mesh": 0}], scenes=[{"nodes": [0]}])
    document["meshes"][0]["primitives"].pop()
    data = glb(document, *ARRAYS)
    theirs = trimesh.load(io.BytesIO(data), file_type="glb", process=False).to_geometry()
    read = read_sequence(data).sequence
    assert np.array_equal(theirs.vertices, read.vertices[0])
    assert np.array_equal(theirs.faces, read.faces)


def put(*path: Any, value: Any) -> Callable[[dict[str, Any]], object]:
    def edit(document: dict[str, Any]) -> None:
        place: Any = document
        for key in path[:-1]:
            place = place[key]
        if value is ...:
            del place[path[-1]]
        else:
            place[path[-1]] = value

    return edit


GOOD = glb(scene(), *ARRAYS)


@pytest.mark.parametrize(
    ("data", "error", "words"),
    [
        (GOOD[: len(GOOD) // 2], MalformedFileError, "declares version 2"),
        (GOOD[:15], MalformedFileError, "no GLB"),
        (GOOD[:4] + b"\x01" + GOOD[5:], MalformedFileError, "version 1"),
        (write_container({"a": 1}, b"").replace(b'"a"', b"'a'"), MalformedFileError, "document"),
        (write_container([], b""), MalformedFileError, "document is none"),  # type: ignore[arg-type]
        (write_container({}, b""), MalformedFileError, "nodes"),
        (GOOD.replace(b'"count":12', b'"count":-2', 1), MalformedFileError, "states count"),
        (GOOD.replace(b'"count":12', b'"count":99', 1), MalformedFileError, "ends at byte"),
        (edited_glb(GOOD, put("accessors", 0, "count", value=10**9)), LimitError, "vertices"),
        (edited_glb(GOOD, put("accessors", 1, "count", value=10**9)), LimitError, "vertices"),
        (edited_glb(GOOD, put("accessors", 1, "count", value=13)), MalformedFileError, "target"),
        (edited_glb(GOOD, put("accessors", 0, "type", value="VEC2")), MalformedFileError, "VEC2"),
        (edited_glb(GOOD, put("accessors", 0, "byteOffset", value=1)), MalformedFileError, "ends"),
        (edited_glb(GOOD, put("accessors", 0, "bufferView", value=-1)), MalformedFileError, "[-1]"),
        (
            edited_glb(GOOD, put("bufferViews", 0, "byteLength", value=9**9)),
            MalformedFileError,
            "a",
        ),
        (
            edited_glb(GOOD, put("bufferViews", 0, "byteStride", value=4)),
            MalformedFileError,
            "ends",
        ),
        (edited_glb(GOOD, put("buffers", 0, "uri", value="x.bin")), MalformedFileError, "x.bin"),
        (
            edited_glb(GOOD, put("buffers", 0, "uri", value="file:///etc/passwd")),
            MalformedFileError,
            "never opened",
        ),
        (
            edited_glb(GOOD, put("accessors", 3, "bufferView", value=5)),
            MalformedFileError,
            "ends at byte",
        ),
        (
            edited_glb(GOOD, put("accessors", 1, "sparse", "indices", "bufferView", value=6)),
            MalformedFileError,
            "item",
        ),
        (
            edited_glb(GOOD, put("meshes", 0, "primitives", 0, "indices", value=4)),
            MalformedFileError,
            "corners",
        ),
        (
            edited_glb(GOOD, put("meshes", 0, "primitives", 0, "mode", value=5)),
            MalformedFileError,
            "strips",
        ),
        (
            edited_glb(
                GOOD,
                put(
                    "meshes",
                    0,
                    "primitives",
                    0,
                    "extensions",
                    value={"KHR_draco_mesh_compression": {}},
                ),
            ),
            MalformedFileError,
            "compressed",
        ),
        (
            edited_glb(GOOD, put("extensionsRequired", value=["EXT_meshopt_compression"])),
            MalformedFileError,
            "EXT_meshopt",
        ),
        (edited_glb(GOOD, put("nodes", 0, "skin", value=0)), MalformedFileError, "skeleton"),
        (edited_glb(GOOD, put("nodes", 0, "children", value=[1])), MalformedFileError, "itself"),
        (edited_glb(GOOD, put("nodes", 0, "mesh", value=...)), MalformedFileError, "no mesh"),
        (edited_glb(GOOD, put("nodes", 0, "mesh", value="x")), MalformedFileError, "meshes[x]"),
        (
            edited_glb(GOOD, put("nodes", 1, "rotation", value=[0, 0, 0, 0])),
            MalformedFileError,
            "zero length",
        ),
        (edited_glb(GOOD, put("nodes", 1, "scale", value=[1, 2])), MalformedFileError, "scale"),
        (edited_glb(GOOD, put("nodes", 1, "scale", value=[1e308] * 3)), NonFiniteError, "Frame 0"),
        (edited_glb(GOOD, put("nodes", 0, "weights", value=[1, 2])), None, ""),
        (
            edited_glb(GOOD, put("meshes", 0, "weights", value=[1, 2])),
            MalformedFileError,
            "weights",
        ),
        (edited_glb(GOOD, put("accessors", 4, "count", value=2)), MalformedFileError, "2 keys"),
        (
            edited_glb(GOOD, put("animations", 0, "samplers", 0, "interpolation", value="X")),
            MalformedFileError,
            "(X)",
        ),
        (edited_glb(GOOD, put("animations", 0, "channels", value=7)), MalformedFileError, "glTF"),
        (edited_glb(GOOD, put("scene", value=4)), MalformedFileError, "scenes[4]"),
        (
            edited_glb(GOOD, put("scenes", 0, "nodes", value={"a": 1})),
            MalformedFileError,
            "nodes[a]",
        ),
        (glb(scene(), ARRAYS[0] * np.nan, *ARRAYS[1:]), NonFiniteError, "vertex 0"),
        (
            glb(scene(), *ARRAYS[:5], np.array([0, 2, 1], "<f4"), ARRAYS[6]),
            MalformedFileError,
            "do not increase",
        ),
        (
            glb(scene(), *ARRAYS[:3], FACES[:6].ravel().astype("u1") + 2, *ARRAYS[4:]),
            MalformedFileError,
            "names vertex 12",
        ),
    ],
)
def test_what_cannot_be_read_says_why(
    data: bytes, error: type[InputError] | None, words: str
) -> None:
    if error is None:
        read_sequence(data)
        return
    with pytest.raises(error) as caught:
        read_sequence(data)
    assert type(caught.value) is error
    assert words in str(caught.value)
    assert caught.value.remedy


@pytest.mark.parametrize(
    ("limits", "name"),
    [
        (ReadLimits(frames=2), "frames"),
        (ReadLimits(vertices=11), "vertices"),
        (ReadLimits(faces=11), "faces"),
        (ReadLimits(decompressed_bytes=700), "decompressed_bytes"),
    ],
)
def test_each_limit_is_named_by_its_error(limits: ReadLimits, name: str) -> None:
    with pytest.raises(LimitError) as caught:
        read_sequence(GOOD, ReadOptions(limits=limits))
    assert caught.value.limit == name


def test_many_targets_from_one_accessor_are_no_way_around_the_limits() -> None:
    data = edited_glb(
        GOOD,
        put("meshes", 0, "primitives", 0, "targets", value=[{"POSITION": 1}] * 100_000),
    )
    with pytest.raises(LimitError):
        read_sequence(data, ReadOptions(limits=ReadLimits(decompressed_bytes=10_000_000)))


def test_the_animation_plays_by_its_own_formula() -> None:
    given = animation(2)
    frame = 2
    u = sum(given.weights[frame, i] * given.targets[i] for i in range(2))
    expected = (given.base + u) @ given.rotations[frame].T + given.translations[frame]
    assert np.allclose(MorphAnimation.positions(given)[frame], expected, atol=1e-12)
    assert given.n_frames == N_FRAMES
