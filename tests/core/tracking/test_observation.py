"""Observations: what counts as a frame, and what is refused by its number."""

from __future__ import annotations

import numpy as np
import pytest

from modalmotion.errors import InputError, NonFiniteError, ParameterError, ShapeError
from modalmotion.tracking import Observation, of_surface
from modalmotion.tracking.observation import Place, ends_in, observed_frames

POINTS = np.arange(12, dtype=np.float64).reshape(4, 3)
TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])
SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [9, 9, 9]])


def test_frames_are_points_meshes_observations_or_missing() -> None:
    one = Observation(POINTS)
    frames, notes = observed_frames(
        [POINTS, (SQUARE, TRIANGLES), one, [one, one], None, [], np.zeros((0, 3))]
    )
    assert [len(frame) for frame in frames] == [1, 1, 1, 2, 0, 0, 0]
    assert notes == ()


def test_a_mesh_is_its_vertices_by_area_and_without_loose_ones() -> None:
    seen = of_surface(SQUARE, TRIANGLES)
    assert np.array_equal(seen.points, SQUARE[:4])
    assert seen.weights is not None
    assert seen.weights / seen.weights[1] == pytest.approx([2.0, 1.0, 2.0, 1.0])
    turned = of_surface(SQUARE, TRIANGLES[:, ::-1])
    assert turned.weights == pytest.approx(seen.weights)


def test_directions_become_unit_vectors_and_arrays_stay_as_they_are() -> None:
    seen = Observation(POINTS, sd=0.5, normals=2.0 * np.ones((4, 3)))
    assert seen.normals is not None
    assert np.linalg.norm(seen.normals, axis=1) == pytest.approx(1.0)
    assert seen.sd == pytest.approx(np.full(4, 0.5))
    with pytest.raises(ValueError, match="read-only"):
        seen.points[0] = 0.0


@pytest.mark.parametrize(
    ("bad", "error"),
    [
        (lambda: Observation(np.zeros((4, 2))), ShapeError),
        (lambda: Observation(POINTS * np.nan), NonFiniteError),
        (lambda: Observation(POINTS, sd=0.0), ParameterError),
        (lambda: Observation(POINTS, sd=np.ones(2)), ParameterError),
        (lambda: Observation(POINTS, weights=np.array(["a"] * 4)), ParameterError),
        (lambda: Observation(POINTS, weights=np.array([1.0, -1.0, 0.0, 0.0])), ParameterError),
        (lambda: Observation(POINTS, normals=np.zeros((4, 3))), ParameterError),
        (lambda: Observation(POINTS, places=("apex",)), ShapeError),
        (lambda: Observation(POINTS, end="middle"), ParameterError),
        (lambda: Observation(POINTS, end="base", places=(0, 1, 2, 3)), ParameterError),
        (lambda: of_surface(SQUARE, [[0, 1, 7]]), ShapeError),
        (lambda: of_surface(SQUARE, [[0, 1, 2], [0, 1]]), ParameterError),
        (lambda: Observation(SQUARE, normals=np.array(1.0)), ParameterError),
        (lambda: of_surface(SQUARE[:, :2], TRIANGLES), ShapeError),
    ],
)
def test_what_cannot_be_observed_is_refused(bad: object, error: type[InputError]) -> None:
    with pytest.raises(error) as caught:
        bad()  # type: ignore[operator]
    assert caught.value.remedy


def test_errors_name_the_frame() -> None:
    broken = POINTS.copy()
    broken[2, 1] = np.inf
    with pytest.raises(NonFiniteError, match=r"Frame 1: Point 2 .*Omit such points") as caught:
        observed_frames([POINTS, broken])
    assert caught.value.frame == 1
    assert caught.value.vertex == 2
    with pytest.raises(ShapeError, match="Nothing was observed"):
        observed_frames([None, None])


def test_more_points_than_are_needed_are_thinned_evenly() -> None:
    line = np.zeros((50_000, 3))
    line[:, 0] = np.arange(50_000)
    (frame,), (note,) = observed_frames([line])
    assert len(frame[0]) == 20_000
    assert "20,000" in note
    assert np.diff(frame[0].points[:, 0]).max() <= 4


def test_a_mesh_of_nothing_is_a_frame_without_points() -> None:
    assert len(of_surface(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))) == 0


def test_a_stated_base_is_not_that_of_other_vertices() -> None:
    places: list[Place] = ["base", (1, 2, 3)]
    for order in (slice(None), slice(None, None, -1)):
        mark = Observation(SQUARE[:2][order], places=tuple(places[order]))
        assert ends_in((mark,))["base"].tolist() == SQUARE[0].tolist()
