"""Volumes and planes: where their samples lie, what is between them, what is refused."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from ellipsoid_images import planes, volume

from modalmotion.errors import InputError, ParameterError, ShapeError
from modalmotion.images import ImageSequence, Plane, PlaneSet, Volume
from modalmotion.images.volume import among_missing, images_in, slices_of

SHEARED = np.array([[1.5, 0.4, 0.0, 3.0], [0.0, -2.0, 0.1, -7.0], [0.2, 0.0, 3.0, 11.0]])


def linear(affine: np.ndarray, shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Samples that are linear in place, and the gradient."""
    gradient = np.array([0.7, -1.1, 0.4])
    index = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1)
    points = index @ affine[:, : len(shape)].T + affine[:, -1]
    return points @ gradient, gradient


def test_a_linear_field_is_interpolated_exactly_in_any_axes() -> None:
    values, gradient = linear(SHEARED, (5, 6, 4))
    own = Volume(values, SHEARED)
    rng = np.random.default_rng(0)
    index = rng.uniform(0, [4, 5, 3], (50, 3))
    points = index @ SHEARED[:, :3].T + SHEARED[:, 3]
    assert own.sample(points) == pytest.approx(points @ gradient)
    assert own.indices(points) == pytest.approx(index)
    assert np.isnan(own.sample(points + 100.0)).all()
    assert own.spacing == pytest.approx(np.linalg.norm(SHEARED[:, :3], axis=0))


def test_missing_samples_are_left_out_and_not_spread() -> None:
    values, gradient = linear(SHEARED, (6, 6, 6))
    values = np.ones_like(values) * 5.0
    values[2, 2, 2] = np.nan
    own = Volume(values, SHEARED)
    at = np.array([[2.4, 2.0, 2.0], [2.9, 2.6, 2.2], [2.0, 2.0, 2.0]])
    found = own.sample(at @ SHEARED[:, :3].T + SHEARED[:, 3])
    assert np.isnan(found[[0, 2]]).all()
    assert found[1] == pytest.approx(5.0)
    assert gradient.shape == (3,)


def test_planes_are_sampled_at_the_foot_of_a_point() -> None:
    values, gradient = linear(SHEARED[:, [0, 1, 3]], (5, 6))
    own = Plane(values, SHEARED[:, [0, 1, 3]], 6.0)
    points = np.array([[2.0, 3.0], [1.5, 4.2]]) @ SHEARED[:, :2].T + SHEARED[:, 3]
    above = points + 2.5 * own.normal
    assert own.heights(above) == pytest.approx([2.5, 2.5])
    assert own.sample(above) == pytest.approx(points @ gradient)


def test_thick_slices_are_taken_apart_and_thin_ones_not() -> None:
    values, _ = linear(SHEARED, (5, 6, 4))
    thick = Volume(values, SHEARED * np.array([1.0, 1.0, 3.0, 1.0]))
    (frame,) = ImageSequence((thick,)).sliced().frames
    assert isinstance(frame, PlaneSet)
    assert len(frame) == 4
    assert frame.planes[3].origin == pytest.approx(thick.affine[:, 3] + 3 * thick.affine[:, 2])
    across = abs(thick.affine[:, 2] @ frame.planes[0].normal)
    assert frame.planes[0].thickness == pytest.approx(across)
    # The planes show what the volume does.
    points = np.array([[2.0, 3.0, 1.0]]) @ thick.affine[:, :3].T + thick.affine[:, 3]
    assert frame.planes[1].sample(points) == pytest.approx(thick.sample(points))
    assert isinstance(ImageSequence((volume(),)).sliced().frames[0], Volume)
    assert len(slices_of(volume())) == 40


def test_a_voxel_reaches_as_far_as_its_sides() -> None:
    own = Volume(np.zeros((2, 2, 2)), np.diag([1.0, 2.0, 8.0, 1.0]))
    assert own.extents(np.eye(3)) == pytest.approx([1.0, 2.0, 8.0])


