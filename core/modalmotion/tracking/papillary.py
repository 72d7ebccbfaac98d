"""Papillary muscles: how much within a surface looks like its outside.

The surface that is tracked is that of the compact wall, muscles within the pool: edges nearer to
the axis are crossed where blood lies beyond them, and are strays where none does. Muscle keeps
its volume over the beat. So one number turns volumes of the convention `pool` into those of the
convention `wall`, in which muscles do not count as cavity.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from modalmotion.images import PlaneSet
from modalmotion.images.sequence import Image
from modalmotion.tracking.image_view import Facets, Sight

Papillary: TypeAlias = Literal["pool", "wall"]

CONVENTIONS: Final[tuple[Papillary, ...]] = get_args(Papillary)

Floats = NDArray[np.float64]

# Places on lines from the middle to the surface, as shares.
_SHARES: Final = (np.arange(20) + 0.5) / 20.0

# Of a voxel's longer side in the image: nearer to the surface its own edge is seen.
_SHELL: Final = 1.4


def papillary_volume(
    images: Iterable[Image | None], shapes: Floats, volumes: Floats, facets: Facets, sight: Sight
) -> float:
    """Volume within the surface that looks like the outside, mm^3: the median of the frames.

    Parameters
    ----------
    images : iterable of Volume, PlaneSet or None
    shapes : (frames, vertices, 3) float64, mm
    volumes : (frames,) float64, mm^3
    facets : Facets
    sight : Sight
    """
    own = [
        _share(image, x, facets, sight) * volume
        for image, x, volume in zip(images, shapes, volumes, strict=True)
        if image is not None
    ]
    return float(max(np.median(own), 0.0)) if own else 0.0


def _side(image: Image) -> float:
    if isinstance(image, PlaneSet):
        return max(max(plane.spacing) for plane in image.planes)
    return float(np.median(image.spacing))


def _share(image: Image, x: Floats, facets: Facets, sight: Sight) -> float:
    """Share of the cavity, weighted by volume, that is like the outside."""
    corners = x[facets.faces]
    middle = x.mean(axis=0)
    centres = corners.mean(axis=1) - middle
    # Cones from the middle: dV = 3 V t^2 dt.
    cones = np.abs((np.cross(corners[:, 1] - middle, corners[:, 2] - middle) * centres).sum(axis=1))
    points = (middle + _SHARES[:, None, None] * centres).reshape(-1, 3)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    heights = (normals * centres).sum(axis=1) / np.maximum(np.linalg.norm(normals, axis=1), 1e-300)
    depths = np.outer(1.0 - _SHARES, np.abs(heights))
    weights = (_SHARES[:, None] ** 2 * cones).ravel()
    is_deep = (depths > _SHELL * _side(image)).ravel()
    if isinstance(image, PlaneSet):
        seen, places, counted, deep = [], [], [], []
        for plane, shift in zip(image.planes, sight.shifts, strict=True):
            near = np.abs(plane.heights(points)) < plane.thickness / 2
            seen.append(plane.sample(points[near] + shift))
            places.append(points[near])
            counted.append(weights[near])
            deep.append(is_deep[near])
        values, points = np.concatenate(seen), np.concatenate(places)
        weights, is_deep = np.concatenate(counted), np.concatenate(deep)
    else:
        values = image.sample(points)
    there = np.isfinite(values)
    dark = (1.0 - sight.levels.likeness(values[there], sight.gain(points[there]))) / 2.0
    # What noise does to blood on either side cancels in the mean.
    muscle = (weights[there] * is_deep[there] * np.clip(dark, -0.5, 1.5)).sum()
    total = float(weights[there].sum())
    return float(muscle) / total if total > 0 else 0.0
