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

from modalmotion.mesh import face_areas
from modalmotion.tracking.deformable import Deformable
from modalmotion.tracking.image_view import Sight, View

Floats = NDArray[np.float64]

# mm within an edge that muscle is looked for in, and beyond it that blood is: there an edge may
# have been drawn inward by muscle.
_WITHIN: Final = 6.0
_BEYOND: Final = 3.0

# Modes of the field of muscle, and deviation, mm, of each before it is seen.
_MODES: Final = 18
_DEVIATION: Final = 1.0

# Share of the surface that has no trabeculae: what looks like muscle there is blur and noise.
_SMOOTH: Final = 0.2

# Least share of a window in the field of view.
_SEEN: Final = 0.9


def muscle_within(view: View, sight: Sight, surface: Deformable) -> Floats:
    """Depth of muscle on the inner side of the edges, were it compact: (vertices,) mm.

    Parameters
    ----------
    view : View
    sight : Sight
    surface : Deformable

    Notes
    -----
    The integral of what is dark within an edge less that of what is bright beyond it, along the
    profile, and less what it is where it is least. Over the surface it is as smooth as a few modes.
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
    order = np.argsort(field)
    rank = np.searchsorted(np.cumsum(surface.template.weights[order]), _SMOOTH)
    return field - field[order[min(int(rank), len(field) - 1)]]


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
    missing: Floats = np.maximum(np.maximum(first, 0.0) / shrunk - now, 0.0)
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
    muscle = muscle_within(first, sights[reference], surface)
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
