"""Label maps: a segmentation as the easiest image, its apex and base proposed from itself.

In slices the base lies above the highest one that a reader drew, by less than one slice, unless one
was left out. What moves it from frame to frame is known roughly from the volume that is ejected. So
frames vote: a frame that lacks a slice, or has one too many, is outvoted, and the deviation of the
level is that of all paths that go with the slices.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import scipy

from modalmotion.errors import ParameterError, ShapeError
from modalmotion.images import ImageSequence, PlaneSet, Volume
from modalmotion.images.volume import Image, is_sliced
from modalmotion.notes import Note
from modalmotion.representation import Bools, Floats, Ints
from modalmotion.tracking import closest, label_values, moving_base
from modalmotion.tracking.landmarks import Proposed, places_of

# Brightness of the labelled cavity; outside is 0.
_INSIDE: Final = 100.0

# Deviation of a proposal, in voxels: of an opening, across and along the normal of its plane, as on
# simulated ventricles; and of an end.
_CUT_OFF: Final = 0.7
_CUT_HEIGHT: Final = 0.2
_END: Final = 2.0

# Of half a voxel: what is so near to the plane of a cut is its border. Tangent of the most that a
# cut is aslant to the axis; places on the border that are looked at.
_CUT: Final = 3.0
_MOST_ASLANT: Final = 0.8
_MOST_BORDER: Final = 6000

# Voxels below the highest one: a section there is whole.
_SECTION: Final = (6.0, 3.0)

# mm beside the cavity, that edges are looked for within.
_ROOM: Final = 15.0

# mm: a landmark so far outside is noted.
_OUTSIDE: Final = 2.0

# Fewer voxels have no axis.
_FEWEST: Final = 30


class Labelled(NamedTuple):
    """Images of labels, ready to be tracked.

    Parameters
    ----------
    images : ImageSequence
    landmarks : mapping of "apex" and "base" to Proposed
    left_out : tuple of int
        Frames without the highest slices, from which no shape can be taken.
    """

    images: ImageSequence
    landmarks: dict[str, Proposed]
    left_out: tuple[int, ...]


def from_labels(images: ImageSequence, labels: Sequence[int] = ()) -> Labelled:
    """Make a label map ready for `track`: cavity bright, the rest dark, ends proposed.

    Parameters
    ----------
    images : ImageSequence
        Volumes of whole numbers.
    labels : sequence of int
        Of the cavity; without one it is that of `cavity_in`.

    Raises
    ------
    ParameterError
        If a label is nowhere in a frame, or geometry does not tell which is the cavity; it names
        those that are there, and their volumes.
    ShapeError
        If a frame is no volume.

    Notes
    -----
    In thick slices the ends are those of `ends_in_slices`. In other volumes the base is the plane
    that the wider end is cut by.
    """
    decided: tuple[Note, ...] = ()
    if not labels:
        value, note = label_values.cavity_in(images)
        labels, decided = (value,), (note,)
    frames = _with_room([_shown(k, frame, labels) for k, frame in enumerate(images.frames)])
    sliced = any(is_sliced(frame) for frame in frames if frame is not None)
    marks, notes, left_out = ends_in_slices(frames) if sliced else (_of_volumes(frames), (), ())
    note = Note.of("ends_proposed")
    own = (*images.notes, *decided, note, *notes)
    return Labelled(ImageSequence(frames, images.times, images.period, own), marks, left_out)


def notes_on_landmarks(
    images: ImageSequence, landmarks: Mapping[str, Any], reference: int
) -> tuple[Note, ...]:
    """Note stated landmarks that are more than 2 mm outside all that is labelled.

    Parameters
    ----------
    images : ImageSequence
        The label map.
    landmarks : mapping of str to (3,) or (frames, 3) array_like, mm
        A place in the reference frame, or one for each frame, None or NaN if it is unknown.
    reference : int
    """
    notes = []
    for name, value in landmarks.items():
        if isinstance(value, Proposed):
            continue
        stated = places_of(name, value)
        places = {reference: stated} if stated.ndim == 1 else dict(enumerate(stated))
        away = {
            k: _away(images.frames[k], place)
            for k, place in places.items()
            if k < images.n_frames and np.isfinite(place).all()
        }
        far = max(away, key=lambda k: away[k], default=None)
        if far is not None and away[far] > _OUTSIDE:
            notes.append(Note.of("landmark_outside", landmark=name, distance=away[far], frame=far))
    return tuple(notes)


def _away(frame: Volume | PlaneSet | None, place: Floats) -> float:
    """How far a place is outside the labelled voxels, mm."""
    if not isinstance(frame, Volume):
        return 0.0
    points = np.argwhere(frame.values != 0) @ frame.affine[:, :3].T + frame.affine[:, 3]
    nearest = float(np.linalg.norm(points - place, axis=1).min(initial=np.inf))
    return max(0.0, nearest - float(max(frame.spacing)) / 2.0)


def _shown(k: int, frame: Image | None, labels: Sequence[int]) -> Volume | None:
    """Cavity of frame k bright, the rest dark."""
    if isinstance(frame, PlaneSet):
        raise ShapeError(
            f"Frame {k} is a set of planes; the ends of a cavity are only found in volumes.",
            remedy="Give apex and base, and track the planes as images.",
            frame=k,
        )
    if frame is None:
        return None
    cavity = np.isin(frame.values, list(labels))
    if cavity.sum() < _FEWEST:
        others = label_values.values_in(frame)
        raise ParameterError(
            f"Label {', '.join(map(str, labels))} has {int(cavity.sum())} voxels in frame {k}.",
            remedy=f"Name one of these with --label: {others}."
            if others
            else "Label the cavity in this frame too, or leave the frame out of the file.",
            frame=k,
        )
    return Volume(np.where(cavity, np.float32(_INSIDE), np.float32(0.0)), frame.affine)


def _with_room(frames: Sequence[Volume | None]) -> tuple[Volume | None, ...]:
    """Add unlabelled voxels where maps are cropped so close that edges have no outside."""
    before, after = np.zeros((2, 3), dtype=int)
    for frame in frames:
        if frame is not None:
            there = np.argwhere(frame.values)
            wanted = np.ceil(_ROOM / np.array(frame.spacing)).astype(int)
            before = np.maximum(before, wanted - there.min(axis=0))
            last = np.array(frame.values.shape) - 1
            after = np.maximum(after, wanted - (last - there.max(axis=0)))
    widths = np.stack([before, after], axis=1)
    return tuple(None if frame is None else _widened(frame, widths) for frame in frames)


def _widened(frame: Volume, widths: Ints) -> Volume:
    affine = frame.affine.copy()
    affine[:, 3] -= affine[:, :3] @ widths[:, 0]
    return Volume(np.pad(frame.values, widths), affine)


def _of_volumes(frames: Sequence[Volume | None]) -> dict[str, Proposed]:
    apices, bases, cuts = np.full((3, len(frames), 3), np.nan)
    spacing, axis = 0.0, None
    for k, frame in enumerate(frames):
        if frame is not None:
            apices[k], bases[k], axis, cuts[k] = _ends(frame, axis)
            spacing = max(spacing, float(max(frame.spacing)))
    base = Proposed(bases, _CUT_OFF * spacing, cuts, _CUT_HEIGHT * spacing)
    return {"apex": Proposed(apices, _END * spacing), "base": base}


def _ends(volume: Volume, before: Floats | None) -> tuple[Floats, Floats, Floats, Floats]:
    """Apex, base, the unit vector between them and that across the base, of one frame."""
    A, cavity = volume.affine, _largest_part(volume.values > 0)
    points = np.argwhere(cavity) @ A[:, :3].T + A[:, 3]
    middle = points.mean(axis=0)
    half = float(np.linalg.norm(A[:, :3], axis=0).mean()) / 2.0
    axis: Floats = np.linalg.eigh(np.cov((points - middle).T))[1][:, -1]
    z = (points - middle) @ axis
    if before is None:
        # A base is cut where the cavity is still wide.
        low, high = np.quantile(z, (0.0, 1.0))
        step = 0.12 * (high - low)
        turn = (z > high - step).sum() >= (z < low + step).sum()
    else:
        turn = axis @ before > 0
    axis = axis if turn else -axis
    flat = _flat_end(cavity, A, axis, half)
    base = _middle_of_cut(points, flat, axis, half)
    # Tip: at the height of the lowest voxels, in the middle of those near it.
    z = (points - base) @ axis
    tip = points[z < z.min() + 4.0 * half].mean(axis=0)
    return tip + (z.min() - half - float((tip - base) @ axis)) * axis, base, axis, flat


def _largest_part(cavity: Bools) -> Bools:
    """Leave out voxels that are apart from the rest: some beyond the base would be the base."""
    parts, _ = scipy.ndimage.label(cavity)
    largest: Bools = parts == np.bincount(parts[cavity]).argmax()
    return largest


def _flat_end(cavity: Bools, A: Floats, axis: Floats, half: float) -> Floats:
    """Direction across the plane in which a cavity ends, which may be aslant to its long axis.

    Of planes that touch the cavity from above it is the one that most of its border is near to.
    """
    inner = scipy.ndimage.binary_erosion(cavity, border_value=0)
    border = np.argwhere(cavity & ~inner) @ A[:, :3].T
    border = border[:: max(1, len(border) // _MOST_BORDER)]
    best, reach = axis, _MOST_ASLANT
    for _ in range(3):
        steps = np.linspace(-reach, reach, 9)
        tried = best + np.array([[a, b] for a in steps for b in steps]) @ closest.across(best)
        tried /= np.linalg.norm(tried, axis=1, keepdims=True)
        heights = border @ tried.T
        near = (heights > heights.max(axis=0) - _CUT * half).sum(axis=0)
        # Of directions alike their mean.
        best = tried[near >= 0.98 * near.max()].mean(axis=0)
        best /= np.linalg.norm(best)
        reach /= 4.0
    return best


def _middle_of_cut(points: Floats, flat: Floats, axis: Floats, half: float) -> Floats:
    """Place the middle of an opening that is nearly flat: over a whole section, at its height.

    Its mean height is that of the section and what is above, over the section's size.
    """
    z = points @ flat
    low, high = (float(z.max()) - 2.0 * voxels * half for voxels in _SECTION)
    section = points[(z > low) & (z <= high)]
    above = (z > high).sum() / max(len(section), 1) * (high - low)
    middle = section.mean(axis=0)
    place: Floats = middle + (high + above - float(middle @ flat)) / float(flat @ axis) * axis
    return place


# Fewer slices have no axis and no taper.
_FEWEST_SLICES: Final = 3

# Iterations: levels and volumes follow from each other.
_TURNS: Final = 3

# Likelihood that the base is 0 to 1 slices above the highest one drawn, 1 to 2, 2 to 3, and that
# it is up to half of one below; and anywhere up to the highest slice of all frames, or down to the
# lowest, where a reader left out several slices of one frame, or drew too many.
_ABOVE: Final = ((-0.5, 0.1), (0.0, 1.0), (1.0, 0.3), (2.0, 0.03), (3.0, 0.0))
_ANYWHERE: Final = 0.03

# Deviation of the base of a frame from its path: mm, and of the length of the path. Percentage
# points that the volume of sections taken from another frame may be off by, of their share.
_OFF_PATH: Final = (0.5, 0.1)
_OF_ADDED: Final = 15.0

# Steps of the grid of levels: mm, share of the heights of the highest slices, and of a slice. The
# last two count where a map is much larger than a heart.
_GRID: Final = (0.5, 1 / 400, 1 / 40)

# Way to the tip over that of a paraboloid.
_BLUNT: Final = 0.75

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
    """Sections of one frame from apex to base: heights, areas and middles."""

    heights: Floats
    areas: Floats
    middles: Floats

    @property
    def line(self) -> Floats:
        """Line through the middles, (2, 3): its place at the height 0, and the way per mm."""
        w = np.sqrt(self.areas)[:, None]
        columns = np.column_stack([np.ones(len(self.heights)), self.heights])
        line: Floats = np.linalg.lstsq(w * columns, w * self.middles, rcond=None)[0]
        return line

    def below(self, other: "_Stack", step: float) -> "_Stack":
        """Add what another frame has above the highest section, as wide as this one is beside it.

        That readers left out the highest slices of one frame does not show that it ends there.
        """
        above = other.heights > self.heights[-1] + step / 2.0
        ratio = self.areas[-1] / np.interp(self.heights[-1], other.heights, other.areas)
        return _Stack(
            np.append(self.heights, other.heights[above]),
            np.append(self.areas, ratio * other.areas[above]),
            np.append(self.middles, other.middles[above], axis=0),
        )


def ends_in_slices(
    frames: Sequence[Volume | None],
) -> tuple[dict[str, Proposed], tuple[Note, ...], tuple[int, ...]]:
    """Find apex and base of a cavity in volumes of thick slices.

    Parameters
    ----------
    frames : sequence of Volume or None
        Above 0 in the cavity.

    Returns
    -------
    dict of str to Proposed
        Apex and base, mm.
    tuple of Note
        Notes for the user.
    tuple of int
        Frames that lack several of the highest slices.

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
            k: _Stack(-s.heights[::-1], s.areas[::-1], s.middles[::-1]) for k, s in stacks.items()
        }
    own = list(stacks.values())
    volumes = np.array([s.areas.sum() for s in own])
    full = int(volumes.argmax())
    tips, of_tips = _tips(own, step)
    tops = np.array([s.heights[-1] for s in own])
    gaps = _gaps(tops, np.concatenate([s.heights for s in own]), step)
    own = [s.below(own[full], step) for s in own]
    added = 1.0 - volumes / np.array([s.areas.sum() for s in own])
    levels, of_levels = tops + step / 2.0, np.zeros((0, 0))
    for _ in range(_TURNS):
        volumes = np.array([_volume(*each) for each in zip(own, tips, levels, strict=True)])
        ejected = 100.0 * (1.0 - volumes / volumes.max())
        levels, of_levels = _levels(tops, gaps, step, ejected, added)
    n = len(frames)
    apices, bases, axes = (np.full((n, 3), np.nan) for _ in range(3))
    at = np.ix_(list(there), list(there))
    covariances = np.full((2, n, n), np.nan)
    covariances[0][at], covariances[1][at] = of_tips, of_levels
    for i, k in enumerate(there):
        start, way = own[i].line
        apices[k], bases[k] = start + tips[i] * way, start + levels[i] * way
        axes[k] = way / np.linalg.norm(way)
    notes = []
    if own[full].areas[0] > _OPEN * own[full].areas.max():
        notes.append(Note.of("both_ends_open", share=own[full].areas[0] / own[full].areas.max()))
    lack = levels - tops > (_ABOVE[-1][0] + gaps - 1.0) * step
    left_out = tuple(np.array(list(there))[lack].tolist())
    if left_out:
        notes.append(Note.of("slices_left_out", n_frames=len(left_out), first=left_out[0]))
    sd = max(float(max(frame.spacing)) for frame in there.values())
    places = zip(("apex", "base"), (apices, bases), covariances, strict=True)
    marks = {name: Proposed(own, sd, axes, _LEVEL, off) for name, own, off in places}
    return marks, tuple(notes), left_out


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
        [np.insert(np.argwhere(cavity.take(k, across)).mean(axis=0), across, k) for k in kept]
    )
    middles = middles @ A[:, :3].T + A[:, 3]
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
    if len(heights) < _FEWEST_SLICES:
        raise ShapeError(
            f"The cavity is labelled in {len(heights)} slices of frame {number}; finding its ends "
            f"needs at least {_FEWEST_SLICES}.",
            remedy="Label more slices, or give apex and base with --landmarks.",
            frame=number,
        )
    return _Stack(heights, areas, middles)


