"""Where contours end: the rim of an opening passes through ends of arcs, and between slices.

Points along lines show no rim by their density. The planes that they are in do: an arc that is open
ends at the rim, and where a slice has a contour and the next one has none the rim is between them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
import scipy

from modalmotion.modes.topologies import CUP
from modalmotion.representation import Bools, Floats, Ints
from modalmotion.template import Template
from modalmotion.tracking import closest, ends_of_data, moving_base
from modalmotion.tracking.observation import Frame, Observation, ends_in, marks_at, states_end

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

# Tangent of the rim against slices.
_LEAN: Final = 0.3

# Steps that an arc goes on beyond its last point, and their deviation where a base that is stated
# shows them.
_BEYOND: Final = (0.5, 1.0)

# Of the radius: deviation of a rim from a plane.
_UNEVEN: Final = 0.05

# Iterations: levels and volumes follow from each other.
_TURNS: Final = 3


class _Planes(NamedTuple):
    """Planes n . x = d, n towards the base where they are across the axis.

    `stack` is the largest stack of parallel slices across the axis, by height; none of one or two.
    """

    normals: Floats
    offsets: Floats
    stack: Ints

    @property
    def normal(self) -> Floats:
        """That of the stack, (3,)."""
        own: Floats = self.normals[self.stack[0]]
        return own


class _Contour(NamedTuple):
    """Points of a plane in order, from one end to the other, and the mean step between them.

    Of both ends the last points and the directions in which it goes on, none where it is closed.
    """

    points: Floats
    ends: Floats
    ways: Floats
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
        With points of the rim beyond the ends of open arcs, as `end="base"`, by half a step or as
        far as the reference shows, and the level of the base along the normal of a stack of
        slices, as landmarks. Frames that state an end keep to that, and all are as they were where
        points are not in planes that stay.
    dict of str to (frames, frames) float64, length unit squared
        Covariance of levels that are between slices, as `with_levels` takes it.
    """
    ends_of_axis = _ends_of_axis(frames[reference], template)
    if ends_of_axis is None:
        return tuple(frames), {}
    tip, base = ends_of_axis
    axis = (base - tip) / np.linalg.norm(base - tip)
    planes = _planes_of(np.zeros((0, 3)), axis, 0.0)
    drawn: dict[int, dict[int, _Contour]] = {}
    for k in [reference, *(k for k in range(len(frames)) if k != reference)]:
        even = [part.points for part in frames[k] if ends_of_data.lies_evenly(part)]
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
    beyond = _beyond(frames[reference], drawn.get(reference, {}), planes)
    ends = {k: _ends_of(own, planes, beyond) for k, own in drawn.items()}
    full, covariance = list(frames), np.zeros((0, 0))
    levels: dict[int, Observation] = {}
    if len(planes.stack):
        levels, covariance = _levels(frames, drawn, ends, planes, ends_of_axis)
    for k, own in ends.items():
        # However close slices are, that none is beyond the last one shows no end of a cloud.
        full[k] = tuple(
            replace(part, weights=np.ones(len(part))) if ends_of_data.lies_evenly(part) else part
            for part in full[k]
        )
        if not states_end(frames[k], "base"):
            full[k] = (*full[k], *own, *([levels[k]] if k in levels else ()))
    return tuple(full), {"base": covariance} if covariance.any() else {}


def _ends_of_axis(frame: Frame, template: Template | None) -> tuple[Floats, Floats] | None:
    """Apex and base; None if neither landmarks nor a cup say them."""
    ends = ends_in(frame)
    if not {"apex", "base"} <= set(ends):
        if template is None or template.topology != CUP:
            return None
        ends = dict(zip(("apex", "base"), moving_base.ends_of_cup(template), strict=True))
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
    n, d = np.array(normals).reshape(-1, 3), np.array(offsets)
    alike = (n @ n.T > _PARALLEL) & (n @ axis > _ACROSS) & (n @ axis > _ACROSS)[:, None]
    stack = np.flatnonzero(alike[int(alike.sum(axis=1).argmax())]) if len(n) else np.arange(0)
    return _Planes(n, d, stack[np.argsort(d[stack])] if len(stack) > 2 else stack[:0])


