"""Contours of simulated ventricles: sections by planes that stay, as readers draw them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from seen_surfaces import Cases, Seen, Truth, ventricles

from modalmotion.mesh import cavity_of
from modalmotion.tracking import Observation

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Rng = np.random.Generator

# Of the base against the axis, as of a valve; between points, of points and of slices aside, mm.
_TILT, _STEP, _NOISE, _SHIFT = np.radians(15.0), 2.5, 0.7, 0.5

# Sections whose mean radius is smaller, mm, are drawn by no reader: at end systole the apical
# slices vanish. The least radius of each reader lies between these.
_SMALLEST = (6.0, 11.0)


def contoured(
    seed: int, n: int, n_known: int, *, vanish: bool = False, of: Cases | None = None
) -> Iterator[Seen]:
    """Draw contours of ventricles whose base leans.

    Short-axis slices 15 mm apart and three long-axis ones, whose ends show the valve in the first
    `n_known` frames, the apex being known in the first; or, where the apical slices vanish,
    short-axis ones alone, 10 mm apart, with apex and base as landmarks of as many frames. Of the
    ventricles `of`, or of `n` that are simulated.
    """
    for upright, rng in of or ventricles(seed, n):
        truth = _leaning(upright)
        ends = [truth.vertices[:, list(end)].mean(axis=1) for end in truth.ends]
        apices, bases = (places + rng.normal(0.0, 1.0, places.shape) for places in ends)
        seen = []
        for k, (points, valve) in enumerate(_drawn(truth, rng, vanish=vanish)):
            seen.append([Observation(points)])
            if k == 0 or (vanish and k < n_known):
                seen[k].append(Observation(apices[k][None], places=("apex",)))
            if k < n_known:
                base = Observation(bases[k][None], places=("base",))
                seen[k].append(base if vanish else Observation(valve, end="base"))
        yield truth, seen


def _leaning(truth: Truth) -> Truth:
    tip, rim = (list(end) for end in truth.ends)
    x = truth.vertices.copy()
    for frame in x:
        apex = frame[tip].mean(axis=0)
        axis = frame[rim].mean(axis=0) - apex
        length = float(np.linalg.norm(axis))
        axis /= length
        across = _unit(np.cross(axis, (0.2, 0.9, 0.1)))
        height = np.maximum((frame - apex) @ axis / length, 0.0) ** 3
        frame += (np.tan(_TILT) * ((frame - apex) @ across) * height)[:, None] * axis
    return replace(truth, vertices=x)


def _drawn(truth: Truth, rng: Rng, *, vanish: bool) -> Iterator[tuple[Floats, Floats]]:
    """Points of the sections, and of the valve, of each frame."""
    x, faces = truth.vertices, truth.faces
    tip, rim = (list(end) for end in truth.ends)
    openings = cavity_of(faces, x.shape[1]).openings
    sides = max(openings, key=lambda edges: int(np.isin(edges, rim).sum()))
    apex, middle = x[0][tip].mean(axis=0), x[0][rim].mean(axis=0)
    length, axis = float(np.linalg.norm(middle - apex)), _unit(middle - apex)
    first = _unit(np.cross(axis, (0.3, 0.5, 0.7)))
    second, turn, spacing = np.cross(axis, first), rng.uniform(0.0, np.pi), 10.0 if vanish else 15.0
    short = [(apex + h * axis, axis) for h in np.arange(rng.uniform(0.0, spacing), length, spacing)]
    angles = turn + np.arange(3) * np.pi / 3
    long = [(apex, np.cos(a) * first + np.sin(a) * second) for a in angles]
    planes = short if vanish else [*short, *long]
    shifts = [_in_plane(rng.normal(0.0, _SHIFT, (1, 3)), n) for _, n in (*short, *long)]
    smallest = rng.uniform(*_SMALLEST) if vanish else 0.0
    for frame in x:
        rows = []
        for (origin, normal), shift in zip(planes, shifts, strict=False):
            points = _section(frame, faces, origin, normal, rng)
            away = points - points.mean(axis=0) if len(points) else points
            if len(points) and np.linalg.norm(away, axis=1).mean() >= smallest:
                moves = rng.normal(0.0, _NOISE, points.shape)
                rows.append(points + shift + _in_plane(moves, normal))
        ends = []
        for (origin, normal), shift in zip(long, shifts[len(short) :], strict=True):
            points = _crossings(frame, sides, origin, normal)
            ends.append(points + shift + _in_plane(rng.normal(0.0, 1.0, points.shape), normal))
        yield np.concatenate(rows), np.concatenate(ends)


def _crossings(x: Floats, sides: Ints, origin: Floats, normal: Floats) -> Floats:
    """Where sides of triangles pass through a plane."""
    height = (x - origin) @ normal
    a, b = sides[height[sides].prod(axis=1) < 0].T
    t = height[a] / (height[a] - height[b])
    return np.asarray(x[a] + t[:, None] * (x[b] - x[a]))


def _section(x: Floats, faces: Ints, origin: Floats, normal: Floats, rng: Rng) -> Floats:
    """Points of a surface in a plane, evenly along the section."""
    height = (x - origin) @ normal
    cut = faces[(height[faces].min(axis=1) < 0) & (height[faces].max(axis=1) > 0)]
    pairs = [_crossings(x, face[[[0, 1], [1, 2], [2, 0]]], origin, normal) for face in cut]
    both = np.array([pair for pair in pairs if len(pair) == 2])
    if not len(both):
        return np.zeros((0, 3))
    reach = np.cumsum(np.linalg.norm(both[:, 1] - both[:, 0], axis=1))
    n = max(3, round(float(reach[-1]) / _STEP))
    piece = np.searchsorted(reach, (np.arange(n) + 0.5) / n * reach[-1])
    t = rng.uniform(0.0, 1.0, (n, 1))
    return np.asarray((1.0 - t) * both[piece, 0] + t * both[piece, 1])


def _in_plane(moves: Floats, normal: Floats) -> Floats:
    return np.asarray(moves - (moves @ normal)[:, None] * normal)


def _unit(vector: NDArray[Any]) -> Floats:
    return np.asarray(vector / np.linalg.norm(vector))
