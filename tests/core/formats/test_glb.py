"""GLB files of others: read as the specification says, or refused by name."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from format_samples import FACES, TIMES, VERTICES, edited_glb
from numpy.typing import NDArray

from modalmotion import Facts
from modalmotion.errors import (
    InputError,
    LimitError,
    MalformedFileError,
    NonFiniteError,
    ParameterError,
)
from modalmotion.formats import ReadLimits, ReadOptions, read_sequence
from modalmotion.formats.glb_writing import write_container


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
    """A mesh of two primitives below a turned parent, weights moved in steps."""
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
    assert read.sequence.facts == Facts(handedness="right")


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


def test_several_meshes_are_refused_with_what_joins_them() -> None:
    document = scene(nodes=[{"mesh": 0}, {"children": [0, 2]}, {"mesh": 0}])
    with pytest.raises(MalformedFileError, match="shows 2 meshes") as caught:
        read_sequence(glb(document, *ARRAYS))
    assert "Join" in caught.value.remedy


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


def test_a_name_that_cannot_be_written_is_ignored_by_one_that_can() -> None:
    def edit(document: dict[str, Any]) -> None:
        document["animations"].append({**document["animations"][0], "name": "half \ud83d"})

    assert read_sequence(edited_glb(glb(scene(), *ARRAYS), edit)).ignored == ("animation half ?",)


def test_a_file_without_animation_is_one_frame() -> None:
    read = read_sequence(glb(scene(animations=[]), *ARRAYS))
    assert read.sequence.n_frames == 1
    assert read.sequence.times is None
    assert "No animation" in read.notes[0]


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
        (GOOD[:15], MalformedFileError, "declares version"),
        (GOOD[:4] + b"\x01" + GOOD[5:], MalformedFileError, "version 1"),
        (write_container({"a": 1}, b"").replace(b'"a"', b"'a'"), MalformedFileError, "document"),
        (write_container([], b""), MalformedFileError, "does not follow glTF"),  # type: ignore[arg-type]
        (write_container({}, b""), MalformedFileError, "scenes[0]"),
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
        (edited_glb(GOOD, put("nodes", 0, "mesh", value=...)), MalformedFileError, "0 meshes"),
        (edited_glb(GOOD, put("nodes", 0, "mesh", value="x")), MalformedFileError, "meshes[x]"),
        (
            edited_glb(GOOD, put("nodes", 1, "rotation", value=[0, 0, 0, 0])),
            MalformedFileError,
            "zero norm",
        ),
        (edited_glb(GOOD, put("nodes", 1, "scale", value=[1, 2])), MalformedFileError, "scale"),
        (edited_glb(GOOD, put("nodes", 1, "scale", value=[1e308] * 3)), NonFiniteError, "Frame 0"),
        (edited_glb(GOOD, put("nodes", 0, "weights", value=[1, 2])), None, ""),
        (
            edited_glb(
                edited_glb(GOOD, put("animations", value=[])),
                put("meshes", 0, "weights", value=[1, 2]),
            ),
            MalformedFileError,
            "weights",
        ),
        (edited_glb(GOOD, put("accessors", 4, "count", value=2)), MalformedFileError, "2 keys"),
        (
            edited_glb(GOOD, put("animations", 0, "samplers", 0, "interpolation", value="X")),
            MalformedFileError,
            "by 'X'",
        ),
        (
            edited_glb(
                GOOD, put("animations", 0, "samplers", 0, "interpolation", value="CUBICSPLINE")
            ),
            MalformedFileError,
            "CUBICSPLINE",
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


def test_a_camera_that_moves_adds_no_frames() -> None:
    document = scene()
    document["nodes"] += [{"camera": 0}]
    document["scenes"][0]["nodes"] += [2]
    document["accessors"] += [
        {"bufferView": 7, "componentType": 5126, "count": 4, "type": "SCALAR"},
        {"componentType": 5126, "count": 4, "type": "VEC3"},
    ]
    document["animations"][0]["samplers"] += [{"input": 6, "output": 7}]
    document["animations"][0]["channels"] += [
        {"sampler": 1, "target": {"node": 2, "path": "translation"}}
    ]
    keys = np.array([-1, 0.1, 0.2, 9], "<f4")
    read = read_sequence(glb(document, *ARRAYS, keys)).sequence
    alone = read_sequence(glb(scene(), *ARRAYS)).sequence
    assert read.times is not None
    assert np.array_equal(read.times, np.array(TIMES, "<f4"))
    assert np.array_equal(read.vertices, alone.vertices)


def test_nodes_below_one_that_moves_are_counted_with_their_frames() -> None:
    n_nodes, n_frames = 2_000, 2_000
    chain = [{"children": [k, n_nodes + k]} for k in range(1, n_nodes)]
    document = {
        "scenes": [{"nodes": [0]}],
        "nodes": [*chain, {"mesh": 0}, *({} for _ in range(n_nodes))],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 2}}]}],
        "animations": [
            {
                "channels": [{"sampler": 0, "target": {"node": 0, "path": "translation"}}],
                "samplers": [{"input": 0, "output": 1}],
            }
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": n_frames, "type": "SCALAR"},
            {"componentType": 5126, "count": n_frames, "type": "VEC3"},
            {"componentType": 5126, "count": 3, "type": "VEC3"},
        ],
    }
    with pytest.raises(LimitError) as caught:
        read_sequence(glb(document, np.arange(n_frames, dtype="<f4")))
    assert caught.value.limit == "unfolded_bytes"
