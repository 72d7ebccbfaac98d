"""Ventricles of a second generator, so that models do not learn one simulator's peculiarities.

The classes are those of `draw_parameters`; shape, time course, regional rule and mesh are not: a
bullet whose wall thickens section by section, in steps with pauses between them, on a mesh of
scattered points.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from modalmotion.mesh import Cavity, Facts
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.modes.topologies import CUP
from modalmotion.simulate.cohort import MotionClass
from modalmotion.simulate.surface import random_rotation, rotation_matrix

Array = NDArray[np.float64]

_VERTICES: Final = (350, 1500)
# Times at which the contraction is sought that ejects what it should.
_N_TIMES: Final = 24
# Waves of individual variation, and the most along the axis and around it.
_N_WAVES: Final = 6


@dataclass(frozen=True)
class BulletParameters:
    """One ventricle and its beat; angles count from the lateral wall, right-handed, rad."""

    length: float  # mm
    radius: float  # mm
    shoulder: float  # height where the apical half ellipsoid ends, share of the length
    taper: float  # narrowing of the cylinder above it, share
    flatness: float  # of the septum, share of the radius
    ejection_fraction: float
    shortening: float  # of the length, share
    gradient: float  # of the radial contraction, from apex to base
    twist: float  # degrees, of the apex against the base, counterclockwise seen from the apex
    level: float  # degrees that the whole turns
    period: float  # s
    systole: float  # end of ejection, share of the beat
    rest: float  # until the filling begins, share
    filling: float  # duration of the early filling, share
    early: float  # share of the stroke that fills early; the atrium does the rest
    lost: float = 0.0  # share of the motion lost in a region
    region: tuple[float, float, float, float] = (0.0, 1.0, 0.3, 0.7)  # middle, half width; heights
    lag: float = 0.0  # s, of the lateral wall behind the septum
    flash: float = 0.0  # early contraction of the septum, share
    variation: float = 0.0  # mm


def bullet_cohort(
    n_per_class: int,
    *,
    rng: np.random.Generator,
    classes: Sequence[MotionClass] = tuple(MotionClass),
    noise: float = 0.6,
    n_frames: tuple[int, int] = (12, 40),
) -> Iterator[tuple[MeshSequence, MotionClass]]:
    """Simulate as many ventricles of each class, class by class in turn.

    Parameters
    ----------
    n_per_class : int
    rng : numpy.random.Generator
    classes : sequence of MotionClass
    noise : float, mm
    n_frames : (int, int)
        Fewest and most frames of a beat.

    Yields
    ------
    (MeshSequence, MotionClass)
        In mm and s, starting anywhere in the beat for every second one.
    """
    for number in range(n_per_class):
        for label in classes:
            drawn = draw_bullet(label, rng)
            n = int(rng.integers(n_frames[0], n_frames[1] + 1))
            start = rng.uniform() if number % 2 else 0.0
            yield simulate_bullet(drawn, n, start, noise, rng), label


def draw_bullet(label: MotionClass, rng: np.random.Generator) -> BulletParameters:
    """Draw one ventricle of a class, from mild to severe."""
    p = BulletParameters(
        length=rng.uniform(70.0, 100.0),
        radius=rng.uniform(19.0, 29.0),
        shoulder=rng.uniform(0.45, 0.85),
        taper=rng.uniform(-0.05, 0.25),
        flatness=rng.uniform(0.0, 0.12),
        ejection_fraction=rng.uniform(0.54, 0.72),
        shortening=rng.uniform(0.10, 0.22),
        gradient=rng.uniform(-0.4, 0.4),
        twist=rng.uniform(9.0, 20.0),
        level=rng.uniform(-3.0, 5.0),
        period=rng.uniform(0.6, 1.2),
        systole=rng.uniform(0.28, 0.42),
        rest=rng.uniform(0.03, 0.1),
        filling=rng.uniform(0.15, 0.28),
        early=rng.uniform(0.5, 0.9),
        variation=rng.uniform(0.0, 2.5),
    )
    if label == MotionClass.HYPOKINESIA:
        return _weakened(p, rng.uniform(0.15, 0.5))
    if label == MotionClass.DYSSYNCHRONY:
        weak = _weakened(p, rng.uniform(0.2, 0.6))
        return replace(weak, lag=rng.uniform(0.055, 0.15), flash=rng.uniform(0.1, 0.4))
    if label == MotionClass.REDUCED_TORSION:
        return replace(p, twist=rng.uniform(-4.0, 5.0))
    if label == MotionClass.AKINESIA:
        low = rng.uniform(0.0, 0.55)
        wall = (rng.uniform(0.0, 2 * np.pi), np.radians(rng.uniform(40.0, 80.0)))
        region = (*wall, low, low + rng.uniform(0.3, 0.6))
        return replace(p, lost=rng.uniform(0.5, 1.2), region=region)
    return p


def simulate_bullet(
    parameters: BulletParameters,
    n_frames: int,
    start: float,
    noise: float,
    rng: np.random.Generator,
) -> MeshSequence:
    """Record one beat on a mesh of scattered points, in any pose.

    Parameters
    ----------
    parameters : BulletParameters
    n_frames : int
    start : float
        Phase of the first frame, beats; 0 is end diastole.
    noise : float, mm
        Of each coordinate of each vertex.
    rng : numpy.random.Generator
    """
    p = parameters
    places, faces = _scattered(int(rng.integers(*_VERTICES)), rng)
    waves = rng.normal(size=(2, _N_WAVES, 3)), rng.uniform(0.0, 2 * np.pi, (2, _N_WAVES))
    cavity, times = Cavity(faces), np.arange(_N_TIMES) / _N_TIMES
    whole = replace(p, lost=0.0)

    def excess(contraction: float) -> float:
        volumes = cavity.volume(_positions(whole, *places, times, contraction, waves))
        return float(1.0 - volumes.min() / volumes[0] - p.ejection_fraction)

    contraction = float(scipy.optimize.brentq(excess, -0.3, 0.95, xtol=1e-4))
    beats = np.arange(n_frames) / n_frames
    frames = _positions(p, *places, np.mod(beats + start, 1.0), contraction, waves)
    frames = frames + rng.normal(0.0, noise, frames.shape)
    turn = rotation_matrix(np.array(random_rotation(rng)))
    frames = frames @ turn.T + rng.uniform(-100.0, 100.0, 3)
    facts = Facts(
        tracking="material",
        handedness="right",
        period=p.period,
        cavity="lv",
        modality="simulated",
    )
    return mesh_sequence(
        frames, faces, topology=CUP, times=beats * p.period, unit="mm", facts=facts
    )


def _weakened(p: BulletParameters, ejection_fraction: float) -> BulletParameters:
    share = min(1.0, ejection_fraction / 0.63)
    return replace(
        p,
        ejection_fraction=ejection_fraction,
        shortening=p.shortening * share,
        twist=p.twist * share,
        level=p.level * share,
        radius=p.radius * (1.0 + 0.35 * (1.0 - share)),
        length=p.length * (1.0 + 0.1 * (1.0 - share)),
        variation=p.variation * (0.5 + 0.5 * share),
    )


def _scattered(n: int, rng: np.random.Generator) -> tuple[tuple[Array, Array], NDArray[np.int64]]:
    """Scatter points over a disc, its middle the apex and its rim the base; heights and angles."""
    n_rim = int(2.2 * np.sqrt(n))
    step = np.sqrt(np.pi / n)
    x, y = (a.ravel() for a in np.meshgrid(*[np.arange(-1.0, 1.0, step)] * 2))
    x, y = x + rng.uniform(-0.3, 0.3, x.shape) * step, y + rng.uniform(-0.3, 0.3, y.shape) * step
    inside = np.hypot(x, y) < 1.0 - 0.6 * step
    around = 2 * np.pi * np.arange(n_rim) / n_rim
    x = np.concatenate([np.cos(around), x[inside]])
    y = np.concatenate([np.sin(around), y[inside]])
    faces = scipy.spatial.Delaunay(np.stack([x, y], axis=1)).simplices.astype(np.int64)
    # Outwards seen from the axis, with the apex down.
    ends = np.stack([x, y], axis=1)[faces]
    a, b = ends[:, 1] - ends[:, 0], ends[:, 2] - ends[:, 0]
    turns = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] > 0
    faces[turns] = faces[turns][:, ::-1]
    return (np.hypot(x, y), np.arctan2(y, x)), faces


def _positions(
    p: BulletParameters,
    depth: Array,
    around: Array,
    phases: Array,
    contraction: float,
    waves: tuple[Array, Array],
) -> Array:
    """Positions at phases of the beat, (phases, vertices, 3), mm; the apex is at the origin."""
    # Steeper near the apex, where the disc is pulled over the half ellipsoid.
    height = depth**1.6
    low = np.clip(height / p.shoulder, 0.0, 1.0)
    radius = p.radius * np.sqrt(np.maximum(0.0, 1.0 - (1.0 - low) ** 2))
    above = np.clip((height - p.shoulder) / (1.0 - p.shoulder), 0.0, 1.0)
    septum = np.exp(-((np.angle(np.exp(1j * (around - np.pi))) / 0.9) ** 2))
    radius = radius * (1.0 - p.taper * above**2) * (1.0 - p.flatness * septum)
    apart = np.abs(np.angle(np.exp(1j * around))) / np.pi
    t = phases[:, None]
    kept = 1.0 - p.lost * _region(p, height, around)
    late = _contracted(p, t - p.lag / p.period * (1.0 - apart))
    early = p.flash * septum * np.exp(-(((np.mod(t + 0.5, 1.0) - 0.5) - 0.07) ** 2) / 0.0018)
    still, moving = (_varied(height, around, w, a) for w, a in zip(*waves, strict=True))
    share = (late + early) * kept
    inwards = contraction * (1.0 + p.gradient * (height - 0.5)) * share
    r = (radius + p.variation * still * low) * (1.0 - inwards) - p.variation * moving * low * late
    sinks = p.shortening * p.length * height**1.3 * _contracted(p, t + 0.015) * kept
    # Counterclockwise seen from the apex is negative about the axis, which leads to the base.
    turn = -np.radians(p.level + p.twist * (0.7 - height)) * _contracted(p, t + 0.02)
    angle = around + turn
    return np.stack([r * np.cos(angle), r * np.sin(angle), height * p.length - sinks], axis=2)


def _contracted(p: BulletParameters, phase: Array) -> Array:
    """Share of the contraction: systole, a pause, early filling, a pause, the atrium."""
    t = np.mod(phase, 1.0)
    begin, fills = p.systole + p.rest, p.systole + p.rest + p.filling
    up = _step((t - 0.02) / (p.systole - 0.02))
    down = p.early * _step((t - begin) / (fills - begin)) + (1.0 - p.early) * _step(
        (t - max(fills, 0.86)) / (1.0 - max(fills, 0.86))
    )
    return np.asarray(up - down)


def _region(p: BulletParameters, height: Array, around: Array) -> Array:
    """1 within a box of angles and heights, with soft edges."""
    middle, half, low, high = p.region
    apart = np.abs(np.angle(np.exp(1j * (around - middle))))
    edges = (half - apart) / 0.2, (height - low) / 0.06, (high - height) / 0.06
    return np.asarray(np.prod([1.0 / (1.0 + np.exp(-edge)) for edge in edges], axis=0))


def _varied(height: Array, around: Array, weights: Array, angles: Array) -> Array:
    """Evaluate a smooth random field of about unit size."""
    k = 1 + np.arange(_N_WAVES)
    waves = np.cos(np.outer(height, np.pi * (k // 2)) + np.outer(around, k % 4) + angles)
    return np.asarray(waves @ weights[:, 0] / np.sqrt(_N_WAVES))


def _step(x: Array) -> Array:
    """Rise smoothly from 0 at 0 to 1 at 1."""
    x = np.clip(x, 0.0, 1.0)
    return np.asarray(x**3 * (10.0 - 15.0 * x + 6.0 * x**2))