def _volume(s: _Stack, tip: float, level: float) -> float:
    """Volume between two levels, mm^3: near its tip a cavity is a paraboloid."""
    heights = np.minimum(s.heights, level)
    ends = s.areas[0] * (heights[0] - tip) / 2.0 + s.areas[-1] * (level - heights[-1])
    return float(np.trapezoid(s.areas, heights) + ends)


def _way_to_tip(s: _Stack, step: float) -> float:
    """How far the tip lies below the lowest slice, mm.

    Sections of a paraboloid are a line over height, and zero at its tip; hearts are blunter. Of the
    lines through two of the three lowest ones it is that with the highest zero: a section that is
    drawn too wide, wider than the next one even, has it too low.
    """
    i, j = np.triu_indices(3, 1)
    growth = (s.areas[j] - s.areas[i]) / (s.heights[j] - s.heights[i])
    grows = growth > 0
    ways = s.heights[0] - s.heights[i][grows] + s.areas[i][grows] / growth[grows]
    way = _BLUNT * ways.min(initial=np.inf)
    return float(np.clip(way, _BELOW[0] * step, _BELOW[1] * step))


def _tips(stacks: Sequence[_Stack], step: float) -> tuple[Floats, Floats]:
    """Height of the tip in each frame, mm, and the covariance, mm^2."""
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


