"""Levels beside edges: what is noise of an image, and what is blood of many brightnesses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy
from ellipsoid_images import MIDDLE, Look, planes, spheroid, uneven, volume

from modalmotion.images import Volume
from modalmotion.images.edges import Levels
from modalmotion.tracking.image_levels import renewed
from modalmotion.tracking.image_view import Facets, Imaging, View, view_of

LOOK = Look(noise=4.0)
TEMPLATE = spheroid()
FACETS = Facets.of(TEMPLATE.faces, TEMPLATE.vertices, TEMPLATE.weights)
IMAGING = Imaging(Levels(LOOK.blood, LOOK.wall, 1.0), np.zeros(3), MIDDLE, np.zeros((1, 3)))


def seen(image: Volume) -> View:
    return view_of(image, FACETS, TEMPLATE.vertices, IMAGING.within(4.0), 4.0)


def spread_of(image: Volume) -> float:
    return renewed(IMAGING, seen(image)).levels.spread


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
    layered = replace(IMAGING, has_layers=True)
    assert renewed(layered, dark).levels.inside == pytest.approx(100.0, abs=2.0)
    assert renewed(IMAGING, dark).levels.inside < 90.0


@pytest.mark.parametrize("thickness", [1.5, 12.0])
def test_a_thick_slice_shows_edges_where_the_surface_is(thickness: float) -> None:
    # Drawn inward by h^2 / 24 R: 0.3 mm and more along the axis of slices of 12 mm.
    imaging = replace(IMAGING, shifts=np.zeros((8, 3)))
    images = planes(look=Look(noise=0.0), thickness=thickness)
    view = view_of(images, FACETS, TEMPLATE.vertices, imaging.within(4.0), 4.0)
    k = view.edges.is_found & (view.planes >= 6)
    normal = (view.normals * view.directions).sum(axis=1)
    assert k.sum() > 60
    assert np.mean((view.edges.offsets * normal)[k]) == pytest.approx(0.0, abs=0.1)
    is_thick = thickness > 6.0
    assert (np.mean(((view.edges.offsets - view.drawn) * normal)[k]) < -0.25) == is_thick


def test_levels_are_those_beyond_the_blur_of_an_edge() -> None:
    shape = (28, 28, 36)
    affine = np.column_stack([3.0 * np.eye(3), MIDDLE - 1.5 * (np.array(shape) - 1)])
    sharp = volume(look=Look(noise=0.0), affine=affine, shape=shape)
    blurred = replace(sharp, values=scipy.ndimage.gaussian_filter(sharp.values, 0.5))
    levels = renewed(IMAGING, seen(blurred)).levels
    contrast = LOOK.blood - LOOK.wall
    assert levels.outside == pytest.approx(LOOK.wall, abs=0.05 * contrast)
    assert levels.inside == pytest.approx(LOOK.blood, abs=0.03 * contrast)
