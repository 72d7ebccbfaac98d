"""What was observed, and what speaks against a track though it came to an end."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.mesh.sequence import MM_PER_UNIT
from modalmotion.modes.topology import CLOSED, CUP, SPHERE
from modalmotion.tracking.deformable import Deformable
from modalmotion.tracking.normal_equations import NormalEquations
from modalmotion.tracking.observation import Frame
from modalmotion.tracking.result import Track, normals_of

# Cells of the natural coordinates in which a point covers the surface.
_CELLS: Final = {1: (24,), 2: (6, 12)}


class Quality(NamedTuple):
    """Figures of one frame.

    Parameters
    ----------
    rms, p95 : float, length unit
        Of the distances of the points that counted; NaN without any.
    inliers : float
        Share of the points that counted.
    coverage : float
        Share of the surface in cells that points are at.
    """

    rms: float
    p95: float
    inliers: float
    coverage: float


def quality_of(surface: Deformable, info: NormalEquations) -> Quality:
    """Measure the fit of one frame."""
    counted = info.weights > 0
    if not counted.any():
        return Quality(np.nan, np.nan, 0.0, 0.0)
    size = np.linalg.norm(info.residuals[counted], axis=1)
    rms = float(np.sqrt((size**2).mean()))
    template = surface.template
    cells = _CELLS[template.topology.n_axes]
    cell = np.zeros(template.n_vertices, dtype=np.int64)
    for axis, n in enumerate(cells):
        s = template.coordinates[:, axis]
        s = s % 1.0 if template.topology.ends[axis] == CLOSED else s
        place = np.clip(s * n, 0, n - 1).astype(np.int64)
        cell = cell * n + place
    share = np.bincount(cell, template.weights, minlength=int(np.prod(cells)))
    touched = np.zeros(len(share), dtype=np.bool_)
    touched[cell[info.feet[counted]].ravel()] = True
    return Quality(
        rms,
        float(np.quantile(size, 0.95)),
        float(info.weights[counted].sum() / len(info.weights)),
        float(share[touched].sum()),
    )


# Of the RMS radius: points farther than that from the surface show none, or several.
_THICK: Final = 0.1

# Flat points: spread across the plane over that along it, or over the noise of what is not thick.
_FLAT: Final = 0.02
_NOISES: Final = 3.0
_THIN: Final = 0.1
_FEWEST: Final = 4

# Spread of the points of a frame over that of most frames.
_OTHER_SIZE: Final = 4.0

# Of the RMS radius: no surface is there and back again by so much between two frames.
_JUMP: Final = 2.0

# RMS radii that nobody records in the unit that is stated, mm.
_SMALL_MM, _LARGE_MM = 0.1, 1e5

_GUESSED: Final = (
    "The ends of the surface were not given, so it was treated as closed. If it is open, like a "
    "ventricle at its base, give the landmarks apex and base; otherwise its volumes are wrong."
)

# Percentage points.
_WIDE_BOUND: Final = 5.0

# A turn of so many degrees moves the surface by less than two of its deviations.
_UNSEEN_TURN: Final = 10.0


def doubtful_notes(result: Track) -> list[str]:
    """Say what speaks against a track.

    Parameters
    ----------
    result : Track

    Returns
    -------
    list of str
        One sentence or two for each doubt; none where there is none.
    """
    centre, size = _place(result.template.vertices, result.template.weights)
    doubts = []
    rms = result.residuals[:, 0]
    thick = np.flatnonzero(rms > _THICK * size)
    if thick.size:
        doubts.append(
            f"In {_frames(thick)} points are {np.nanmax(rms):.3g} from the surface (RMS), more "
            f"than a tenth of its radius of {size:.3g}: they may fill a volume, or show several "
            "surfaces."
        )
    radius = size * MM_PER_UNIT.get(result.sequence.unit or "", np.nan)
    if not _SMALL_MM <= radius <= _LARGE_MM and np.isfinite(radius):
        doubts.append(
            f"The surface has a radius of {radius:.2g} mm in the stated unit "
            f"{result.sequence.unit}: check it."
        )
    if result.images is None:
        doubts += _of_points(result)
    doubts += _of_jumps(result, size)
    bound = result.ejection_fraction_bound
    if bound is not None and bound > _WIDE_BOUND:
        doubts.append(
            f"The ejection fraction is known to {bound:.0f} percentage points only: the parts "
            "that determine its volumes were hardly observed."
        )
    return doubts + _of_turns(result, centre)


def end_notes(
    result: Track, stated: Sequence[Frame], frames: Sequence[Frame], *, is_guessed: bool
) -> list[str]:
    """Say what is doubtful in where the surface ends, which points on it do not show.

    Parameters
    ----------
    result : Track
    stated : sequence of Frame
        Points, with the landmarks that were stated.
    frames : sequence of Frame
        The same, with what the data say of ends.
    is_guessed : bool
        Whether nobody stated a surface, a topology or landmarks.
    """
    if is_guessed:
        return [_GUESSED] if result.template.topology == SPHERE else []
    if result.template.topology != CUP:
        return []
    doubts = []
    known = [_ends_in(frame) for frame in stated]
    others = [k for k in range(result.n_frames) if k != result.reference]
    shown = [
        any("base" in (part.end, *(part.places or ())) for part in full[len(own) :])
        for own, full in zip(stated, frames, strict=True)
    ]
    open_ones = [k for k in others if "base" not in known[k] and k not in result.unseen]
    missing = [k for k in open_ones if not shown[k]]
    taken = [k for k in open_ones if shown[k]]
    if taken:
        doubts.append(
            f"The base is not stated in {_frames(np.array(taken))} of {result.n_frames}: it was "
            "assumed where the data end (for slices, between the last one with a contour and the "
            "next). Give it if it is elsewhere."
        )
    if 2 * len(missing) > len(others) and result.n_frames > 1:
        doubts.append(
            f"The base is not stated in {_frames(np.array(missing))} of {result.n_frames}: points "
            "do not show where an open surface ends, and the ejection fraction may have an error "
            "some points larger than stated."
        )
    swapped = [k for k, ends in enumerate(known) if _is_swapped(stated[k], ends)]
    if swapped:
        doubts.append(
            f"In {_frames(np.array(swapped))} more points are near the landmark base than near "
            "apex, but the base is the middle of the opening, without a wall. Are the two swapped?"
        )
    return doubts


def has_landmarks(frames: Sequence[Frame]) -> bool:
    """Return whether any frame has a landmark or points of an end."""
    return any(part.is_landmark for frame in frames for part in frame)


def _ends_in(frame: Frame) -> dict[str, NDArray[np.float64]]:
    """Places of apex and base that a frame states."""
    ends = {part.end: part.points.mean(axis=0) for part in frame if part.end and len(part)}
    for part in frame:
        for place, point in zip(part.places or (), part.points, strict=False):
            # Of other places the mean of several vertices is that of an opening.
            name = "base" if isinstance(place, tuple) and len(place) > 2 else place
            if isinstance(name, str):
                ends[name] = point
    return ends


def _is_swapped(frame: Frame, ends: Mapping[str, NDArray[np.float64]]) -> bool:
    points = [part.points for part in frame if not part.is_landmark and len(part)]
    if not points or not {"apex", "base"} <= ends.keys():
        return False
    cloud = np.concatenate(points)
    apex, base = (np.linalg.norm(cloud - ends[name], axis=1).min() for name in ("apex", "base"))
    axis = ends["base"] - ends["apex"]
    height = (cloud - ends["apex"]) @ axis / (axis @ axis)
    radius = np.linalg.norm(cloud - ends["apex"] - np.outer(height, axis), axis=1)
    low, high = radius[height < 1.0 / 3.0], radius[height > 2.0 / 3.0]
    # Contours may end far from the apex; they narrow towards it all the same.
    narrows = bool(len(low) and len(high) and np.median(low) < np.median(high))
    return bool(base < apex) and not narrows


def _of_points(result: Track) -> list[str]:
    """Frames whose points are flat where a volume is enclosed, or are in another unit."""
    if result.data is None:
        return []
    spreads = np.full((result.n_frames, 3), np.nan)
    for frame in range(result.n_frames):
        rows = result.data.of_frame(frame)
        points = result.data.points[rows][~result.data.are_landmarks[rows]]
        if len(points) >= _FEWEST:
            x = points - points.mean(axis=0)
            spreads[frame] = np.linalg.svd(x, compute_uv=False) / np.sqrt(len(x))
    doubts = []
    within_noise = np.minimum(_NOISES * result.noise.sd, _THIN * spreads[:, 0])
    narrow = np.maximum(_FLAT * spreads[:, 0], within_noise)
    flat = np.flatnonzero(spreads[:, 2] < narrow)
    if flat.size and result.volumes is not None:
        doubts.append(
            f"In {_frames(flat)} the points are in a plane or on a line, within "
            f"{spreads[flat, 2].max():.3g}: the volume beyond it was not observed."
        )
    whole = np.sqrt((spreads**2).sum(axis=1))
    if np.isfinite(whole).any():
        usual = float(np.nanmedian(whole))
        other = np.flatnonzero((whole * _OTHER_SIZE < usual) | (whole > _OTHER_SIZE * usual))
        if other.size:
            doubts.append(
                f"In {_frames(other)} the points extend over {whole[other[0]]:.3g}, in most over "
                f"{usual:.3g}: check the unit of each frame."
            )
    return doubts


def _of_jumps(result: Track, size: float) -> list[str]:
    """Frames in which the surface is far from where it is before and after."""
    if result.n_frames < 3:
        return []
    w = result.template.weights
    centres = np.stack([_place(x.astype(np.float64), w)[0] for x in result.sequence.vertices])
    away = centres[1:-1] - (centres[:-2] + centres[2:]) / 2.0
    jumps = 1 + np.flatnonzero(np.linalg.norm(away, axis=1) > _JUMP * size)
    if not jumps.size:
        return []
    most = 1 + int(np.linalg.norm(away, axis=1).argmax())
    text = (
        f"In frame {most} the surface is {np.linalg.norm(away[most - 1]):.3g} from the centre of "
        "its neighbours, more than its width: check the coordinates of the frames."
    )
    return [text]


def _of_turns(result: Track, centre: NDArray[np.float64]) -> list[str]:
    """Name the axis about which a turn of the whole surface hardly shows, if there is one."""
    template, moving = result.template, result.deviations[:, :, 0].any(axis=1)
    if template.topology.n_axes != 2 or not moving.any():
        return []
    w = template.weights[:, None]
    r = template.vertices - centre
    # A turn by a small angle u moves the surface across by u . (r x n), points by |u x r|.
    across = np.cross(r, normals_of(template, template.vertices))
    inertia = (w * r * r).sum() * np.eye(3) - (w * r).T @ r
    scale, axes = np.linalg.eigh(inertia)
    if not scale[0] > 0:
        return []
    whitened = axes / np.sqrt(scale)
    shares, turns = np.linalg.eigh(whitened.T @ ((w * across).T @ across) @ whitened)
    axis = whitened @ turns[:, 0]
    shown = np.sqrt(max(float(shares[0]), 0.0)) / np.linalg.norm(axis)
    deviation = float(np.median(result.deviations[moving, :, 0]))
    least = np.degrees(2.0 * deviation / max(float(shown), 1e-300))
    if least <= _UNSEEN_TURN:
        return []
    axis *= np.sign(axis[np.abs(axis).argmax()]) / np.linalg.norm(axis)
    where = ", ".join(f"{part:.2f}" for part in axis + 0.0)
    much = "of any angle" if least >= 180.0 else f"of less than {least:.0f} degrees"
    text = (
        f"The surface is so round about the axis ({where}) that a rotation {much} about it is "
        "not detected: rotation and torsion about it are not measured, and are estimated as "
        "about zero."
    )
    return [text]


def _place(
    x: NDArray[np.float64], weights: NDArray[np.float64]
) -> tuple[NDArray[np.float64], float]:
    """Centroid, (3,), and RMS distance from it."""
    w = weights[:, None]
    centre = (w * x).sum(axis=0)
    return centre, float(np.sqrt((w * (x - centre) ** 2).sum()))


def _frames(which: NDArray[np.int64]) -> str:
    """Name one frame, or the first of several."""
    if len(which) == 1:
        return f"frame {which[0]}"
    return f"{len(which)} frames, frame {which[0]} the first,"


# Below this share of the surface under points, what is said of it is said by the prior.
_LOW_COVERAGE: Final = 0.8
_LOW_INLIERS: Final = 0.5

_OFFSETS: Final = (
    "The motion follows the data along the surface's normals; along the surface it comes from "
    "the prior, with the stated standard deviation: twist and sliding are not measured."
)


def notes_on(result: Track) -> list[str]:
    """Say what was not seen, and what the prior said instead."""
    notes = [_OFFSETS]
    if result.unseen:
        notes.append(
            f"Nothing was observed in {len(result.unseen)} of {result.n_frames} frames (the first "
            f"is frame {result.unseen[0]}); there the motion is interpolated."
        )
    low = [k for k, c in enumerate(result.coverage) if c < _LOW_COVERAGE and k not in result.unseen]
    if low:
        notes.append(
            f"In {len(low)} frames points are at less than {_LOW_COVERAGE:.0%} of the surface (at "
            f"least {result.coverage[low].min():.0%}, frame {low[0]}); elsewhere the motion "
            "comes from the prior."
        )
    strays = [k for k, c in enumerate(result.inliers) if 0 < c < _LOW_INLIERS]
    if strays:
        notes.append(
            f"In {len(strays)} frames, frame {strays[0]} the first, most points are outliers: "
            "they may belong to another object."
        )
    undetermined = int((result.determined[:, 1] < 0.5).sum())
    if undetermined:
        notes.append(
            f"The data do not determine the tangential part of {undetermined} of "
            f"{len(result.modes)} modes."
        )
    notes += doubtful_notes(result)
    return notes
