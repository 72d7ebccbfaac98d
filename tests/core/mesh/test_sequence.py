from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from modalmotion.errors import (
    ConnectivityError,
    InputError,
    NonFiniteError,
    ParameterError,
    ShapeError,
    TopologyError,
)
from modalmotion.mesh.sequence import mesh_sequence
from modalmotion.modes.topologies import CUP, CYLINDER

TRIANGLE = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]], dtype=np.float64)


def two_frames() -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.concatenate([TRIANGLE, TRIANGLE + 1.0])


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        ({"vertices": np.zeros((2, 3))}, ShapeError, "(2, 3)"),
        ({"vertices": np.zeros((2, 3, 2))}, ShapeError, "(frames, vertices, 3)"),
        ({"vertices": np.zeros((0, 3, 3))}, ShapeError, "0 frames"),
        ({"vertices": np.zeros((2, 0, 3))}, ShapeError, "0 vertices"),
        ({"vertices": np.full((1, 1, 3), "x")}, ShapeError, "not numbers"),
        ({"vertices": np.full((1, 1, 3), 1j)}, ShapeError, "not numbers"),
        ({"vertices": np.array([[[None] * 3]])}, ShapeError, "not numbers"),
        ({"faces": [[0, 1, 3]]}, ConnectivityError, "names vertex 3"),
        ({"faces": [[0, 1, -1]]}, ConnectivityError, "names vertex -1"),
        ({"faces": [[0.0, 1.0, 2.0]]}, ShapeError, "integers"),
        ({"faces": [[0, 1, 2, 0]]}, ShapeError, "(1, 4)"),
        ({"times": [0.0]}, ShapeError, "2 frames need"),
        ({"times": [0.0, np.nan]}, NonFiniteError, "frame 1"),
        ({"times": [0.0, 0.0]}, ShapeError, "Frame 1"),
        ({"times": [1.0, 0.5]}, ShapeError, "Frame 1"),
        ({"grid": (2, 2)}, ShapeError, "does not fit 3 vertices"),
        ({"grid": (0, 2)}, ShapeError, "does not fit"),
        ({"grid": 3.5}, ShapeError, "whole numbers"),
        ({"grid": (1, 3), "topology": "cup"}, ShapeError, "odd"),
        ({"grid": (3,), "topology": "cylinder"}, ShapeError, "2 axes"),
        ({"topology": "klein bottle"}, TopologyError, "names no topology"),
        ({"unit": "furlong"}, ParameterError, "furlong"),
    ],
)
def test_bad_arrays_are_refused_by_what_is_wrong(
    arguments: dict[str, Any], error: type[InputError], words: str
) -> None:
    with pytest.raises(error, match=None) as caught:
        mesh_sequence(**{"vertices": two_frames(), **arguments})
    assert words in str(caught.value)
    assert caught.value.remedy


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_the_frame_and_vertex_that_are_not_finite_are_named(value: float, dtype: Any) -> None:
    vertices = np.zeros((5, 7, 3), dtype=dtype)
    vertices[3, 4, 1] = value
    with pytest.raises(NonFiniteError) as caught:
        mesh_sequence(vertices)
    assert (caught.value.frame, caught.value.vertex) == (3, 4)
    assert "Frame 3, vertex 4: y" in str(caught.value)


def test_opposite_infinities_do_not_hide_each_other() -> None:
    vertices = np.zeros((1, 2, 3))
    vertices[0, :, 0] = [np.inf, -np.inf]
    with pytest.raises(NonFiniteError):
        mesh_sequence(vertices)


def test_finite_coordinates_whose_sum_overflows_are_accepted() -> None:
    assert mesh_sequence(np.full((1, 10**5, 3), 1e304)).n_vertices == 10**5


def test_the_id_depends_on_the_numbers_alone() -> None:
    vertices = two_frames().astype(np.float32)
    one = mesh_sequence(vertices)
    assert one.id == mesh_sequence(vertices.astype(np.float64)).id
    assert one.id == mesh_sequence(np.asfortranarray(vertices)).id
    assert one.id == mesh_sequence(vertices.astype(">f4")).id


@pytest.mark.parametrize(
    "change",
    [
        {"faces": [[0, 1, 2]]},
        {"times": [0.0, 1.0]},
        {"unit": "mm"},
        {"topology": "open curve"},
        {"grid": (3,)},
        {"vertices": two_frames() + 1e-9},
    ],
)
def test_the_id_changes_with_everything_that_a_result_depends_on(change: dict[str, Any]) -> None:
    plain = mesh_sequence(two_frames())
    changed = mesh_sequence(**{"vertices": two_frames(), **change})
    assert changed.id != plain.id


@given(st.binary(min_size=12, max_size=96))
def test_any_finite_numbers_keep_their_id_through_float64(data: bytes) -> None:
    raw = np.frombuffer(data[: len(data) // 12 * 12], dtype=np.float32).reshape(1, -1, 3)
    if np.isfinite(raw).all():
        assert mesh_sequence(raw).id == mesh_sequence(raw.astype(np.float64)).id


def test_a_stated_topology_replaces_the_files_own() -> None:
    given_cylinder = mesh_sequence(np.zeros((1, 8, 3)), grid=(2, 4), topology="cylinder")
    assert given_cylinder.topology == CYLINDER
    assert given_cylinder.with_topology(CUP, None).topology == CUP
    assert given_cylinder.with_topology(None, None) is given_cylinder
    with pytest.raises(ShapeError):
        given_cylinder.with_topology(CUP, (8, 1))


def test_a_sequence_cannot_be_written_to() -> None:
    sequence = mesh_sequence(two_frames())
    with pytest.raises(ValueError, match="read-only"):
        sequence.vertices[0, 0, 0] = 1.0
