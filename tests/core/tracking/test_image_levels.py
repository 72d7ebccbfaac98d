"""Levels beside edges: what is noise of an image, and what is blood of many brightnesses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy
from ellipsoid_images import MIDDLE, RADIUS, Look, planes, spheroid, uneven, volume

from modalmotion.images import PlaneSet, Volume
from modalmotion.tracking.image_view import FAINT, Facets, Imaging, Levels, View, renewed, view_of

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
    layered = replace(IMAGING, layers=FAINT)
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


def test_labels_of_a_thick_slice_are_those_of_its_middle() -> None:
    thin = planes(look=Look(noise=0.0), thickness=1.5)
    images = PlaneSet(tuple(replace(plane, thickness=12.0) for plane in thin.planes))
    labelled = replace(IMAGING, levels=Levels(LOOK.blood, LOOK.wall, 0.0), shifts=np.zeros((8, 3)))
    view = view_of(images, FACETS, TEMPLATE.vertices, labelled.within(4.0), 4.0)
    k = view.edges.is_found & (view.planes >= 6)
    assert np.mean(view.drawn[k]) > 0.25
    assert np.mean(view.edges.offsets[k]) == pytest.approx(0.0, abs=0.1)


def test_edges_of_labels_are_found_far_from_a_shape_that_is_too_small() -> None:
    images = planes(look=Look(noise=0.0), thickness=1.5)
    labelled = replace(IMAGING, levels=Levels(LOOK.blood, LOOK.wall, 0.0), shifts=np.zeros((8, 3)))
    small = MIDDLE + 0.75 * (TEMPLATE.vertices - MIDDLE)
    view = view_of(images, FACETS, small, labelled.within(4.0), 4.0)
    # 5.5 mm aside across the axis, beyond the reach of 4 mm.
    k = (view.planes == 3) & view.edges.is_found
    assert k.sum() > 0.9 * (view.planes == 3).sum()
    assert view.edges.offsets[k].mean() == pytest.approx(0.25 * RADIUS, abs=0.5)


@pytest.mark.parametrize(("voxel", "blur"), [(3.0, 0.5), (5.0, 0.0)])
def test_levels_are_those_beyond_the_blur_of_an_edge_and_within_the_wall(
    voxel: float, blur: float
) -> None:
    shape = int(84 / voxel), int(84 / voxel), int(108 / voxel)
    affine = np.column_stack([voxel * np.eye(3), MIDDLE - voxel / 2 * (np.array(shape) - 1)])
    sharp = volume(look=Look(noise=0.0), affine=affine, shape=shape)
    blurred = replace(sharp, values=scipy.ndimage.gaussian_filter(sharp.values, blur))
    levels = renewed(IMAGING, seen(blurred)).levels
    contrast = LOOK.blood - LOOK.wall
    assert levels.outside == pytest.approx(LOOK.wall, abs=0.05 * contrast)
    assert levels.inside == pytest.approx(LOOK.blood, abs=0.03 * contrast)