@pytest.mark.parametrize(
    ("affine", "told"),
    [
        (np.diag([1.0, 1.0, 0.0, 1.0]), "apart"),
        (np.array([[1.0, 1.0, 0, 0], [0, 1e-5, 0, 0], [0, 0, 1.0, 0]]), "no volume"),
        (np.full((3, 4), np.nan), "apart"),
        (np.eye(3), "shape"),
        (1e6 * np.eye(4), "apart"),
    ],
)
def test_broken_geometry_is_refused(affine: np.ndarray, told: str) -> None:
    with pytest.raises(InputError, match=told) as error:
        Volume(np.zeros((2, 2, 2)), affine)
    assert error.value.remedy


@pytest.mark.parametrize("values", [np.zeros((2, 2)), np.zeros((0, 2, 2)), np.full((2, 2, 2), 1j)])
def test_samples_that_are_no_numbers_in_space_are_refused(values: np.ndarray) -> None:
    with pytest.raises(ShapeError):
        Volume(values, np.eye(4))


def test_planes_and_sequences_refuse_what_does_not_belong_together() -> None:
    with pytest.raises(ParameterError, match="thick"):
        Plane(np.zeros((2, 2)), np.eye(4)[:, [0, 1, 3]], 0.0)
    with pytest.raises(ShapeError):
        PlaneSet(())
    with pytest.raises(ShapeError):
        ImageSequence((None,))
    own = planes()
    with pytest.raises(ShapeError, match="planes"):
        ImageSequence((own, PlaneSet(own.planes[:3])))
    with pytest.raises(ShapeError, match="Frame 1"):
        images_in([own, np.zeros((3, 3))])
    assert images_in([np.zeros((3, 3))]) is None
    assert images_in(own) is not None


def test_samples_are_neither_copied_nor_changed() -> None:
    values = np.zeros((3, 3, 3), dtype=np.int16)
    own = Volume(values, np.eye(4))
    assert own.values.base is values
    with pytest.raises(ValueError, match="read-only"):
        own.values[0] = 1
    assert len(repr(ImageSequence((own,)))) < 120


def test_sampling_keeps_nothing_as_large_as_the_image() -> None:
    values = np.random.default_rng(0).normal(size=(60, 50, 40)).astype(np.float32)
    values[::7] = np.nan
    points = np.random.default_rng(1).uniform(0, 39, (500, 3))
    own = [Volume(values, np.eye(4)) for _ in range(4)]
    tracemalloc.start()
    for one in own:
        one.sample(points)
    left, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert left < 0.1 * values.nbytes
    assert most < values.nbytes
    sliced = ImageSequence((Volume(values, np.diag([1.0, 1.0, 4.0, 1.0])),)).sliced().frames[0]
    assert isinstance(sliced, PlaneSet)
    assert all(np.shares_memory(plane.values, values) for plane in sliced.planes)


def test_missing_samples_count_by_what_is_there() -> None:
    values = np.random.default_rng(0).normal(size=(6, 5, 4))
    points = np.random.default_rng(1).uniform(-1, 6, (400, 3))
    whole = Volume(values, np.eye(4)).sample(points)
    # Both ways to interpolate say the same where nothing is missing.
    assert among_missing(values, points) == pytest.approx(whole, nan_ok=True)
    holes = np.where(np.random.default_rng(2).random(values.shape) < 0.2, np.nan, values)
    corners = np.stack([np.floor(points) + c for c in np.ndindex(2, 2, 2)], axis=1)
    found = Volume(holes, np.eye(4)).sample(points)
    for place, around, value in zip(points, corners, found, strict=True):
        if not ((place >= 0) & (place <= np.array(values.shape) - 1)).all():
            assert np.isnan(value)
            continue
        weights = (1.0 - np.abs(around - place)).prod(axis=1)
        own = np.array(
            [holes[tuple(np.minimum(c, np.array(values.shape) - 1).astype(int))] for c in around]
        )
        there = np.isfinite(own)
        share = weights[there].sum()
        if share < 0.5:
            assert np.isnan(value)
        else:
            assert value == pytest.approx((weights * np.where(there, own, 0)).sum() / share)