def _contour(points: Floats, normal: Floats) -> _Contour:
    """Order points of a plane around their middle, from the widest gap on."""
    flat = (points - points.mean(axis=0)) @ closest.across(normal).T
    ring = points[np.argsort(np.arctan2(flat[:, 1], flat[:, 0]))]
    gaps = np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1)
    widest = int(gaps.argmax())
    arc, step = np.roll(ring, -widest - 1, axis=0), float(np.delete(gaps, widest).mean())
    if gaps[widest] <= max(_GAP * step, _OPEN * gaps.sum()):
        return _Contour(arc, np.zeros((0, 3)), np.zeros((0, 3)), step)
    ways = np.stack([arc[0] - arc[1:4].mean(axis=0), arc[-1] - arc[-4:-1].mean(axis=0)])
    ways /= np.maximum(np.linalg.norm(ways, axis=1), 1e-300)[:, None]
    return _Contour(arc, arc[[0, -1]], ways, step)


def _beyond(frame: Frame, contours: dict[int, _Contour], planes: _Planes) -> tuple[float, float]:
    """Find how many steps beyond the last points of arcs along the axis the rim of a frame is.

    A point may represent half a step on either side, be on the rim, or end early: where the base
    is stated, that shows it. The rim is taken as a plane. The second is the deviation of an arc.
    """
    arcs = [one for i, one in contours.items() if i not in planes.stack and len(one.ends)]
    marks = marks_at(frame, "base")
    if not arcs or not marks or not len(planes.stack):
        return _BEYOND[0], 0.5
    ends = np.concatenate([one.ends for one in arcs])
    kept = _are_above(ends, contours, planes)
    away = (ends - np.mean([point for point, _ in marks], axis=0))[kept]
    steps = np.concatenate([one.step * one.ways @ planes.normal for one in arcs])[kept]
    flat = away @ closest.across(planes.normal).T
    uneven = _UNEVEN * float((flat**2).sum(axis=1).mean()) ** 0.5 if kept.any() else 1.0
    by_itself = np.diag([1.0 / _BEYOND[1], 1.0 / _LEAN, 1.0 / _LEAN])
    rows = np.concatenate([np.column_stack([steps, -flat]) / uneven, by_itself])
    values = np.append(-away @ planes.normal / uneven, [_BEYOND[0] / _BEYOND[1], 0.0, 0.0])
    return float(np.linalg.lstsq(rows, values, rcond=None)[0][0]), 12**-0.5


def _are_above(ends: Floats, contours: dict[int, _Contour], planes: _Planes) -> Bools:
    """Return which ends are above all closed slices: a gap below one is not the opening."""
    closed = [i for i in planes.stack if i in contours and not len(contours[i].ends)]
    if not closed:
        return np.ones(len(ends), dtype=bool)
    above: Bools = ends @ planes.normals[closed[-1]] > planes.offsets[closed[-1]]
    return above


def _ends_of(
    contours: dict[int, _Contour], planes: _Planes, beyond: tuple[float, float]
) -> list[Observation]:
    """Find points of the rim in one frame, so many steps beyond the ends of arcs along the axis."""
    found = []
    for is_across in (True, False):
        own = [
            one for i, one in contours.items() if (i in planes.stack) == is_across and len(one.ends)
        ]
        steps, sd = (0.5, 0.25) if is_across else beyond
        far = [one.ends + steps * one.step * one.ways for one in own]
        ends = np.concatenate([np.zeros((0, 3)), *far])
        ends = ends[_are_above(ends, contours, planes)]
        if not len(ends):
            continue
        step = float(np.median([one.step for one in own]))
        normals = np.tile(planes.normal, (len(ends), 1)) if is_across else None
        found.append(Observation(ends, sd=sd * step, normals=normals, end="base"))
    return found


