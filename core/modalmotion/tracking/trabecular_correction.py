"""Trabeculae that close: the muscle on the inner side of a wall keeps its volume.

The surface is that of the compact wall, muscles within it. In the reference frame blood is
between trabeculae, and what is dark within the surface is seen. As a ventricle empties, blood
leaves them, they look like the wall, and an edge is found on their inner side. What was seen of
muscle in the reference, over the area that is left, and is not seen now, is beyond that edge.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from modalmotion.images.volume import Image
from modalmotion.mesh import Cavity, face_areas, geometry, triangles
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.modes.topologies import CUP
from modalmotion.representation import Bools, Floats
from modalmotion.template import make_template
from modalmotion.tracking import image_view
from modalmotion.tracking.deformable import Deformable

# mm within an edge that muscle is looked for in, and beyond it that blood is: there an edge may
# have been drawn inward by muscle.
_WITHIN: Final = 8.0
_BEYOND: Final = 3.0

# Likeness of blood, in the mean of so many mm: muscle farther within is none of trabeculae. Nearer
# to the edge than that is its blur.
_BLOOD: Final = 0.7
_BLURRED: Final = 2.0

# No image is brighter or darker, as likeness.
_MOST_LIKE: Final = 1.5

# Share of the edges that have a layer next to them where there are trabeculae: 0.24 to
# 0.32 of phantoms that have them, 0.00 to 0.17 of others, where muscles touch the wall.
_LAYERED: Final = 0.2

# Modes of the field of muscle, and deviation, mm, of each before it is seen.
_MODES: Final = 18
_DEVIATION: Final = 1.0

# Least share of a window in the field of view.
_SEEN: Final = 0.9

# Steps in which muscle is spread until its volume is that which is missing.
_SPREADS: Final = 4


def has_trabeculae(
    image: Image, shape: MeshSequence, imaging: image_view.Imaging, reach: float
) -> bool:
    """Whether layers of blood and muscle are next to the edges of a cup's reference shape.

    Parameters
    ----------
    image : Volume or PlaneSet
    shape : MeshSequence
        One frame, mm.
    imaging : Imaging
    reach : float, mm
    """
    template = make_template(shape)
    if template.surface != CUP:
        return False
    facets = image_view.Facets.of(template.faces, template.vertices, template.weights)
    look = replace(imaging.within(reach), layers=image_view.DISTINCT)
    view = image_view.view_of(image, facets, template.vertices, look, reach)
    look = image_view.renewed(look, view)
    view = image_view.view_of(image, facets, template.vertices, look, reach)
    k = view.edges.is_found
    counted = view.weights[k]
    layered = counted[view.edges.inside[k] < 1.0].sum()
    return bool(layered > _LAYERED * counted.sum())


def muscle_within(
    view: image_view.View,
    imaging: image_view.Imaging,
    surface: Deformable,
    height: float,
    *,
    in_layers: bool = False,
) -> Floats:
    """Muscle next to the inner side of the edges, by area of the surface: (vertices,) mm.

    Parameters
    ----------
    view : View
    imaging : Imaging
    surface : Deformable
    height : float, mm
        Of the cones from the surface to the middle of its cavity.
    in_layers : bool
        Whether only what is in layers next to edges counts.

    Notes
    -----
    The integral of what is dark within an edge, as far as the first blood, less that of what is
    bright beyond it, along the profile; shells within are smaller, as of cones. Over the surface it
    is as smooth as a few modes.
    """
    k = view.edges.is_found
    like = imaging.levels.likeness(view.profiles[k], imaging.gain(view.starts[k])[:, None])
    like = np.clip(like, -_MOST_LIKE, _MOST_LIKE)
    there = np.isfinite(view.profiles[k])
    away = view.offsets[None] - view.edges.offsets[k, None]
    step = float(view.offsets[1] - view.offsets[0])
    within = (away > -_WITHIN) & (away <= 0.0)
    beyond = (away > 0.0) & (away < _BEYOND)
    share = np.maximum(1.0 + np.minimum(away, 0.0) / height, 0.0) ** 2
    muscle = within & _before_blood(like, away, step)
    dark = (muscle * (1.0 - like) * share).sum(axis=1) / 2.0
    bright = (beyond * (1.0 + like)).sum(axis=1) / 2.0
    if in_layers:
        is_layer = view.edges.inside[k] < 1.0
        dark, bright = dark * is_layer, bright * is_layer
    seen = (there & (within | beyond)).sum(axis=1) >= _SEEN * (_WITHIN + _BEYOND) / step
    depths = (dark - bright)[seen] * step * _along(view)[k][seen]
    shapes = surface.shapes[:, :_MODES]
    rows = (view.shares[k][seen][:, :, None] * shapes[view.feet[k][seen]]).sum(axis=1)
    w = view.weights[k][seen]
    spread = float(np.var(depths)) if len(depths) else 1.0
    ridge = np.full(shapes.shape[1], spread / _DEVIATION**2)
    # The mean is known.
    ridge[0] = 1e-9
    own = np.linalg.solve(rows.T @ (w[:, None] * rows) + np.diag(ridge), rows.T @ (w * depths))
    field: Floats = shapes @ own
    return field


def _before_blood(like: Floats, away: Floats, step: float) -> Bools:
    """Find the samples between an edge and the first blood on its inner side."""
    n, sums = max(1, round(_BLURRED / step)), image_view.sums_of(like)
    means = np.full(like.shape, -np.inf)
    means[:, n - 1 :] = (sums[:, n:] - sums[:, :-n]) / n
    is_blood = (means > _BLOOD) & (away <= -_BLURRED)
    first = np.where(is_blood, away, -np.inf).max(axis=1)
    before: Bools = away > np.minimum(first, -_BLURRED)[:, None]
    return before


def opened(view: image_view.View, missing: Floats) -> image_view.View:
    """Move edges outward by the muscle that is missing, (vertices,) mm along the normal."""
    own = (view.shares * missing[view.feet]).sum(axis=1) / _along(view)
    return replace(view, edges=view.edges._replace(offsets=view.edges.offsets + own))


def spread_over(surface: Deformable, x: Floats, muscle: Floats, volume: float) -> Floats:
    """Depth in which muscle covers a surface on its outer side, (vertices,) mm.

    Parameters
    ----------
    surface : Deformable
    x : (vertices, 3) float64, mm
    muscle : (vertices,) float64, mm
        Of its depth the shape alone; none below zero.
    volume : float, mm^3
    """
    faces = surface.template.faces
    cavity = Cavity(faces)
    own = float(cavity.volume(x))
    normals = np.sign(own) * geometry.vertex_normals(x, faces)
    depth = np.maximum(muscle, 0.0)
    if volume <= 0 or not depth.any():
        return np.zeros(len(x))
    for _ in range(_SPREADS):
        added = abs(float(cavity.volume(x + depth[:, None] * normals))) - abs(own)
        depth = depth * np.clip(volume / max(added, 1e-9 * volume), 0.2, 3.0)
    return depth


def with_trabeculae(
    views: Sequence[image_view.View | None],
    imagings: Sequence[image_view.Imaging],
    surface: Deformable,
    shapes: Floats,
    reference: int,
) -> tuple[list[image_view.View | None], Floats]:
    """Move the edges of all frames but the reference to the outer side of trabeculae.

    Parameters
    ----------
    views : sequence of View or None
    imagings : sequence of Imaging
        That each was seen with.
    surface : Deformable
    shapes : (frames, vertices, 3) float64, mm
    reference : int

    Returns
    -------
    views : list of View or None
    moved : (frames,) float64, mm
        Mean over the surface of what each was moved by.
    """
    means = np.zeros(len(views))
    first = views[reference]
    if first is None:
        return list(views), means
    template, faces = surface.template, surface.template.faces
    # Of the cones over a surface that fill its cavity.
    volumes = np.abs(Cavity(faces).volume(shapes))
    heights = [3.0 * v / face_areas(x, faces).sum() for v, x in zip(volumes, shapes, strict=True)]
    muscle = muscle_within(first, imagings[reference], surface, heights[reference], in_layers=True)
    areas = [triangles.vertex_areas(x, faces) for x in shapes]
    whole = float(muscle @ areas[reference])
    moved: list[image_view.View | None] = []
    for k, view in enumerate(views):
        if view is None or k == reference or not view.edges.is_found.any():
            moved.append(view)
            continue
        now = muscle_within(view, imagings[k], surface, heights[k])
        # It is where there was more of it than is seen.
        denser = np.maximum(muscle, 0.0) * float(areas[reference].sum() / areas[k].sum())
        places = denser - np.maximum(now, 0.0)
        depth = spread_over(surface, shapes[k], places, whole - float(now @ areas[k]))
        moved.append(opened(view, depth))
        means[k] = template.weights @ depth
    return moved, means


def _along(view: image_view.View) -> Floats:
    """Part of each profile's direction that is along the normal."""
    along: Floats = (view.directions * view.normals).sum(axis=1)
    return along
