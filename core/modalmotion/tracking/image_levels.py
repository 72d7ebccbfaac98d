"""How bright inside and outside are, by rays and next to edges; and what speaks against it."""

from __future__ import annotations

from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from modalmotion.errors import ShapeError
from modalmotion.images import Plane, Volume
from modalmotion.images.edges import Levels
from modalmotion.images.sequence import Image
from modalmotion.representation import Floats
from modalmotion.tracking.closest import across
from modalmotion.tracking.image_view import Imaging, View

# Heights along the axis, and turns about it, of the rays; of planes each has its own height.
_HEIGHTS: Final = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8)
_N_TURNS: Final = 32

# mm: samples on rays, and windows on both sides of an edge.
_STEP: Final = 0.8
_INNER: Final = 5.0
_OUTER: Final = 3.5

# mm from apex to base. Windows are some mm wide.
_SHORTEST: Final = 20.0

# Of the usual greatest step on a ray: the first step so large is the edge.
_FIRST: Final = 0.6

# Least share of rays that agree on the sign, and least contrast.
_LEAST_AGREED: Final = 0.55
_LEAST_CONTRAST: Final = 0.8

# Of the contrast: how far a frame's levels may be from those of the reference.
_APART: Final = 0.1

# mm inside an edge, from and to, that noise is looked for in.
_BESIDE: Final = (9.0, 2.0)

# Normal deviation over the median one.
_PER_MEDIAN: Final = 1.4826


class FirstSight(NamedTuple):
    """Levels, and where rays first met an edge.

    Parameters
    ----------
    levels : Levels
    points : (n, 3) float64, mm
    """

    levels: Levels
    points: Floats


def first_sight(image: Image, apex: Floats, base: Floats, frame: int) -> FirstSight:
    """Find the brightness on both sides by rays outward from the axis between two landmarks.

    Raises
    ------
    ShapeError
        Where nothing is in the field of view, all is alike, or rays meet no common edge.
    """
    length = float(np.linalg.norm(base - apex))
    if length < _SHORTEST:
        raise ShapeError(
            f"Apex and base are {length:.3g} mm apart in frame {frame}; walls of some mm are "
            f"looked for, in objects of {_SHORTEST:g} mm and more.",
            remedy="State apex and base in LPS mm; of a smaller object enlarge the spacing, and "
            "scale the result back.",
            frame=frame,
            details={"length": length, "least": _SHORTEST},
        )
    offsets: Floats = np.arange(0.0, 0.6 * length + _OUTER, _STEP).astype(np.float64)
    starts, directions, profiles = _rays(image, apex, base, offsets)
    there = np.isfinite(profiles).mean(axis=1) > 0.6
    if there.sum() < _N_TURNS:
        raise ShapeError(
            f"The object is outside the images of frame {frame}: of {len(there)} rays from its "
            f"axis {int(there.sum())} are in the field of view.",
            remedy="State apex and base in LPS mm of these images (RAS has other signs of x, y).",
            frame=frame,
        )
    v, starts, directions = profiles[there], starts[there], directions[there]
    v = np.where(np.isfinite(v), v, np.nanmedian(v, axis=1, keepdims=True))
    a, b = round(_INNER / _STEP), round(_OUTER / _STEP)
    sums = np.concatenate([np.zeros((len(v), 1)), v.cumsum(axis=1)], axis=1)
    j = np.arange(a, v.shape[1] - b)
    inner = (sums[:, j + 1] - sums[:, j + 1 - a]) / a
    outer = (sums[:, j + 1 + b] - sums[:, j + 1]) / b
    step = np.abs(inner - outer)
    usual = float(np.median(step.max(axis=1)))
    if not usual > 1e-9 * float(np.abs(v).max(initial=0.0)):
        raise _no_contrast(frame, 0.0)
    first = (step > _FIRST * usual).argmax(axis=1)
    rows = np.arange(len(v))
    reach = round(5.0 / _STEP)
    near = np.minimum(first[:, None] + np.arange(reach), len(j) - 1)
    k = near[rows, step[rows[:, None], near].argmax(axis=1)]
    A, B = inner[rows, k], outer[rows, k]
    is_edge = step[rows, k] > _FIRST * usual
    sign = np.sign(np.median((A - B)[is_edge])) if is_edge.any() else 1.0
    agrees = is_edge & (np.sign(A - B) == sign)
    noise = _PER_MEDIAN * float(np.median(np.abs(np.diff(v, axis=1)))) / np.sqrt(2.0)
    if agrees.mean() < _LEAST_AGREED:
        raise ShapeError(
            f"No object is seen about the axis in frame {frame}: of the rays outward only "
            f"{agrees.mean():.0%} meet an edge of one kind.",
            remedy="Check apex and base, and that the images show them.",
            frame=frame,
            details={"agreed": float(agrees.mean())},
        )
    levels = _levels(A[agrees], B[agrees], noise)
    if levels.contrast < _LEAST_CONTRAST:
        raise _no_contrast(frame, levels.contrast)
    places = starts[agrees] + (j[k[agrees]] + 0.5)[:, None] * _STEP * directions[agrees]
    return FirstSight(levels, places)


