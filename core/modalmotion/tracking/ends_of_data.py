"""Whether the data of frames end where the surface does, and so say where its rim is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from modalmotion.mesh import face_areas
from modalmotion.mesh.connectivity import grouped_edges
from modalmotion.tracking.closest import closest_points
from modalmotion.tracking.cloud_end import DataEnd
from modalmotion.tracking.deformable import Deformable
from modalmotion.tracking.ending import Ending, Lying, lies_evenly
from modalmotion.tracking.noise import Noise
from modalmotion.tracking.observation import NAMED_PLACES, Frame
from modalmotion.tracking.places import place_on
from modalmotion.tracking.rim import Rim, rim_at, rim_of

# Points in a square as wide as a sector: enough to tell a hole from chance.
_OF_SECTOR: Final = 16.0

# Squared distances from places of the surface to points, over those between points: 1 where they
# fall at random, less where they are spread, some 20 along contours.
_MOST_UNEVEN: Final = 3.0

# Frames in which the end of the data and landmarks are compared, at most: a mean is taken.
_MOST_FRAMES: Final = 10

# Part of an opening, by its width, over which points are looked for: nearer than so many deviations
# and so much of the root of its area.
_OF_LID: Final = 0.5
_LYING: Final = 3.0
_BULGE: Final = 0.1

# Of the rim, that the data show in the reference; and of what can be found, that they are off by.
_MOST_OF_RIM: Final = 0.5
_FAR: Final = 0.5


def with_endings(
    surface: Deformable,
    frames: Sequence[Frame],
    noise: Noise,
    pinned: int | None,
    reference: int = 0,
) -> tuple[Frame, ...]:
    """Add to each frame what its data may say of where the surface ends, before it is followed.

    Parameters
    ----------
    surface : Deformable
    frames : sequence of Frame
    noise : Noise
    pinned : int or None
        Frame whose surface is known.
    reference : int
        Frame that the start is about the surface of.

    Notes
    -----
    Frames that state points of an end say it better. Weighted points, profiles and contours do not
    lie evenly. A cloud that lies over the opening, too, is that of a closed surface.
    """
    x = surface.template.vertices
    kinds: dict[str, list[str | None]] = {end: [] for end in NAMED_PLACES}
    for frame in frames:
        is_even = _are_even(surface, x, frame)
        for end, own in kinds.items():
            own.append(_kind(frame, end, is_even=is_even))
    for end, own in kinds.items():
        if own[reference] == "cloud" and _has_lid(surface, x, frames[reference], end, noise):
            kinds[end] = [None if name == "cloud" else name for name in own]
    noises, still = [noise] * len(frames), [x] * len(frames)
    bare = [tuple(part for part in frame if part.places is None) for frame in frames]
    ended = _with(surface, bare, kinds, still, noises, pinned, is_first=True)
    pairs = zip(frames, ended, strict=True)
    return tuple((*f, *(part for part in own if isinstance(part, Ending))) for f, own in pairs)


def with_doubts(
    surface: Deformable,
    frames: Sequence[Frame],
    amplitudes: NDArray[np.float64],
    noises: Sequence[Noise],
    pinned: int | None,
) -> tuple[Frame, ...]:
    """Say how doubtful it is that data end where the surface does, once it was followed.

    Parameters
    ----------
    surface : Deformable
    frames : sequence of Frame
        As `with_endings` returns them.
    amplitudes : (frames, modes, 3) float64, length unit
        Roughly.
    noises : sequence of Noise
        Of each frame.
    pinned : int or None
        Frame whose surface is known.

    Notes
    -----
    Where a rim is known, in the frame of the start or by landmarks, the mean square by which the
    data end elsewhere, less what chance makes, is taken for all frames; that of the whole rim is
    common to its sectors. Where neither says it, what the data end at is not taken for the rim.
    """
    kinds: dict[str, list[str | None]] = {end: [] for end in NAMED_PLACES}
    for frame in frames:
        before = {part.end: part for part in frame if isinstance(part, Ending)}
        for end, own in kinds.items():
            part = before.get(end)
            own.append(None if part is None else "mesh" if len(part) else "cloud")
    bare = [tuple(part for part in frame if not isinstance(part, Ending)) for frame in frames]
    shapes = [surface.positions(a) for a in amplitudes]
    if pinned is not None:
        shapes[pinned] = surface.template.vertices
    return _with(surface, bare, kinds, shapes, noises, pinned, is_first=False)


def _with(
    surface: Deformable,
    frames: Sequence[Frame],
    kinds: Mapping[str, Sequence[str | None]],
    shapes: Sequence[NDArray[np.float64]],
    noises: Sequence[Noise],
    pinned: int | None,
    *,
    is_first: bool,
) -> tuple[Frame, ...]:
    full = list(frames)
    for end, names in kinds.items():
        counts = [
            sum(map(len, frame))
            for frame, name in zip(frames, names, strict=True)
            if name == "cloud"
        ]
        width = (surface.area / np.mean([own.n_values for own in noises])) ** 0.5
        if counts:
            width = max(width, (_OF_SECTOR * surface.area / float(np.median(counts))) ** 0.5)
        rim = rim_of(surface, end, float(width)) if any(names) else None
        if rim is None:
            continue
        for kind in ("cloud", "mesh"):
            pairs = enumerate(zip(frames, names, strict=True))
            own = {k: _ending(rim, frame) for k, (frame, name) in pairs if name == kind}
            doubt = _doubt(surface, rim, frames, own, shapes, noises, pinned, is_first=is_first)
            if doubt is None:
                continue
            for k, ending in own.items():
                full[k] = (*full[k], replace(ending, doubt=doubt))
    return tuple(full)


def _kind(frame: Frame, end: str, *, is_even: bool) -> str | None:
    """Tell what may show an end in a frame: the border of a mesh, an even cloud, or nothing."""
    if any(part.end == end for part in frame):
        return None
    if any(part.border is not None for part in frame):
        return "mesh"
    return "cloud" if is_even else None


def _are_even(surface: Deformable, x: NDArray[np.float64], frame: Frame) -> bool:
    """Tell points all over a surface from those along lines on it."""
    if any(len(part) and not part.is_landmark and not lies_evenly(part) for part in frame):
        return False
    even = [part.points for part in frame if lies_evenly(part)]
    if sum(map(len, even)) < _OF_SECTOR or surface.cells.shape[1] != 3:
        return False
    feet = closest_points(np.concatenate(even), x, surface.cells).feet
    tree = scipy.spatial.cKDTree(feet)
    between = float(np.median(tree.query(feet, k=2)[0][:, 1]))
    away = tree.query(x[surface.cells].mean(axis=1))[0]
    order, areas = np.argsort(away, kind="stable"), face_areas(x, surface.cells)
    middle = order[np.searchsorted(np.cumsum(areas[order]), areas.sum() / 2.0)]
    return float(away[middle]) ** 2 <= _MOST_UNEVEN * between**2


def _has_lid(
    surface: Deformable, x: NDArray[np.float64], frame: Frame, end: str, noise: Noise
) -> bool:
    """Tell whether points lie over an opening as densely as on the surface."""
    points = np.concatenate([part.points for part in frame if lies_evenly(part)])
    for sides in grouped_edges(rim_at(surface, end), len(x)):
        middle = x[sides].mean(axis=(0, 1))
        # Away from the rim, next to which the wall is.
        ends = middle + _OF_LID * (x[sides] - middle)
        corners = np.concatenate([ends, np.broadcast_to(middle, (len(ends), 1, 3))], axis=1)
        cells = np.arange(3 * len(ends)).reshape(-1, 3)
        lid = corners.reshape(-1, 3)
        area = float(face_areas(lid, cells).sum())
        near = closest_points(points, lid, cells).distances
        # Half-way to the wall at most, whose points are not over a small opening.
        apart = float(np.linalg.norm(x[sides] - middle, axis=2).min()) * (1.0 - _OF_LID) / 2.0
        n = int((near < min(_LYING * noise.sd + _BULGE * area**0.5, apart)).sum())
        if area > 0 and n * surface.area > _MOST_OF_RIM * len(points) * area:
            return True
    return False


def _ending(rim: Rim, frame: Frame) -> Ending:
    """Middles of a mesh's border and the lengths they stand for; no points of a cloud."""
    borders = [part.border for part in frame if part.border is not None]
    if not borders:
        return Ending(np.zeros((0, 3)), end=rim.end, rim=rim)
    sides = np.concatenate(borders)
    lengths = np.linalg.norm(sides[:, 1] - sides[:, 0], axis=1)
    return Ending(sides.mean(axis=1), weights=lengths, end=rim.end, rim=rim)


