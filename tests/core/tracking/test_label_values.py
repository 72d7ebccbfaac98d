"""Which label is the cavity: what its wall encloses, whatever the values are."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from ellipsoid_images import labels, volume

from modalmotion.errors import ParameterError
from modalmotion.images import ImageSequence, Volume
from modalmotion.tracking.label_values import cavity_in, is_label_map, whole_labels

SIDE = 48


def heart(*values: int, thick: bool = True) -> ImageSequence:
    """Both ventricles by slices, the wall of the left one, and muscles in it.

    Values are of cavity, wall, right ventricle and muscles.
    """
    x, y, z = np.indices((SIDE, SIDE, 10)) - np.array([20, 24, 0]).reshape(3, 1, 1, 1)
    r, beside = np.hypot(x, y), np.hypot(x - 16.0, y)
    own = np.zeros((SIDE, SIDE, 10), dtype=np.int16)
    cavity, wall, right, muscle = (*values, 0, 0)[:4]
    own[(beside < 11) & (z < 9)] = right
    own[r < 12] = wall
    own[r < 8] = cavity
    own[np.hypot(x - 3, y) < 2] = muscle or cavity
    affine = np.column_stack([np.diag([1.5, 1.5, 8.0 if thick else 1.5]), np.zeros(3)])
    return ImageSequence((Volume(own, affine),))


@pytest.mark.parametrize("values", list(permutations((1, 2, 3))))
def test_any_order_of_values_is_read_alike(values: tuple[int, ...]) -> None:
    for thick in (True, False):
        found = cavity_in(heart(*values, thick=thick))
        assert found[0] == values[0]


def test_muscles_within_the_cavity_are_none() -> None:
    value, note = cavity_in(heart(5, 2, 9, 7))
    assert value == 5
    assert "label 2, which" in note
    assert "5: " in note
    assert "ml" in note


def test_a_gap_in_the_wall_changes_nothing() -> None:
    frame = heart(1, 2, 3).frames[0]
    assert isinstance(frame, Volume)
    values = np.array(frame.values)
    values[:20, 22:27][values[:20, 22:27] == 2] = 0
    assert cavity_in(ImageSequence((Volume(values, frame.affine),)))[0] == 1


def test_what_geometry_does_not_tell_is_asked_by_name() -> None:
    # Two cavities beside one another, and no wall.
    with pytest.raises(ParameterError, match=r"Which label.*1: [\d.]+ ml, 3: [\d.]+ ml") as error:
        cavity_in(heart(1, 0, 3))
    assert "--label" in error.value.remedy
    many = np.arange(1, 21).reshape(20, 1, 1) * np.ones((1, 20, 20), dtype=np.int64)
    with pytest.raises(ParameterError, match="20, more than in a heart"):
        cavity_in(ImageSequence((Volume(many, np.eye(4)[:3]),)))


def test_one_label_is_a_cavity_unless_it_is_a_ring() -> None:
    assert cavity_in(heart(4, 0, 0))[0] == 4
    with pytest.raises(ParameterError, match="ring"):
        cavity_in(heart(0, 2, 0))


def test_brightness_is_no_label() -> None:
    assert is_label_map(ImageSequence((labels(),)))
    assert is_label_map(heart(3, 2, 1))
    grey = volume()
    assert not is_label_map(ImageSequence((grey,)))
    whole = Volume(np.rint(grey.values).astype(np.int16), grey.affine)
    assert not is_label_map(ImageSequence((whole,)))
    assert not is_label_map(ImageSequence((Volume(np.zeros((4, 4, 4)), np.eye(4)[:3]),)))


def test_images_of_few_values_are_said_to_be_no_label_map() -> None:
    assert whole_labels(["none"]) == []
    assert whole_labels(["3"]) == [3]
    with pytest.raises(ParameterError) as error:
        whole_labels(["blood"])
    assert "--label none" in error.value.remedy


def test_a_label_map_with_voxels_that_are_no_numbers_is_refused_as_such() -> None:
    values = np.zeros((8, 8, 8))
    values[2:6, 2:6, 2:6] = 1.0
    values[0, 0, 0] = np.nan
    wrong, right = Volume(values, np.eye(4)), Volume(np.nan_to_num(values), np.eye(4))
    for images in (ImageSequence((wrong,)), ImageSequence((right, wrong))):
        with pytest.raises(ParameterError, match="1 voxels of the label map are not numbers"):
            is_label_map(images)
