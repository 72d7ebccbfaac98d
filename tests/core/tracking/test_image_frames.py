"""Tracking through images: where the surface ends up, what is said of it, what is refused."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from ellipsoid_images import (
    AXES,
    BASE,
    LANDMARKS,
    MIDDLE,
    RADIUS,
    Look,
    enclosed,
    off_surface,
    planes,
    volume,
)

from modalmotion.errors import InputError, ParameterError, ShapeError
from modalmotion.images import ImageSequence, PlaneSet, Volume
from modalmotion.mesh.sequence import mesh_sequence
from modalmotion.tracking import Track, track
from modalmotion.tracking.hdf5 import track_from_hdf5, track_to_hdf5
from modalmotion.tracking.moving_base import with_levels

# A beat of three frames: full, small, in between.
RADII = (RADIUS, 17.0, 20.0)
MARKS = {"apex": LANDMARKS["apex"], "base": np.tile(BASE, (3, 1))}


@pytest.fixture(scope="module")
def volumes() -> ImageSequence:
    return ImageSequence(tuple(volume(r, seed=k) for k, r in enumerate(RADII)))


@pytest.fixture(scope="module")
def tracked(volumes: ImageSequence) -> Track:
    return track(volumes, landmarks=MARKS)


def of_one(image: Any, **options: Any) -> Track:
    return track(image, **({"landmarks": LANDMARKS} | options))


def inner(x: np.ndarray) -> np.ndarray:
    """Vertices below the rim, which only landmarks place."""
    return np.asarray(x[(x - MIDDLE) @ AXES[:, 2] < 26.0], dtype=np.float64)


def test_a_beat_is_found_within_a_share_of_a_voxel(tracked: Track) -> None:
    for x, radius in zip(tracked.sequence.vertices, RADII, strict=True):
        assert off_surface(inner(x), radius) < 0.3
    assert tracked.volumes == pytest.approx([enclosed(r) for r in RADII], rel=0.03)
    true = 100.0 * (1.0 - enclosed(RADII[1]) / enclosed(RADII[0]))
    assert tracked.ejection_fraction is not None
    assert tracked.ejection_fraction == pytest.approx(true, abs=2.0)
    assert tracked.ejection_fraction_bound is not None
    assert tracked.ejection_fraction_bound > abs(tracked.ejection_fraction - true)
    assert tracked.sequence.unit == "mm"
    assert tracked.sequence.facts.tracking == "normal_displacement"
    assert tracked.sequence.grid == (32, 64)


def test_what_images_were_like_is_part_of_the_answer(tracked: Track) -> None:
    own = tracked.images
    assert own is not None
    assert own.inside == pytest.approx(100.0, rel=0.05)
    assert own.outside == pytest.approx(40.0, rel=0.1)
    # Noise of 4, between voxels.
    assert own.spread == pytest.approx(1.9, rel=0.3)
    assert min(own.found) > 0.8
    assert own.shifts == ()
    assert own.localisation > 0
    # Every vertex may be off as far as all edges alike.
    assert tracked.deviations[..., 0].min() >= own.localisation
    # In both volumes of the ejection fraction too, which hardly changes by it.
    assert 0.4 < tracked.volume_correlation < 1.0
    apart = replace(tracked, volume_correlation=0.0).ejection_fraction_bound
    assert tracked.ejection_fraction_bound is not None
    assert apart is not None
    assert tracked.ejection_fraction_bound < 0.8 * apart
    # Levels of the ends add their own errors to it.
    levels = {"base": np.diag(np.full(tracked.n_frames, 0.01))}
    assert with_levels(tracked, levels).volume_correlation > 0.9 * tracked.volume_correlation
    # Without muscles both conventions say nearly the same.
    both = tracked.ejection_fractions
    assert both["pool"] == pytest.approx(tracked.ejection_fraction)
    assert both["wall"] == pytest.approx(both["pool"], abs=2.0)


def test_a_track_of_images_is_read_as_it_was_written(tracked: Track) -> None:
    again = track_from_hdf5(track_to_hdf5(tracked))
    assert again.images == tracked.images
    assert again.sequence.id == tracked.sequence.id


def test_planes_and_volumes_end_at_the_same_surface() -> None:
    result = of_one(planes())
    assert off_surface(inner(result.sequence.vertices[0])) < 0.4
    assert result.images is not None
    assert len(result.images.shifts) == 8
    # Nothing is shifted, and so it is said.
    assert result.images.shift_sd < 0.6


def test_slices_that_show_all_aside_are_put_right() -> None:
    rng = np.random.default_rng(3)
    shifts = np.array([rng.normal(0, 2, 2) @ AXES[:, :2].T for _ in range(8)])
    shifts[6:] = 0.0
    result = of_one(planes(shifts=shifts))
    assert off_surface(inner(result.sequence.vertices[0])) < 0.7
    assert result.images is not None
    assert result.images.shift_sd > 0.8
    left = np.array(result.images.shifts) - shifts
    assert np.linalg.norm(left, axis=1).mean() < 0.6 * np.linalg.norm(shifts[:6], axis=1).mean()
    assert result.images.bent > 0.2


HOLES = np.random.default_rng(2).random((40, 40, 52)) < 0.1
LEFT_HANDED = np.column_stack([AXES[:, [1, 0, 2]] * [-2, 2, 2], MIDDLE + AXES @ [-40, 40, -52]])


@pytest.mark.every(2)
@pytest.mark.parametrize(
    "image",
    [
        volume(look=Look(20.0, 80.0, 50.0)),
        volume(look=Look(bias=0.4)),
        Volume(np.where(HOLES, np.nan, volume().values), volume().affine),
        volume(affine=LEFT_HANDED, shape=(41, 41, 52)),
    ],
    ids=["inverted", "bias", "missing", "left-handed and oblique"],
)
def test_the_same_surface_is_found_in_harder_images(image: Volume) -> None:
    result = of_one(image)
    assert off_surface(inner(result.sequence.vertices[0])) < 0.5
    assert result.volumes == pytest.approx([enclosed()], rel=0.04)


def test_a_start_is_where_the_search_begins(tracked: Track, volumes: ImageSequence) -> None:
    first = volumes.frames[0]
    x = tracked.sequence.vertices[0].astype(np.float64)
    for size, aside in ((0.9, 5.0), (1.1, -5.0)):
        far = MIDDLE + size * (x - MIDDLE) + aside * AXES[:, 0]
        start = mesh_sequence(far[None], tracked.template.faces, grid=(32, 64), topology="cup")
        assert off_surface(inner(of_one(first, start=start).sequence.vertices[0])) < 0.5


def test_missing_frames_are_interpolated_and_marked(volumes: ImageSequence) -> None:
    result = track([*volumes.frames, None], landmarks=LANDMARKS)
    assert result.unseen == (3,)
    assert any("interpolated" in note for note in result.notes)


def test_a_frame_without_the_object_is_marked(volumes: ImageSequence) -> None:
    first = volumes.frames[0]
    assert isinstance(first, Volume)
    noise = np.random.default_rng(1).normal(60.0, 20.0, first.shape)
    result = track([first, Volume(noise, first.affine), first], landmarks=LANDMARKS)
    assert result.unseen == (1,)
    assert any("hardly any profile" in note for note in result.notes)


def flat(value: float) -> Volume:
    own = volume()
    return Volume(np.full(own.shape, value), own.affine)


@pytest.mark.parametrize(
    ("image", "told"),
    [
        (flat(7.0), "no contrast"),
        (flat(np.nan), "outside the images"),
        (Volume(np.ones((1, 1, 1)), np.eye(4)), "outside the images"),
        (Volume(np.random.default_rng(0).normal(size=(40, 40, 52)), volume().affine), "No object"),
        (PlaneSet(planes().planes[6:]), "outside the images"),
    ],
    ids=["flat", "missing", "one voxel", "noise", "no plane across"],
)
def test_no_surface_comes_out_where_none_is_seen(image: Volume | PlaneSet, told: str) -> None:
    with pytest.raises(ShapeError, match=told) as error:
        of_one(image)
    assert error.value.remedy
    assert error.value.frame == 0


def test_what_images_cannot_do_without_is_named(volumes: ImageSequence) -> None:
    with pytest.raises(ParameterError, match="apex and base"):
        track(volumes)
    with pytest.raises(ParameterError, match="unit"):
        of_one(volumes.frames[0], unit="cm")
    with pytest.raises(ParameterError, match="papillary"):
        of_one(volumes.frames[0], papillary="both")
    with pytest.raises(InputError, match="outside"):
        of_one(volumes.frames[0], landmarks={k: x * [-1, -1, 1] for k, x in LANDMARKS.items()})
    with pytest.raises(ShapeError, match="missing"):
        track(replace(volumes, frames=(None, *volumes.frames)), landmarks=LANDMARKS)


def test_another_brightness_of_a_frame_hardly_moves_edges(
    tracked: Track, volumes: ImageSequence
) -> None:
    first, second, third = volumes.frames
    assert isinstance(second, Volume)
    brighter = Volume(1.08 * second.values, second.affine)
    result = track([first, brighter, third], landmarks=MARKS)
    # With the levels of the reference it would be a tenth.
    assert tracked.volumes is not None
    assert result.volumes == pytest.approx(tracked.volumes, rel=0.03)


def test_landmarks_are_as_exact_as_stated_however_noisy_edges_are() -> None:
    noisy = [volume(RADIUS, Look(noise=30.0), seed=k) for k in range(2)]
    base = np.array([BASE, BASE - 8.0 * AXES[:, 2]])
    result = track(noisy, landmarks={"apex": LANDMARKS["apex"], "base": base})
    rings = result.sequence.vertices.reshape(2, 32, 64, 3)[:, -1].mean(axis=1)
    # With the deviation of an edge it would be more than half of the way, of 8 mm.
    assert np.linalg.norm(rings - base, axis=1).max() < 3.5
