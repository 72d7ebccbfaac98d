"""Trabeculae that close: the muscle on the inner side of a wall keeps its volume.

The surface is that of the compact wall, muscles within it. In the reference frame blood lies
between trabeculae, and what is dark within the surface is seen. As a ventricle empties, blood
leaves them, they look like the wall, and an edge is found on their inner side. What was seen of
muscle in the reference, over the area that is left, and is not seen now, lies beyond that edge.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.images.sequence import Image
from modalmotion.mesh import face_areas
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.modes.topology import CUP
from modalmotion.template import make_template
from modalmotion.tracking.deformable import Deformable
from modalmotion.tracking.image_levels import renewed
from modalmotion.tracking.image_view import Facets, Sight, View, view_of

Floats = NDArray[np.float64]

# mm within an edge that muscle is looked for in, and beyond it that blood is: there an edge may
# have been drawn inward by muscle.
_WITHIN: Final = 6.0
_BEYOND: Final = 3.0

# Share of the edges that have a layer next to them where there are trabeculae: 0.24 to
# 0.32 of phantoms that have them, 0.00 to 0.17 of others, where muscles touch the wall.
_LAYERED: Final = 0.2

# Modes of the field of muscle, and deviation, mm, of each before it is seen.
_MODES: Final = 18
_DEVIATION: Final = 1.0

# Least share of a window in the field of view.
_SEEN: Final = 0.9


def has_trabeculae(image: Image, shape: MeshSequence, sight: Sight, reach: float) -> bool:
    """Whether layers of blood and muscle lie next to the edges of a cup's reference shape.

    Parameters
    ----------
    image : Volume or PlaneSet
    shape : MeshSequence
        One frame, mm.
    sight : Sight
    reach : float, mm
    """
    return layered_share(image, shape, sight, reach) > _LAYERED


def layered_share(image: Image, shape: MeshSequence, sight: Sight, reach: float) -> float:
    """Share of the edges of a cup that have a layer next to them; none of other surfaces."""
    template = make_template(shape)
    if template.surface != CUP:
        return 0.0
    facets = Facets.of(template.faces, template.vertices, template.weights)
    look = replace(sight.within(reach), has_layers=True)
    view = view_of(image, facets, template.vertices, look, reach)
    look = renewed(look, view, is_deep=True)
    view = view_of(image, facets, template.vertices, look, reach)
    k = view.edges.is_found
    counted = view.weights[k]
    layered = counted[view.edges.inside[k] < 1.0].sum()
    return float(layered) / max(float(counted.sum()), 1e-300)


def muscle_within(
    view: View, sight: Sight, surface: Deformable, *, in_layers: bool = False
) -> Floats:
    """Depth of muscle on the inner side of the edges, were it compact: (vertices,) mm.

    Parameters
    ----------
    view : View
    sight : Sight
    surface : Deformable
    in_layers : bool
        Whether only what lies in layers next to edges counts.

    Notes
    -----
    The integral of what is dark within an edge less that of what is bright beyond it, along the
    profile; over the surface it is as smooth as a few modes.
    """
    k = view.edges.is_found
    like = sight.levels.likeness(view.profiles[k], sight.gain(view.starts[k])[:, None])
    there = np.isfinite(view.profiles[k])
    away = view.offsets[None] - view.edges.offsets[k, None]
    step = float(view.offsets[1] - view.offsets[0])
    within = (away > -_WITHIN) & (away <= 0.0)
    beyond = (away > 0.0) & (away < _BEYOND)
    dark = (within * (1.0 - like)).sum(axis=1) / 2.0
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


def opened(view: View, missing: Floats) -> View:
    """Move edges outward by the muscle that is missing, (vertices,) mm along the normal."""
    own = (view.shares * missing[view.feet]).sum(axis=1) / _along(view)
    return replace(view, edges=view.edges._replace(offsets=view.edges.offsets + own))


def missing_muscle(first: Floats, now: Floats, shrunk: float) -> Floats:
    """Muscle of the reference that is not seen in a frame, (vertices,) mm, none where more is.

    Parameters
    ----------
    first, now : (vertices,) float64, mm
        Of the reference and of the frame.
    shrunk : float
        Area of the frame's surface over that of the reference.
    """
    there = np.maximum(first, 0.0) / shrunk
    missing: Floats = np.maximum(there - np.maximum(now, 0.0), 0.0)
    return missing


def with_trabeculae(
    views: Sequence[View | None],
    sights: Sequence[Sight],
    surface: Deformable,
    shapes: Floats,
    reference: int,
) -> tuple[list[View | None], Floats]:
    """Move the edges of all frames but the reference to the outer side of trabeculae.

    Parameters
    ----------
    views : sequence of View or None
    sights : sequence of Sight
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
    muscle = muscle_within(first, sights[reference], surface, in_layers=True)
    areas = [float(face_areas(x, surface.template.faces).sum()) for x in shapes]
    moved: list[View | None] = []
    for k, view in enumerate(views):
        if view is None or k == reference or not view.edges.is_found.any():
            moved.append(view)
            continue
        now = muscle_within(view, sights[k], surface)
        missing = missing_muscle(muscle, now, areas[k] / areas[reference])
        moved.append(opened(view, missing))
        means[k] = surface.template.weights @ missing
    return moved, means


def _along(view: View) -> Floats:
    """Part of each profile's direction that is along the normal."""
    along: Floats = (view.directions * view.normals).sum(axis=1)
    return along
