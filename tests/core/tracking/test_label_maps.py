"""Label maps: tracked with no landmark of the user's."""

from __future__ import annotations

import numpy as np
import pytest
from ellipsoid_images import (
    APEX,
    AXES,
    BASE,
    CUT,
    MIDDLE,
    RADIUS,
    enclosed,
    labels,
    off_surface,
    planes,
)

from modalmotion.errors import ParameterError, ShapeError
from modalmotion.images import ImageSequence
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


def test_labels_that_are_nowhere_are_named() -> None:
    images = ImageSequence((labels(),))
    with pytest.raises(ParameterError, match="Label 7") as error:
        from_labels(images, (7,))
    assert "0, 2, 3" in error.value.remedy
    with pytest.raises(ShapeError, match="planes"):
        from_labels(ImageSequence((planes(),)), (3,))
