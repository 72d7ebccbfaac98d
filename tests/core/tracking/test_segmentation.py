"""One image: its surface, what is stated of it, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from ellipsoid_images import LANDMARKS, enclosed, labels, off_surface, volume

from modalmotion.errors import ParameterError
from modalmotion.images import ImageSequence
from modalmotion.tracking import segment


def test_one_image_becomes_a_surface_with_an_error_that_holds() -> None:
    images = ImageSequence((None, volume(20.0)))
    rows = {name: np.stack([place + 50.0, place]) for name, place in LANDMARKS.items()}
    result = segment(images, landmarks=rows, frame=1, modes=18)
    assert result.n_frames == 1
    assert off_surface(result.sequence.vertices[0], 20.0) < 0.5
    assert result.volumes is not None
    assert result.volume_deviations is not None
    assert abs(result.volumes[0] - enclosed(20.0)) < 3.0 * result.volume_deviations[0]
    assert 0.05 < float(np.median(result.deviations[0, :, 0])) < 1.0


def test_a_label_map_needs_no_landmark() -> None:
    result = segment(labels(), labels=(3,), modes=7)
    assert off_surface(result.sequence.vertices[0]) < 0.8


@pytest.mark.parametrize("frame", [-1, 0, 2])
def test_a_frame_without_an_image_is_named(frame: int) -> None:
    with pytest.raises(ParameterError, match=f"Frame {frame} has no image"):
        segment(ImageSequence((None, volume())), frame=frame)


def test_what_is_no_image_is_refused() -> None:
    with pytest.raises(ParameterError, match="read_images"):
        segment(np.zeros((3, 3, 3)))  # type: ignore[arg-type]


def test_options_and_landmarks_that_mean_nothing_are_refused() -> None:
    with pytest.raises(ParameterError, match="wall"):
        segment(labels(), wall=(2,))
    with pytest.raises(ParameterError, match="landmark 'apex' is not three"):
        segment(labels(), landmarks={"apex": [1.0, 2.0]}, labels=(3,))
