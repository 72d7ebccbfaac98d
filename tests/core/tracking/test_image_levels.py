"""Levels beside edges: what is noise of an image, and what is blood of many brightnesses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from ellipsoid_images import MIDDLE, Look, spheroid, uneven, volume

from modalmotion.images import Volume
from modalmotion.images.edges import Levels
from modalmotion.tracking.image_levels import renewed
from modalmotion.tracking.image_view import Facets, Sight, View, view_of

LOOK = Look(noise=4.0)
TEMPLATE = spheroid()
FACETS = Facets.of(TEMPLATE.faces, TEMPLATE.vertices, TEMPLATE.weights)
SIGHT = Sight(Levels(LOOK.blood, LOOK.wall, 1.0), np.zeros(3), MIDDLE, np.zeros((1, 3)))


def seen(image: Volume) -> View:
    return view_of(image, FACETS, TEMPLATE.vertices, SIGHT.within(4.0), 4.0)


def spread_of(image: Volume) -> float:
    return renewed(SIGHT, seen(image)).levels.spread


@pytest.mark.parametrize("noise", [1.0, 4.0, 8.0])
def test_the_spread_is_that_of_noise(noise: float) -> None:
    # Linear interpolation leaves 0.54 of it in the mean, and has some in common a voxel farther.
    assert spread_of(volume(look=Look(noise=noise))) == pytest.approx(0.45 * noise, rel=0.25)


def test_blood_of_many_brightnesses_is_no_noise() -> None:
    image = volume(look=Look(noise=2.0))
    even, other = spread_of(image), spread_of(uneven(image))
    view = seen(uneven(image))
    inner, _ = view.beside(is_deep=False)
    assert np.nanstd(inner) > 5.0 * even
    assert other < 2.0 * even


def test_blood_is_looked_for_beyond_a_dark_layer() -> None:
    view = seen(volume(look=LOOK))
    k = view.edges.is_found
    away = view.offsets[None] - view.edges.offsets[k, None]
    profiles = view.profiles.copy()
    profiles[k] = np.where((away > -5.0) & (away < 0.0), 70.0, profiles[k])
    dark = View(**{**vars(view), "profiles": profiles})
    layered = replace(SIGHT, has_layers=True)
    assert renewed(layered, dark).levels.inside == pytest.approx(100.0, abs=2.0)
    assert renewed(SIGHT, dark).levels.inside < 90.0