def _levels(
    frames: Sequence[Frame],
    drawn: dict[int, dict[int, _Contour]],
    ends: dict[int, list[Observation]],
    planes: _Planes,
    ends_of_axis: tuple[Floats, Floats],
) -> tuple[dict[int, Observation], Floats]:
    """Find how high the middle of the rim is in each frame.

    The rim is taken as a plane that leans alike in all frames. Ends of arcs are on it, and stated
    bases in its middle. Where no arc crosses it, it is between the last slice with a contour and
    the next; by how much not in the middle, all frames have in common.
    All are near H - c E, E being the percentage of the volume ejected: see `base_by_volume`.

    Returns
    -------
    dict of int to Observation
    (frames, frames) float64, length unit squared
        Covariance of levels that are between slices. Others have none.
    """
    normal, stack, heights = planes.normal, planes.stack, planes.offsets[planes.stack]
    spacing = float(np.median(np.diff(heights)))
    aside = closest.across(normal)
    tip, base = ends_of_axis
    unit = float(np.linalg.norm(base - tip)) / moving_base.LENGTH
    numbers = [k for k, own in drawn.items() if any(plane in own for plane in stack)]
    m = len(numbers)
    n, leans, beyond, descent, highest = m + 5, [m, m + 1], m + 2, m + 3, m + 4
    rows: list[Floats] = []
    values: list[float] = []

    def add(columns: list[int], factors: Sequence[float] | Floats, value: float, sd: float) -> None:
        row = np.zeros(n)
        row[columns] = factors
        rows.append(row / sd)
        values.append(value / sd)

    for lean in leans:
        add([lean], [1.0], 0.0, _LEAN)
    add([beyond], [1.0], 0.0, spacing / 4.0)
    add([descent], [1.0], unit * moving_base.DESCENT[0], unit * moving_base.DESCENT[1])
    middles, between = {}, []
    for i, k in enumerate(numbers):
        own = drawn[k]
        last = max(j for j, plane in enumerate(stack) if plane in own)
        closed = [own[plane] for plane in stack if plane in own and not len(own[plane].ends)]
        around = (closed or [own[stack[last]]])[-1].points
        middles[k] = middle = around.mean(axis=0)
        uneven = _UNEVEN * float(((around - middle) ** 2).sum(axis=1).mean()) ** 0.5
        marks = marks_at((*frames[k], *ends[k]), "base")
        for point, sd in marks:
            factors = [1.0, *(aside @ (point - middle))]
            add([i, *leans], factors, float(point @ normal), float(np.hypot(sd, uneven)))
        if not ends[k]:
            high = heights[last + 1] if last + 1 < len(heights) else heights[last] + spacing
            low, wide = heights[last], high - heights[last]
            add([i, beyond], [1.0, -1.0], (high + low) / 2.0, wide / 12**0.5)
        if not marks:
            between.append(i)
    n_free, ejected = len(rows), np.zeros(len(numbers))
    for _ in range(_TURNS):
        del rows[n_free:], values[n_free:]
        for i, percent in enumerate(ejected):
            add([i, descent, highest], [1.0, percent, -1.0], 0.0, unit * moving_base.OFF_PATH)
        matrix = np.stack(rows)
        covariance = np.linalg.pinv(matrix.T @ matrix)
        found = covariance @ (matrix.T @ np.array(values))
        low = float(tip @ normal)
        volumes = np.array(
            [_volume(drawn[k], planes, low, found[i]) for i, k in enumerate(numbers)]
        )
        ejected = 100.0 * (1.0 - volumes / volumes.max())
    of_levels = covariance[:m, :m]
    levels, stated = {}, np.zeros((len(frames), len(frames)))
    for i, k in enumerate(numbers):
        place = middles[k] + (found[i] - middles[k] @ normal) * normal
        # What levels of frames have in common counts once, and not once a frame.
        sd = max(of_levels[i].sum(), of_levels[i, i]) ** 0.5
        if i in between:
            sd = unit * moving_base.HELD
            stated[k, np.array(numbers)[between]] = of_levels[i, between]
        levels[k] = Observation(place[None], sd=sd, normals=normal[None], places=("base",))
    return levels, stated


def _volume(own: dict[int, _Contour], planes: _Planes, tip: float, level: float) -> float:
    """Volume within the contours of one frame up to a level: near its tip a paraboloid."""
    kept = [plane for plane in planes.stack if plane in own]
    heights = planes.offsets[kept]
    flat = [closest.across(planes.normal) @ own[plane].points.T for plane in kept]
    areas = np.array([abs(float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())) for x, y in flat])
    areas /= 2.0
    ends = areas[0] * (heights[0] - tip) / 2.0 + areas[-1] * (level - heights[-1])
    return float(np.trapezoid(areas, heights) + ends)