def renewed(imaging: Imaging, view: View) -> Imaging:
    """Find levels and bias field next to the edges that a view found: linear in place.

    Where layers are next to the edges, blood is looked for beyond them.
    """
    inner, outer = view.beside(is_deep=imaging.has_layers)
    x = view.starts[view.edges.is_found] - imaging.middle
    ok = np.isfinite(inner) & np.isfinite(outer)
    if ok.sum() < 4 * _N_TURNS:
        return imaging
    inner, outer, x = inner[ok], outer[ok], x[ok]
    spread = _spread(view)
    gain = 1.0 + x @ imaging.slope
    # Labels have no noise: all errors of more than a thousandth count alike.
    least = 1e-3 * abs(imaging.levels.inside - imaging.levels.outside)
    inside, outside, slope = imaging.levels.inside, imaging.levels.outside, imaging.slope
    for _ in range(4):
        inside, outside = float(np.median(inner / gain)), float(np.median(outer / gain))
        # Both sides, I (1 + c x) and O (1 + c x): c by least absolute deviations, reweighted.
        rows = np.concatenate([inside * x, outside * x])
        left = np.concatenate([inner - inside, outer - outside])
        r = np.abs(left - rows @ slope)
        w = 1.0 / np.maximum(r, max(0.1 * float(np.median(r)), least))
        ridge = 1e-3 * float((w[:, None] * rows * rows).sum()) / 3.0 * np.eye(3)
        slope = np.linalg.solve(rows.T @ (w[:, None] * rows) + ridge, rows.T @ (w * left))
        gain = np.clip(1.0 + x @ slope, 0.4, 1.8)
    if (inside - outside) * (imaging.levels.inside - imaging.levels.outside) <= 0:
        return imaging
    return replace(imaging, levels=Levels(inside, outside, spread), slope=slope)


def as_bright(imaging: Imaging, view: View) -> Imaging:
    """Find the levels of another frame: contrast agents and gain change from frame to frame.

    Each frame begins anew with the levels of the reference, and leaves them by `_APART` of the
    contrast at most, so that nothing drifts.
    """
    own, found = imaging.levels, renewed(imaging, view).levels
    most = _APART * abs(own.inside - own.outside)
    inside = own.inside + float(np.clip(found.inside - own.inside, -most, most))
    outside = own.outside + float(np.clip(found.outside - own.outside, -most, most))
    return replace(imaging, levels=Levels(inside, outside, own.spread))


def _spread(view: View) -> float:
    """Deviation of noise: of samples from the mean of those 1.5 voxels nearer and farther.

    Blood of many brightnesses, muscles within it and a bias field change from place to place by
    more than that, and are no noise; but over some mm they change evenly.
    """
    k = view.edges.is_found
    away = view.offsets[None] - view.edges.offsets[k, None]
    far, near = _BESIDE
    own = np.where((away > -far) & (away < -near), view.profiles[k], np.nan)
    # Between voxels neighbours are interpolated from the same ones.
    step = float(view.offsets[1] - view.offsets[0])
    voxels = min(1.5 * float(np.median(view.extents[k])), (far - near) / 2.0 - step)
    apart = max(1, int(voxels / step))
    n = own.shape[1] - 2 * apart
    left = own[:, apart : apart + n] - (own[:, :n] + own[:, 2 * apart :]) / 2.0
    # The mean of two has half the variance.
    spread = _PER_MEDIAN * float(np.nanmedian(np.abs(left))) / float(np.sqrt(1.5))
    return max(spread, 1e-12 * max(1.0, abs(float(np.nanmedian(own)))))


def _rays(
    image: Image, apex: Floats, base: Floats, offsets: Floats
) -> tuple[Floats, Floats, Floats]:
    """Sample rays from the axis: starts and directions (n, 3) and profiles (n, samples).

    In planes that the axis goes through they start from there.
    """
    axis, cuts = base - apex, list[tuple[float, Floats, Volume | Plane]]()
    across = axis / np.linalg.norm(axis)
    if isinstance(image, Volume):
        cuts = [(share, across, image) for share in _HEIGHTS]
    else:
        for plane in image.planes:
            low, high = plane.heights(np.stack([apex, base]))
            share = low / (low - high) if low != high else -1.0
            if abs(float(plane.normal @ across)) >= 0.7 and 0.1 <= share <= 0.9:
                cuts.append((share, plane.normal, plane))
    starts = np.repeat([apex + share * axis for share, *_ in cuts] or np.zeros((0, 3)), _N_TURNS, 0)
    directions = np.concatenate([np.zeros((0, 3)), *(_around(normal) for _, normal, _ in cuts)])
    points = starts[:, None] + offsets[:, None] * directions[:, None]
    points = points.reshape(len(cuts), _N_TURNS * len(offsets), 3)
    values = [part.sample(own) for (*_, part), own in zip(cuts, points, strict=True)]
    return starts, directions, np.reshape(values, (len(starts), len(offsets)))


def _around(axis: Floats) -> Floats:
    angles = 2.0 * np.pi * np.arange(_N_TURNS) / _N_TURNS
    around: Floats = np.stack([np.cos(angles), np.sin(angles)], axis=1) @ across(axis)
    return around


def _levels(inner: Floats, outer: Floats, noise: float) -> Levels:
    inside, outside = float(np.median(inner)), float(np.median(outer))
    spread = _PER_MEDIAN * float(np.median(np.abs(inner - inside)))
    return Levels(inside, outside, max(spread, noise, 1e-12 * abs(inside - outside)))


def _no_contrast(frame: int, contrast: float) -> ShapeError:
    return ShapeError(
        f"The images of frame {frame} have no contrast about the axis from apex to base: the two "
        f"sides differ by {contrast:.2g} of the noise.",
        remedy="Check apex and base, or take images in which the object stands out.",
        frame=frame,
        details={"contrast": contrast},
    )
