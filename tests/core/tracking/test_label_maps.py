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
from modalmotion.tracking.label_maps import from_labels


@pytest.mark.every(2)
@pytest.mark.parametrize("wall", [(2,), ()], ids=["wall", "cavity alone"])
def test_a_segmentation_is_tracked_with_no_other_statement(wall: tuple[int, ...]) -> None:
    made = from_labels(ImageSequence((labels(), labels(18.0))), (3,), wall)
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
    assert made.landmarks["base"].places[0] == pytest.approx(place, abs=1.5)


def test_labels_that_are_nowhere_are_named() -> None:
    images = ImageSequence((labels(),))
    with pytest.raises(ParameterError, match="Label 7") as error:
        from_labels(images, (7,))
    assert "0, 2, 3" in error.value.remedy
    with pytest.raises(ShapeError, match="planes"):
        from_labels(ImageSequence((planes(),)), (3,))
