"""Apex and base of a cavity that slices show: the levels of its ends, by all frames together.

The base lies above the highest slice that a reader drew, by less than one slice, unless one was
left out. What moves it from frame to frame is known roughly from the volume that is ejected. So
frames vote: a frame that lacks a slice, or has one too many, is outvoted, and the deviation of the
level is that of all paths that go with the slices.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

import numpy as np

from modalmotion.errors import ShapeError
from modalmotion.images import Volume
from modalmotion.notes import Note
from modalmotion.representation import Bools, Floats
from modalmotion.tracking.landmarks import Proposed
from modalmotion.tracking.moving_base import DESCENT

# Fewer slices have no axis and no taper.
_FEWEST: Final = 3

# Iterations: levels and volumes follow from each other.
_TURNS: Final = 3

# Likelihood that the base is 0 to 1 slices above the highest one drawn, 1 to 2, 2 to 3, and that
# it is up to half of one below.
_ABOVE: Final = ((-0.5, 0.1), (0.0, 1.0), (1.0, 0.3), (2.0, 0.03), (3.0, 0.0))

# Deviation of the base of a frame from its path: mm, and of the length of the path.
_OFF_PATH: Final = (0.5, 0.1)

# Steps of the grid of levels, mm.
_GRID: Final = 0.5

# Slices from the lowest on that are extrapolated to the tip.
_OF_TIP: Final = 5

# Of a slice: least and most that the tip lies below the lowest one drawn, and its deviation, with
# the share of that way. mm that the tip moves in a beat.
_BELOW: Final = (0.3, 2.5)
_TIP: Final = (0.25, 0.3)
_TIP_MOVES: Final = 6.0

# mm: of a level that all frames have said together, how far each may leave it. Softer ones are
# drawn to the shape of the reference, which has another length.
_LEVEL: Final = 0.5

# Of the widest section: an end this wide is open.
_OPEN: Final = 0.5


class _Stack(NamedTuple):
    """Sections of one frame from apex to base: heights, areas and the line of their middles."""

    heights: Floats
    areas: Floats
    line: Floats

    def place(self, height: float) -> Floats:
        """Point of the line through the middles, (3,), mm."""
        place: Floats = self.line[0] + height * self.line[1]
        return place


def ends_in_slices(
    frames: Sequence[Volume | None],
) -> tuple[dict[str, Proposed], tuple[Note, ...]]:
    """Find apex and base of a cavity in volumes of thick slices.

    Parameters
    ----------
    frames : sequence of Volume or None
        Above 0 in the cavity.

    Returns
    -------
    dict of str to Proposed
        Apex and base, mm.
    tuple of str
        Notes for the user.

    Raises
    ------
    ShapeError
        If the cavity is in fewer than three slices of a frame.
    """
    there = {k: frame for k, frame in enumerate(frames) if frame is not None}
    first = next(iter(there.values()))
    across = int(np.argmax(first.spacing))
    i, j = (axis for axis in range(3) if axis != across)
    normal = np.cross(first.affine[:, i], first.affine[:, j]).astype(np.float64)
    normal /= np.linalg.norm(normal)
    step = abs(float(first.affine[:, across] @ normal))
    sections = {k: _sections(frame, normal) for k, frame in there.items()}
    low, high = _labelled_run(sections.values(), step)
    stacks = {k: _stack(*each, low, high, k) for k, each in sections.items()}
    # A base is cut where the cavity is still wide: the wider end of all frames together.
    taper = sum(np.log(s.areas[-2:].mean() / s.areas[:2].mean()) for s in stacks.values())
    if taper < 0:
        stacks = {
            k: _Stack(-s.heights[::-1], s.areas[::-1], s.line * [[1.0], [-1.0]])
            for k, s in stacks.items()
        }
    own = list(stacks.values())
    volumes = np.array([s.areas.sum() for s in own])
    full = int(volumes.argmax())
    tips, of_tips = _tips(own, step)
    tops = np.array([s.heights[-1] for s in own])
    gaps = _gaps(tops, np.concatenate([s.heights for s in own]), step)
    levels, of_levels = tops + step / 2.0, np.zeros((0, 0))
    for _ in range(_TURNS):
        volumes = np.array([_volume(*each) for each in zip(own, tips, levels, strict=True)])
        levels, of_levels = _levels(tops, gaps, step, 100.0 * (1.0 - volumes / volumes.max()))
    n = len(frames)
    apices, bases, axes = (np.full((n, 3), np.nan) for _ in range(3))
    at = np.ix_(list(there), list(there))
    covariances = np.full((2, n, n), np.nan)
    covariances[0][at], covariances[1][at] = of_tips, of_levels
    for i, k in enumerate(there):
        s = own[i]
        apices[k], bases[k] = s.place(tips[i]), s.place(levels[i])
        axes[k] = s.line[1] / np.linalg.norm(s.line[1])
    notes = []
    if own[full].areas[0] > _OPEN * own[full].areas.max():
        notes.append(Note.of("both_ends_open", share=own[full].areas[0] / own[full].areas.max()))
    sd = max(float(max(frame.spacing)) for frame in there.values())
    places = zip(("apex", "base"), (apices, bases), covariances, strict=True)
    return {name: Proposed(own, sd, axes, _LEVEL, off) for name, own, off in places}, tuple(notes)


def _sections(frame: Volume, normal: Floats) -> tuple[Floats, Floats, Floats]:
    """Heights, areas and middles of the labelled sections of one frame, from the lowest on."""
    cavity = frame.values > 0
    across = int(np.argmax(frame.spacing))
    others = [i for i in range(3) if i != across]
    A = frame.affine
    pixel = float(np.linalg.norm(np.cross(A[:, others[0]], A[:, others[1]])))
    counts = cavity.sum(axis=tuple(others))
    kept = np.flatnonzero(counts)
    middles = np.array(
        [A[:, :3] @ np.insert(_middle(cavity.take(k, across)), across, k) + A[:, 3] for k in kept]
    )
    heights = middles @ normal
    order = np.argsort(heights)
    return heights[order], counts[kept][order] * pixel, middles[order]


def _labelled_run(
    sections: Iterable[tuple[Floats, Floats, Floats]], step: float
) -> tuple[float, float]:
    """Lowest and highest slice of the cavity, mm.

    What lies apart from the others by more than a slice that no frame has is something else.
    """
    heights, areas = (np.concatenate(each) for each in list(zip(*sections, strict=True))[:2])
    order = np.argsort(heights)
    heights, areas = heights[order], areas[order]
    cuts = np.flatnonzero(np.diff(heights) > 2.5 * step) + 1
    runs = np.split(np.arange(len(heights)), cuts)
    own = heights[max(runs, key=lambda run: float(areas[run].sum()))]
    return float(own[0]), float(own[-1])


def _stack(
    heights: Floats, areas: Floats, middles: Floats, low: float, high: float, number: int
) -> _Stack:
    own = (heights >= low) & (heights <= high)
    heights, areas, middles = heights[own], areas[own], middles[own]
    if len(heights) < _FEWEST:
        raise ShapeError(
            f"The cavity is labelled in {len(heights)} slices of frame {number}; its ends are seen "
            f"in {_FEWEST} and more.",
            remedy="Label more slices, or state apex and base by --landmarks.",
            frame=number,
        )
    columns = np.column_stack([np.ones(len(heights)), heights])
    w = np.sqrt(areas)[:, None]
    line = np.linalg.lstsq(w * columns, w * middles, rcond=None)[0]
    return _Stack(heights, areas, line)


def _middle(section: Bools) -> Floats:
    middle: Floats = np.argwhere(section).mean(axis=0)
    return middle


def _volume(s: _Stack, tip: float, level: float) -> float:
    """Volume between two levels, mm^3: near its tip a cavity is a paraboloid."""
    ends = s.areas[0] * (s.heights[0] - tip) / 2.0 + s.areas[-1] * (level - s.heights[-1])
    return float(np.trapezoid(s.areas, s.heights) + ends)


def _way_to_tip(s: _Stack, step: float) -> float:
    """How far the tip lies below the lowest slice, mm.

    Sections of an ellipsoid are a quadratic function of height, and zero at its tip.
    """
    n = min(len(s.heights), _OF_TIP)
    z = s.heights[:n] - s.heights[0]
    c, b, a = np.polyfit(z, s.areas[:n], 2) if n > 2 else np.zeros(3)
    if c >= 0.0 or b <= 0.0:
        b, a = np.polyfit(z[:2], s.areas[:2], 1)
        way = a / b if b > 0 else np.inf
    else:
        way = (b - np.sqrt(b**2 - 4.0 * a * c)) / (2.0 * c)
    return float(np.clip(way, _BELOW[0] * step, _BELOW[1] * step))


def _tips(stacks: Sequence[_Stack], step: float) -> tuple[Floats, Floats]:
    """Height of the tip in each frame, mm, and the covariance, mm^2.

    Near a tip sections grow evenly, as those of a paraboloid: it lies where their line is zero.
    """
    ways = np.array([_way_to_tip(s, step) for s in stacks])
    tips = np.array([s.heights[0] for s in stacks]) - ways
    variances = (_TIP[0] * step) ** 2 + (_TIP[1] * ways) ** 2
    common = np.average(tips, weights=1.0 / variances)
    share = _TIP_MOVES**2 / (_TIP_MOVES**2 + variances)
    return tips + (1.0 - share) * (common - tips), np.diag(share * variances)


def _gaps(tops: Floats, drawn: Floats, step: float) -> Floats:
    """Slices from the highest of each frame to the next one that any frame has, 1 if none has.

    A slice that no frame has, below one that some have, was left out: that a frame ends below it
    does not show that the base does.
    """
    above = np.where(drawn > tops[:, None] + step / 2.0, drawn, np.inf).min(axis=1)
    gaps: Floats = np.where(np.isfinite(above), np.rint((above - tops) / step), 1.0)
    return gaps


def _levels(tops: Floats, gaps: Floats, step: float, ejected: Floats) -> tuple[Floats, Floats]:
    """Height of the base in each frame, mm, and the covariance, mm^2.

    Parameters
    ----------
    tops : (frames,) float64, mm
        Heights of the highest slices.
    gaps : (frames,) float64
        Slices from there to the next one that any frame has.
    step : float, mm
        From slice to slice.
    ejected : (frames,) float64, percent
        Of the largest volume, what each frame lacks.

    Notes
    -----
    The path is H - c ejected, H anywhere and c about 0.185; a frame's base is off it by e, normal.
    All on a grid: the weight of (H, c) is the product over frames of the sum over e of how likely
    the frame's highest slice is below such a base.
    """
    mean, sd = DESCENT
    c = mean + sd * np.linspace(-2.5, 2.5, 21)
    H = np.arange(tops.min() - step, tops.max() + mean * ejected.max() + 4.0 * step, _GRID)
    slices = np.arange(-0.5, 2.0 + gaps.max(), _GRID / step)
    h = slices * step
    edges, weights = np.array(_ABOVE).T
    off = float(np.hypot(_OFF_PATH[0], _OFF_PATH[1] * mean * ejected.max()))
    log_weight = np.broadcast_to(-((c - mean) ** 2) / (2.0 * sd**2), (len(H), len(c))).copy()
    first, second = [], []
    for top, gap, own in zip(tops, gaps, ejected, strict=True):
        above = np.where(slices < 0.0, slices, np.maximum(slices - (gap - 1.0), 0.0))
        of_slice = weights[np.searchsorted(edges, above + 1e-9, side="right") - 1]
        path = H[:, None] - c * own
        likely = of_slice * np.exp(-(((top + h) - path[..., None]) ** 2) / (2.0 * off**2))
        total = np.maximum(likely.sum(axis=2), 1e-300)
        log_weight += np.log(total)
        first.append((likely @ h) / total)
        second.append((likely @ h**2) / total)
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    heights, spread = np.stack(first), np.stack(second) - np.stack(first) ** 2
    means = (weight * heights).sum(axis=(1, 2))
    # Frames are apart, given a path: of that they have the errors in common.
    away = (heights - means[:, None, None]).reshape(len(tops), -1)
    covariance = (weight.ravel() * away) @ away.T
    covariance += np.diag((weight * np.maximum(spread, _GRID**2 / 12.0)).sum(axis=(1, 2)))
    return tops + means, covariance
