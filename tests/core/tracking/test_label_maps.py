"""Label maps: tracked with no landmark of the user's."""

from __future__ import annotations

import numpy as np
import pytest
from ellipsoid_images import (
    APEX,
    AXES,
    BASE,
    CUT,
    LENGTH,
    MIDDLE,
    RADIUS,
    enclosed,
    labels,
    off_surface,
    planes,
)

from modalmotion.errors import ParameterError, ShapeError
from modalmotion.images import ImageSequence, Volume
from modalmotion.tracking import track
from modalmotion.tracking.label_maps import from_labels, notes_on_landmarks


@pytest.mark.every(2)
def test_a_segmentation_is_tracked_with_no_other_statement() -> None:
    made = from_labels(ImageSequence((labels(), labels(18.0))))
    for name, place in (("apex", APEX), ("base", BASE)):
        own = made.landmarks[name]
        away = np.linalg.norm(own.places - place, axis=1)
        assert (away < 2.0 * own.sd).all(), name
    result = track(made.images, landmarks=made.landmarks)
    for x, radius in zip(result.sequence.vertices, (RADIUS, 18.0), strict=True):
        below = x[(x - MIDDLE) @ AXES[:, 2] < CUT - 3.0].astype(np.float64)
        assert off_surface(below, radius) < 0.5
    assert result.volumes == pytest.approx([enclosed(), enclosed(18.0)], rel=0.05)
    assert any("proposed" in note for note in result.notes)


def test_a_segmentation_in_memory_is_taken_as_that_of_a_file_is() -> None:
    images = ImageSequence((labels(), labels(18.0)))
    made = from_labels(images)
    found, named = track(images, modes=4), track(images, modes=4, labels=(3,))
    apart = track(made.images, landmarks=made.landmarks, modes=4)
    assert found.sequence.id == named.sequence.id == apart.sequence.id
    assert (found.sequence.unit, found.sequence.facts.coordinates) == ("mm", "LPS")
    assert any("Label 3 was taken as the cavity" in note for note in found.notes)


def test_a_map_that_is_cropped_to_its_cavity_has_room_around_it() -> None:
    whole = labels()
    there = np.argwhere(whole.values == 3)
    first, last = there.min(axis=0), there.max(axis=0) + 1
    box = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
    affine = whole.affine.copy()
    affine[:, 3] += affine[:, :3] @ first
    one = from_labels(ImageSequence((whole,)), (3,)).images.frames[0]
    tight = from_labels(ImageSequence((Volume(whole.values[box], affine),)), (3,)).images.frames[0]
    assert isinstance(one, Volume)
    assert isinstance(tight, Volume)
    places = [
        np.argwhere(frame.values > 0) @ frame.affine[:, :3].T + frame.affine[:, 3]
        for frame in (one, tight)
    ]
    assert places[0] == pytest.approx(places[1], abs=1e-4)
    inside = np.argwhere(tight.values > 0)
    free = np.minimum(inside.min(axis=0), np.array(tight.shape) - 1 - inside.max(axis=0))
    assert (free * np.array(tight.spacing) > 14.0).all()


def test_an_image_of_few_whole_numbers_is_tracked_as_one_where_the_user_says_so() -> None:
    images = ImageSequence((labels(), labels(18.0)))
    with pytest.raises(ParameterError, match="apex"):
        track(images, modes=4, labels=("none",))
    found = track(images, modes=4, labels=("none",), landmarks={"apex": APEX, "base": BASE})
    assert not any("cavity" in note for note in found.notes)