def _levels(
    tops: Floats, gaps: Floats, step: float, ejected: Floats, added: Floats
) -> tuple[Floats, Floats]:
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
    added : (frames,) float64
        Share of each frame's sections that is another's.

    Notes
    -----
    The path is H - c ejected, H anywhere and c about 0.185; a frame's base is off it by e, normal.
    All on a grid: the weight of (H, c) is the product over frames of the sum over e of how likely
    the frame's highest slice is below such a base.
    """
    mean, sd = moving_base.DESCENT
    c = mean + sd * np.linspace(-2.5, 2.5, 21)
    apart = float(np.ptp(tops)) / step
    grid = max(_GRID[0], _GRID[1] * apart * step, _GRID[2] * step)
    H = np.arange(tops.min() - step, tops.max() + mean * ejected.max() + 4.0 * step, grid)
    slices = np.arange(-0.5 - apart, max(gaps.max() + 2.0, apart + 1.0), grid / step)
    h = slices * step
    edges, weights = np.array(_ABOVE).T
    off = np.hypot(_OFF_PATH[0], mean * np.hypot(_OFF_PATH[1] * ejected.max(), _OF_ADDED * added))
    log_weight = np.broadcast_to(-((c - mean) ** 2) / (2.0 * sd**2), (len(H), len(c))).copy()
    first, second = [], []
    for top, gap, own, sd_off in zip(tops, gaps, ejected, off, strict=True):
        above = np.where(slices < 0.0, slices, np.maximum(slices - (gap - 1.0), 0.0))
        of_slice = weights[np.searchsorted(edges, above + 1e-9, side="right") - 1]
        between = (top + h > tops.min()) & (top + h < tops.max() + step)
        of_slice = np.maximum(of_slice, between * _ANYWHERE)
        path = H[:, None] - c * own
        likely = of_slice * np.exp(-(((top + h) - path[..., None]) ** 2) / (2.0 * sd_off**2))
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
    covariance += np.diag((weight * np.maximum(spread, grid**2 / 12.0)).sum(axis=(1, 2)))
    return tops + means, covariance