def _doubt(
    surface: Deformable,
    rim: Rim,
    frames: Sequence[Frame],
    own: Mapping[int, Ending],
    shapes: Sequence[NDArray[np.float64]],
    noises: Sequence[Noise],
    pinned: int | None,
    *,
    is_first: bool,
) -> float | None:
    """Variance of a sector's end, by what is known of the rim; None where data end elsewhere."""
    # Of whole rims, those of landmarks among them: squares of how far they are off, and what chance
    # makes of these.
    offs: list[tuple[float, float]] = []
    of_sectors, means = 0.0, []
    marked = [k for k in own if k != pinned and any(part.places for part in frames[k])]
    step = -(-len(marked) // _MOST_FRAMES)
    for k in [k for k in own if k == pinned] + marked[:: max(1, step)]:
        ending, is_known = own[k], k == pinned
        even = [
            Lying(part, closest_points(part.points, shapes[k], surface.cells))
            for part in frames[k]
            if lies_evenly(part) and not len(ending)
        ]
        found = ending.found(surface, shapes[k], even, noises[k])
        if found is None or found.shown.mean() < _MOST_OF_RIM:
            if is_known:
                return None
            continue
        kept = found.shown > 0.0
        e, v = found.beyond[kept], found.variances[kept]
        mean, chance = float(e.mean()), float(v.mean())
        if is_known:
            if abs(mean) > _FAR * found.most + 2.0 * (chance / len(e)) ** 0.5:
                return None
            of_sectors = max(float((e**2).mean()) - chance, 0.0)
            offs.append((mean**2, chance / len(e)))
            continue
        marks = _off_landmarks(surface, shapes[k], rim, frames[k], found, noises[k])
        offs += marks
        means += [mean / found.most] * bool(marks)
    if means and abs(float(np.mean(means))) > _FAR:
        return None
    if not offs:
        # Landmarks may say it once it was followed; then nobody did.
        return 0.0 if is_first else None
    square, chance = np.mean(offs, axis=0)
    return of_sectors + rim.n_sectors * max(float(square - chance), 0.0)


def _off_landmarks(
    surface: Deformable,
    x: NDArray[np.float64],
    rim: Rim,
    frame: Frame,
    found: DataEnd,
    noise: Noise,
) -> list[tuple[float, float]]:
    """Squared distance of the end from each landmark of the rim, and what chance makes of it."""
    there = rim.at(x)
    offs = []
    for part in frame:
        if part.places is None or part.normals is not None:
            continue
        for row, name in enumerate(part.places):
            vertices, shares = place_on(surface, name)
            if not np.isin(vertices, there.vertices).all():
                continue
            place = np.searchsorted(there.vertices, vertices)
            sector = rim.sectors[vertices]
            if not (found.shown[sector] > 0.0).all():
                continue
            outward = there.directions[place]
            axis = (shares[:, None] * outward).sum(axis=0)
            size = float(np.linalg.norm(axis))
            if size < _FAR:
                continue
            axis = axis / size
            gap = part.points[row] - (shares[:, None] * x[vertices]).sum(axis=0)
            parts = shares * (outward @ axis)
            each = np.bincount(sector, parts, minlength=rim.n_sectors)
            sd = part.sd[row] if isinstance(part.sd, np.ndarray) else None
            variance = float(noise.own(sd)) + float((each**2 * found.variances).sum())
            off = float(gap @ axis - (each * found.beyond).sum())
            offs.append((off**2, variance))
    return offs