def left_by_steps(voxel: float, patch: float, rng: np.random.Generator) -> float:
    """RMS over all directions of a voxelised plane's mean height in a patch, along its normal."""
    n, m = 8000, 12
    normals = np.sort(np.abs(rng.normal(size=(n, 3))), axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    slopes = normals[:, :2] / normals[:, 2:]
    spread = (np.arange(m) + 0.5) / m * patch
    # Middles of columns, then of the voxel that each ends in.
    columns = np.floor((spread + voxel * rng.random((n, 2, 1))) / voxel) * voxel
    first, second = (slopes[:, i, None] * columns[:, i] for i in range(2))
    heights = voxel * rng.random((n, 1, 1)) + first[:, :, None] + second[:, None, :]
    steps = (np.floor(heights / voxel) + 0.5) * voxel - heights
    return float(np.sqrt(np.mean((steps.mean(axis=(1, 2)) * normals[:, 2]) ** 2)))


@pytest.mark.parametrize("slope", [0.0, 0.3, -0.3])
def test_the_middle_of_a_cut_aslant_is_found(slope: float) -> None:
    whole = labels()
    index = np.moveaxis(np.indices(whole.shape), 0, -1)
    local = (index @ whole.affine[:, :3].T + whole.affine[:, 3] - MIDDLE) @ AXES
    height = 22.0
    below = local[..., 2] < height + slope * local[..., 0]
    cut = Volume(np.where(below, whole.values, 0), whole.affine)
    made = from_labels(ImageSequence((cut,)), (3,))
    # x^2 / r^2 + (h + s x)^2 / l^2 = 1 is an ellipse about x = -s h / l^2 / (1 / r^2 + s^2 / l^2).
    x = -slope * height / LENGTH**2 / (1.0 / RADIUS**2 + slope**2 / LENGTH**2)
    place = MIDDLE + AXES @ np.array([x, 0.0, height + slope * x])
    base = made.landmarks["base"]
    assert base.places[0] == pytest.approx(place, abs=1.5)
    # Its height over the cut is known better.
    across = AXES @ np.array([-slope, 0.0, 1.0]) / np.hypot(slope, 1.0)
    assert base.normals is not None
    assert base.normals[0] @ across > 0.99
    assert abs((base.places[0] - place) @ base.normals[0]) < 2.0 * base.normal_sd < base.sd


def test_voxels_apart_from_the_cavity_do_not_move_its_ends() -> None:
    whole = labels()
    index = np.moveaxis(np.indices(whole.shape), 0, -1)
    local = (index @ whole.affine[:, :3].T + whole.affine[:, 3] - MIDDLE) @ AXES
    island = np.linalg.norm(local - np.array([12.0, 0.0, CUT + 10.0]), axis=-1) < 3.0
    assert island.any()
    strewn = Volume(np.where(island, 3, whole.values), whole.affine)
    made, found = (from_labels(ImageSequence((one,)), (3,)).landmarks for one in (whole, strewn))
    for name in ("apex", "base"):
        assert found[name].places == pytest.approx(made[name].places)


def gaps(values: np.ndarray) -> None:
    """Take out the wall of one side in a band below the opening, smaller than that."""
    n = values.shape[1] // 2
    beside = values[:n, n - 4 : n + 4, 20:36]
    beside[beside == 2] = 0


def cropped(image: Volume) -> Volume:
    """Cut to the labels: nothing lies beyond the opening."""
    there = np.argwhere(image.values)
    low, high = there.min(axis=0), there.max(axis=0) + 1
    box = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
    return Volume(
        image.values[box], np.column_stack([image.affine[:, :3], image.affine @ [*low, 1.0]])
    )


@pytest.mark.parametrize("kind", ["gaps", "cropped"])
def test_gaps_of_the_wall_and_the_border_of_the_image_leave_the_base(kind: str) -> None:
    whole = labels()
    if kind == "gaps":
        values = np.array(whole.values)
        gaps(values)
        image = Volume(values, whole.affine)
    else:
        image = cropped(whole)
    made = from_labels(ImageSequence((image,)))
    base = made.landmarks["base"]
    assert np.linalg.norm(base.places[0] - BASE) < 2.0 * base.sd
    assert any("Label 3 was taken as the cavity, and label 2" in note for note in made.images.notes)


def test_labels_that_are_nowhere_are_named() -> None:
    images = ImageSequence((labels(),))
    with pytest.raises(ParameterError, match="Label 7") as error:
        from_labels(images, (7,))
    assert "--label: 2: " in error.value.remedy
    assert "ml" in error.value.remedy
    with pytest.raises(ShapeError, match="planes"):
        from_labels(ImageSequence((planes(),)), (3,))


def test_a_frame_without_labels_says_what_to_do() -> None:
    whole = labels()
    empty = Volume(np.zeros_like(whole.values), whole.affine)
    with pytest.raises(ParameterError, match="Label 3 has 0 voxels in frame 1") as error:
        from_labels(ImageSequence((whole, empty)), (3,))
    assert error.value.remedy.startswith("Label the cavity in this frame too")


def test_a_stated_landmark_outside_all_labels_is_noted() -> None:
    images = ImageSequence((labels(), labels(18.0)))
    away = BASE + 15.0 * AXES[:, 2]
    assert notes_on_landmarks(images, {"apex": APEX, "base": BASE}, 0) == ()
    (note,) = notes_on_landmarks(images, {"base": away}, 1)
    assert "base is" in note
    assert "frame 1" in note
    each = np.stack([APEX, APEX - 30.0 * AXES[:, 2]])
    (note,) = notes_on_landmarks(images, {"apex": each}, 0)
    assert "apex is" in note
    assert "frame 1" in note
    # Where it is not known nothing is said.
    assert (
        notes_on_landmarks(images, {"apex": [APEX, None], "base": np.full((2, 3), np.nan)}, 0) == ()
    )
    with pytest.raises(ParameterError, match="not three finite numbers"):
        notes_on_landmarks(images, {"apex": "base"}, 0)
