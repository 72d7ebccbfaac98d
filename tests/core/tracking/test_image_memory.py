"""A beat of large volumes is tracked in little memory besides."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from ellipsoid_images import BASE, LANDMARKS, MIDDLE, volume

from modalmotion.images import ImageSequence, Volume
from modalmotion.tracking import track

N_FRAMES = 25
COARSE = (64, 64, 50)
TIMES = 4


def large(k: int) -> Volume:
    """A volume of 256 x 256 x 200, 0.43 mm, from a coarser one."""
    step = 110.0 / COARSE[0] * np.array([1.0, 1.0, 1.28])
    affine = np.column_stack([np.diag(step), MIDDLE - step * (np.array(COARSE) - 1) / 2])
    radius = 22.0 - 4.0 * np.sin(np.pi * k / N_FRAMES)
    values = volume(radius, affine=affine, shape=COARSE, seed=k).values.astype(np.int16)
    for axis in range(3):
        values = np.repeat(values, TIMES, axis=axis)
    fine = affine / TIMES
    fine[:, 3] = affine[:, 3] - affine[:, :3].sum(axis=1) * (TIMES - 1) / (2 * TIMES)
    return Volume(values, fine)


@pytest.mark.soak
def test_twenty_five_volumes_take_less_than_two_besides() -> None:
    images = ImageSequence(tuple(map(large, range(N_FRAMES))))
    first = images.frames[0]
    assert isinstance(first, Volume)
    assert first.shape == (256, 256, 200)
    landmarks = {"apex": LANDMARKS["apex"], "base": np.tile(BASE, (N_FRAMES, 1))}
    tracemalloc.start()
    result = track(images, landmarks=landmarks)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    print(f"{peak / first.values.nbytes:.2f} volumes of {first.values.nbytes / 1e6:.0f} MB")  # noqa: T201
    assert peak < 2 * first.values.nbytes
    assert result.unseen == ()
    assert result.ejection_fraction == pytest.approx(33.0, abs=5.0)
