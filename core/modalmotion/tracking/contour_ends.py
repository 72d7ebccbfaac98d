"""Where contours end: the rim of an opening passes through ends of arcs, and between slices.

Points along lines show no rim by their density. The planes that they are in do: an arc that is open
ends at the rim, and where a slice has a contour and the next one has none the rim is between them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
import scipy

from modalmotion.modes.topology import CUP
from modalmotion.representation import Floats, Ints
from modalmotion.template import Template
from modalmotion.tracking.closest import across
from modalmotion.tracking.ends_of_data import lies_evenly
from modalmotion.tracking.moving_base import DESCENT, HELD, LENGTH, OFF_PATH, ends_of_cup
from modalmotion.tracking.observation import Frame, Observation, ends_in

Ints = Ints

# Points of a contour at least; triples of points that a plane is looked for by, and points that are
# counted for each.
_FEWEST: Final = 6
_TRIPLES: Final = 300
_MOST_COUNTED: Final = 10_000

# Of the distance between neighbours: points of a plane are within it.
_THICKNESS: Final = 0.05

# Of the points: planes of fewer are chance.
_LEAST: Final = 0.01

# Of the points of a frame, that are in planes of the reference.
_MOST: Final = 0.9

# Of the distance between neighbours, and of the way around: a wider gap is an opening.
_GAP: Final = 3.5
_OPEN: Final = 0.08

# Cosines to the axis of slices across it, and of two slices of one stack.
_ACROSS: Final = 0.7
_PARALLEL: Final = 0.985

# Tangents: of the rim against slices, and of that in one frame against another.
_LEAN: Final = 0.3
_SWAY: Final = 0.1

# Of the radius: deviation of a rim from a plane.
_UNEVEN: Final = 0.05

# Iterations: levels and volumes follow from each other.
_TURNS: Final = 3


class _Planes(NamedTuple):
    """Planes n . x = d, n towards the base where they are across the axis."""

    normals: Floats
    offsets: Floats


class _Contour(NamedTuple):
    """Points of a plane in order, from one end to the other; both ends, none where it is closed."""

    points: Floats
    ends: Floats
    step: float


def with_contour_ends(
    frames: Sequence[Frame], template: Template | None, reference: int
) -> tuple[tuple[Frame, ...], Mapping[str, Floats]]:
    """Add to frames of contours where these say that the surface ends.

    Parameters
    ----------
    frames : sequence of Frame
    template : Template, optional
        Whose axis it is where no landmarks of the reference say it.
    reference : int
        Frame whose planes all frames have.

    Returns
    -------
    tuple of Frame
        With points of the rim half a step beyond the ends of open arcs, as `end="base"`, and the
        levels of base and apex along the normal of a stack of slices, as landmarks. Frames that
        state an end keep to that, and all are as they were where points are not in planes that
        stay.
    dict of str to (frames, frames) float64, length unit squared
        Covariance of levels that are between slices, as `with_levels` takes it.
    """
    ends_of_axis = _ends_of_axis(frames[reference], template)
    if ends_of_axis is None:
        return tuple(frames), {}
    tip, base = ends_of_axis
    axis = (base - tip) / np.linalg.norm(base - tip)
    planes = _Planes(np.zeros((0, 3)), np.zeros(0))
    drawn: dict[int, dict[int, _Contour]] = {}
    for k in [reference, *(k for k in range(len(frames)) if k != reference)]:
        even = [part.points for part in frames[k] if lies_evenly(part)]
        points = np.concatenate(even) if even else np.zeros((0, 3))
        if len(points) < _FEWEST:
            continue
        step = float(np.median(scipy.spatial.cKDTree(points).query(points, k=2)[0][:, 1]))
        if not drawn:
            planes = _planes_of(points, axis, _THICKNESS * step)
        away = np.abs(points @ planes.normals.T - planes.offsets)
        is_on = away < _THICKNESS * step
        if not is_on.any(axis=1).mean() >= _MOST:
            return tuple(frames), {}
        counts = is_on.sum(axis=0)
        drawn[k] = {
            int(i): _contour(points[is_on[:, i]], planes.normals[i])
            for i in np.flatnonzero(counts >= _FEWEST)
        }
    stack = _stack(planes, axis)
    ends = {k: _ends_of(own, planes, stack) for k, own in drawn.items()}
    full, covariance = list(frames), np.zeros((0, 0))
    levels: dict[int, Observation] = {}
    if len(stack):
        levels, covariance = _levels(frames, drawn, ends, planes, stack, ends_of_axis)
    for k, own in ends.items():
        # However close slices are, that none is beyond the last one shows no end of a cloud.
        full[k] = tuple(
            replace(part, weights=np.ones(len(part))) if lies_evenly(part) else part
            for part in full[k]
        )
        if not any(p.end == "base" or "base" in (p.places or ()) for p in frames[k]):
            full[k] = (*full[k], *own, *([levels[k]] if k in levels else ()))
    for k, level in _tips(frames, drawn, planes, stack).items():
        full[k] = (*full[k], level)
    return tuple(full), {"base": covariance} if covariance.any() else {}


def _ends_of_axis(frame: Frame, template: Template | None) -> tuple[Floats, Floats] | None:
    """Apex and base; None if neither landmarks nor a cup say them."""
    ends = ends_in(frame)
    if not {"apex", "base"} <= set(ends):
        if template is None or template.topology != CUP:
            return None
        ends = dict(zip(("apex", "base"), ends_of_cup(template), strict=True))
    return None if (ends["base"] == ends["apex"]).all() else (ends["apex"], ends["base"])


def _planes_of(points: Floats, axis: Floats, thickness: float) -> _Planes:
    """Find planes with most points, one after the other."""
    normals, offsets, left = [], [], points
    rng = np.random.default_rng(0)
    while len(left) >= _FEWEST:
        # Near each other, so that most triples are of one contour.
        k = min(len(left), max(2 * _FEWEST, min(len(left), _MOST_COUNTED) // 8))
        first = rng.integers(len(left), size=_TRIPLES)
        near = scipy.spatial.cKDTree(left).query(left[first], k=k)[1]
        second, third = (near[np.arange(_TRIPLES), rng.integers(1, k, _TRIPLES)] for _ in range(2))
        n = np.cross(left[second] - left[first], left[third] - left[first])
        n /= np.maximum(np.linalg.norm(n, axis=1), 1e-300)[:, None]
        offset = (left[first] * n).sum(axis=1)
        # Of many points some say which plane contains most of them.
        some = left[:: -(-len(left) // _MOST_COUNTED)]
        counts = (np.abs(some @ n.T - offset) < thickness).sum(axis=0)
        best = int(np.where(n.any(axis=1), counts, -1).argmax())
        own = left[np.abs(left @ n[best] - offset[best]) < thickness]
        if len(own) < _FEWEST:
            break
        normal = np.linalg.svd(own - own.mean(axis=0), full_matrices=False)[2][-1]
        normal *= 1.0 if normal @ axis >= 0 else -1.0
        kept = np.abs((left - own.mean(axis=0)) @ normal) < thickness
        if kept.sum() < max(_FEWEST, _LEAST * len(points)):
            break
        normals.append(normal)
        offsets.append(own.mean(axis=0) @ normal)
        left = left[~kept]
    return _Planes(np.array(normals).reshape(-1, 3), np.array(offsets))


def _contour(points: Floats, normal: Floats) -> _Contour:
    """Order points of a plane around their middle, from the widest gap on."""
    flat = (points - points.mean(axis=0)) @ across(normal).T
    ring = points[np.argsort(np.arctan2(flat[:, 1], flat[:, 0]))]
    gaps = np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1)
    widest = int(gaps.argmax())
    arc, step = np.roll(ring, -widest - 1, axis=0), float(np.delete(gaps, widest).mean())
    if gaps[widest] <= max(_GAP * step, _OPEN * gaps.sum()):
        return _Contour(arc, np.zeros((0, 3)), step)
    # A point represents half a step on either side.
    return _Contour(arc, np.stack([_beyond(arc[:4], step), _beyond(arc[:-5:-1], step)]), step)


def _beyond(arc: Floats, step: float) -> Floats:
    """Go half a step beyond the first point of an arc."""
    away = arc[0] - arc[1:].mean(axis=0)
    place: Floats = arc[0] + 0.5 * step * away / (np.linalg.norm(away) or 1.0)
    return place


def _stack(planes: _Planes, axis: Floats) -> Ints:
    """Take the largest stack of parallel slices across the axis, by height; none of one or two."""
    are_across = planes.normals @ axis > _ACROSS
    alike = (planes.normals @ planes.normals.T > _PARALLEL) & are_across & are_across[:, None]
    if not alike.any():
        return np.zeros(0, dtype=np.int64)
    own = np.flatnonzero(alike[int(alike.sum(axis=1).argmax())])
    return own[np.argsort(planes.offsets[own])] if len(own) > 2 else own[:0]


def _ends_of(contours: dict[int, _Contour], planes: _Planes, stack: Ints) -> list[Observation]:
    """Find points of the rim in one frame."""
    closed = [i for i in stack if i in contours and not len(contours[i].ends)]
    normal, low = (planes.normals[closed[-1]], planes.offsets[closed[-1]]) if closed else (0.0, 0.0)
    found = []
    for is_across in (True, False):
        own = [one for i, one in contours.items() if (i in stack) == is_across and len(one.ends)]
        ends = np.concatenate([np.zeros((0, 3)), *(one.ends for one in own)])
        # A gap below a closed contour is not the opening.
        ends = ends[ends @ normal > low] if closed else ends
        if not len(ends):
            continue
        step = float(np.median([one.step for one in own]))
        normals = np.tile(planes.normals[stack[0]], (len(ends), 1)) if is_across else None
        found.append(
            Observation(ends, sd=(0.25 if is_across else 0.5) * step, normals=normals, end="base")
        )
    return found


def _levels(
    frames: Sequence[Frame],
    drawn: dict[int, dict[int, _Contour]],
    ends: dict[int, list[Observation]],
    planes: _Planes,
    stack: Ints,
    ends_of_axis: tuple[Floats, Floats],
) -> tuple[dict[int, Observation], Floats]:
    """Find how high the middle of the rim is in each frame.

    The rim is taken as a plane that leans alike in all frames, but for some degrees. Ends of arcs
    are on it, and stated bases in its middle. Where no arc crosses it, it is between the last
    slice with a contour and the next; by how much not in the middle, all frames have in common.
    All are near H - c E, E being the percentage of the volume ejected: see `base_by_volume`.

    Returns
    -------
    dict of int to Observation
    (frames, frames) float64, length unit squared
        Covariance of levels that are between slices. Others have none.
    """
    normal, heights = planes.normals[stack[0]], planes.offsets[stack]
    spacing = float(np.median(np.diff(heights)))
    aside = across(normal)
    tip, base = ends_of_axis
    unit = float(np.linalg.norm(base - tip)) / LENGTH
    numbers = [k for k, own in drawn.items() if any(plane in own for plane in stack)]
    n = 3 * len(numbers) + 5
    by_itself = np.array([_LEAN, _LEAN, spacing / 4.0, unit * DESCENT[1]])
    rows, values = [np.eye(n)[-5:-1] / by_itself[:, None]], [np.zeros(4)]
    values[0][-1] = DESCENT[0] / DESCENT[1]

    def add(row: Floats, value: float, sd: float) -> None:
        rows.append(row[None] / sd)
        values.append(np.array([value / sd]))

    middles, between = {}, []
    for i, k in enumerate(numbers):
        own = drawn[k]
        last = max(j for j, plane in enumerate(stack) if plane in own)
        closed = [own[plane] for plane in stack if plane in own and not len(own[plane].ends)]
        around = (closed or [own[stack[last]]])[-1].points
        middles[k] = middle = around.mean(axis=0)
        uneven = _UNEVEN * float(((around - middle) ** 2).sum(axis=1).mean()) ** 0.5
        marks = [
            (point, 0.0 if part.sd is None else float(np.mean(part.sd)))
            for part in (*frames[k], *ends[k])
            for row, point in enumerate(part.points)
            if part.end == "base" or (part.places and part.places[row] == "base")
        ]
        for point, sd in marks:
            row = np.zeros(n)
            row[3 * i : 3 * i + 3] = 1.0, *(aside @ (point - middle))
            add(row, point @ normal, float(np.hypot(sd, uneven)))
        for j in (0, 1):
            row = np.zeros(n)
            row[[3 * i + 1 + j, n - 5 + j]] = 1.0, -1.0
            add(row, 0.0, _SWAY)
        if not ends[k]:
            high = heights[last + 1] if last + 1 < len(heights) else heights[last] + spacing
            row = np.zeros(n)
            row[[3 * i, n - 3]] = 1.0, -1.0
            add(row, (high + heights[last]) / 2.0, (high - heights[last]) / 12**0.5)
        if not marks:
            between.append(i)
    n_free, ejected = len(rows), np.zeros(len(numbers))
    for _ in range(_TURNS):
        del rows[n_free:], values[n_free:]
        for i, percent in enumerate(ejected):
            row = np.zeros(n)
            row[[3 * i, n - 2, n - 1]] = 1.0, percent, -1.0
            add(row, 0.0, unit * OFF_PATH)
        matrix, vector = np.concatenate(rows), np.concatenate(values)
        covariance = np.linalg.pinv(matrix.T @ matrix)
        found = covariance @ (matrix.T @ vector)
        volumes = np.array(
            [
                _volume(drawn[k], planes, stack, float(tip @ normal), found[3 * i])
                for i, k in enumerate(numbers)
            ]
        )
        ejected = 100.0 * (1.0 - volumes / volumes.max())
    of_levels = covariance[: n - 5 : 3, : n - 5 : 3]
    levels, stated = {}, np.zeros((len(frames), len(frames)))
    for i, k in enumerate(numbers):
        place = middles[k] + (found[3 * i] - middles[k] @ normal) * normal
        # What levels of frames have in common counts once, and not once a frame.
        sd = max(of_levels[i].sum(), of_levels[i, i]) ** 0.5
        if i in between:
            sd = unit * HELD
            stated[k, np.array(numbers)[between]] = of_levels[i, between]
        levels[k] = Observation(place[None], sd=sd, normals=normal[None], places=("base",))
    return levels, stated


def _volume(
    own: dict[int, _Contour], planes: _Planes, stack: Ints, tip: float, level: float
) -> float:
    """Volume within the contours of one frame up to a level: near its tip a paraboloid."""
    kept = [plane for plane in stack if plane in own]
    heights, normal = planes.offsets[kept], planes.normals[stack[0]]
    flat = [across(normal) @ own[plane].points.T for plane in kept]
    areas = np.array([abs(float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())) for x, y in flat])
    areas /= 2.0
    ends = areas[0] * (heights[0] - tip) / 2.0 + areas[-1] * (level - heights[-1])
    return float(np.trapezoid(areas, heights) + ends)


def _tips(
    frames: Sequence[Frame], drawn: dict[int, dict[int, _Contour]], planes: _Planes, stack: Ints
) -> dict[int, Observation]:
    """Take the level of the apex between the first slice with a contour and the one before.

    Small sections are not drawn, so that it may be farther off, in all frames alike: by how much is
    known where it is stated. Contours along the axis show it better.
    """
    if not len(stack) or any(set(own) - set(stack.tolist()) for own in drawn.values()):
        return {}
    normal, heights = planes.normals[stack[0]], planes.offsets[stack]
    spacing = float(np.median(np.diff(heights)))
    found, off = {}, []
    for k, own in drawn.items():
        first = min((j for j, plane in enumerate(stack) if plane in own), default=0)
        before = heights[first - 1] if first else heights[0] - spacing
        level, sd = (heights[first] + before) / 2.0, (heights[first] - before) / 12**0.5
        stated = [
            point @ normal - level
            for part in frames[k]
            for place, point in zip(part.places or (), part.points, strict=False)
            if place == "apex"
        ]
        off += stated
        if not stated and stack[first] in own:
            place = own[stack[first]].points.mean(axis=0)
            found[k] = place + (level - place @ normal) * normal, sd
    # Prior s, and s / 12^1/2 of each statement.
    share = 12.0 * len(off) / (12.0 * len(off) + 1.0)
    offset = share * float(np.mean(off)) if off else 0.0
    left = spacing**2 * (1.0 - share)
    return {
        k: Observation(
            (place + offset * normal)[None],
            sd=(sd**2 + left) ** 0.5,
            normals=normal[None],
            places=("apex",),
        )
        for k, (place, sd) in found.items()
    }
