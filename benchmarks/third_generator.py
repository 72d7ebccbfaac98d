"""Hearts of a third generator, that no shipped model is trained on, and no constant is chosen on.

Truncated superquadrics whose base descends at a constant speed and whose wall thickens on a course
of its own; the classes are those of `modalmotion.simulate.MotionClass`, as their definitions say.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

import modalmotion as mm
from modalmotion.mesh import Cavity, lattice_faces
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.simulate import MotionClass

Array = NDArray[np.float64]

# Middles of the walls: lateral 0, septal 180 degrees, right-handed from apex to base.
_WALLS: Final = np.radians(60.0 * np.arange(6))


@dataclass(frozen=True)
class Heart:
    """One ventricle and its beat."""

    semi_axes: tuple[float, float, float]  # mm, lateral, inferior, and to the apex
    powers: tuple[float, float]  # along the axis and around it, 1 of an ellipsoid
    cut: float  # height of the base above the widest section, in semi-axes
    ejection_fraction: float  # where no wall lost its motion
    descent: float  # of the base, share of the length
    twist: float  # degrees, of the apex against the base, counterclockwise as seen from the apex
    period: float  # s
    rise: float  # share of the beat until end systole
    quickness: float  # power of time in the fall, below 1 fills early
    lost: float = 0.0  # share of the motion lost in the middle of a wall
    # Middle and half width of that wall around the axis, rad, and along it, shares.
    wall: tuple[float, float, float, float] = (0.0, 1.0, 0.5, 0.5)
    lag: float = 0.0  # s, of the lateral wall behind the septum
    flash: float = 0.0  # early contraction of the septum, share


def hearts(
    n_per_class: int, seed: int, classes: Sequence[MotionClass] = tuple(MotionClass)
) -> Iterator[tuple[MeshSequence, str]]:
    """Draw recordings of as many of each class, with their labels."""
    for label in classes:
        for k in range(n_per_class):
            rng = np.random.default_rng([seed, list(MotionClass).index(label), k])
            yield record(draw(label, rng), rng), str(label)


def draw(label: MotionClass, rng: np.random.Generator) -> Heart:
    """Draw one heart of a class, from mild to severe."""
    radius = rng.uniform(22.0, 28.0)
    heart = Heart(
        semi_axes=(radius * rng.uniform(0.94, 1.06), radius, rng.uniform(58.0, 74.0)),
        powers=(rng.uniform(0.85, 1.1), rng.uniform(0.9, 1.1)),
        cut=rng.uniform(0.15, 0.4),
        ejection_fraction=rng.uniform(0.58, 0.68),
        descent=rng.uniform(0.12, 0.18),
        twist=rng.uniform(9.0, 20.0),
        period=rng.uniform(0.7, 1.1),
        rise=rng.uniform(0.32, 0.42),
        quickness=rng.uniform(0.65, 0.9),
    )
    if label == MotionClass.HYPOKINESIA:
        share = rng.uniform(0.15, 0.5) / heart.ejection_fraction
        (a, b, c), wider = heart.semi_axes, rng.uniform(1.0, 1.3)
        heart = replace(heart, semi_axes=(wider * a, wider * b, c), twist=share * heart.twist)
        less = share * heart.ejection_fraction
        return replace(heart, ejection_fraction=less, descent=share * heart.descent)
    if label == MotionClass.AKINESIA:
        middle, height = rng.choice(_WALLS) + rng.normal(0.0, 0.1), rng.uniform(0.3, 0.7)
        wall = (middle, np.radians(rng.uniform(75.0, 105.0)), height, rng.uniform(0.5, 0.8))
        return replace(heart, lost=rng.uniform(0.5, 1.2), wall=wall)
    if label == MotionClass.DYSSYNCHRONY:
        lag, flash = rng.uniform(0.055, 0.15), rng.uniform(0.1, 0.3)
        return replace(heart, ejection_fraction=rng.uniform(0.2, 0.6), lag=lag, flash=flash)
    if label == MotionClass.REDUCED_TORSION:
        return replace(heart, twist=rng.uniform(-4.0, 5.0))
    return heart


def record(heart: Heart, rng: np.random.Generator) -> MeshSequence:
    """Record one beat from end diastole on: a mesh of its own, held anywhere, with noise."""
    grid = int(rng.integers(19, 26)), int(rng.integers(28, 44))
    times = np.linspace(0.0, heart.period, int(rng.integers(18, 36)), endpoint=False)
    # The lattice behind the apex, which a fan closes.
    ring = 1 + np.arange(grid[1])
    fan = np.stack([np.zeros_like(ring), np.roll(ring, -1), ring], axis=1)
    faces = np.concatenate([fan, 1 + lattice_faces(mm.CUP, grid)])
    frames = _frames(heart, grid, times, _solved(heart, grid, faces))
    frames = frames + rng.normal(0.0, 0.5, frames.shape)  # mm
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    turn[:, 0] *= np.linalg.det(turn)
    frames = frames @ turn.T + rng.normal(0.0, 50.0, 3)
    facts = mm.Facts(tracking="material", cavity="lv", handedness="right")
    return mesh_sequence(frames, faces, topology=mm.CUP, times=times, unit="mm", facts=facts)


def _solved(heart: Heart, grid: tuple[int, int], faces: NDArray[np.int64]) -> float:
    """Find the radial contraction at which all walls together eject what they should."""
    whole, times = replace(heart, lost=0.0), np.linspace(0.0, heart.period, 24, endpoint=False)

    def excess(contraction: float) -> float:
        volumes = Cavity(faces).volume(_frames(whole, grid, times, contraction))
        return float(1.0 - volumes.min() / volumes.max() - heart.ejection_fraction)

    return float(brentq(excess, 0.0, 0.9, xtol=1e-4))


def _frames(heart: Heart, grid: tuple[int, int], times: Array, contraction: float) -> Array:
    """Place the nodes in each frame, the apex first: (times, nodes, 3), mm."""
    n_rows, n_columns = grid
    lowest, highest = np.pi * 0.5 / n_rows, np.arccos(-heart.cut)
    polar = np.append(0.0, np.repeat(np.linspace(lowest, highest, n_rows), n_columns))
    around = np.append(0.0, np.tile(2 * np.pi * np.arange(n_columns) / n_columns, n_rows))
    (a, b, c), (along, about) = heart.semi_axes, heart.powers
    x, y = a * _power(np.cos(around), about), b * _power(np.sin(around), about)
    z = -c * _power(np.cos(polar), along)
    height = (z + c) / (z.max() + c)
    late = (1.0 + np.cos(around)) / 2.0
    t = times[:, None] - heart.lag * late
    middle, half, level, reach = heart.wall
    apart = np.angle(np.exp(1j * (around - middle)))
    kept = 1.0 - heart.lost * _bump(apart / half) * _bump((height - level) / reach)
    flash = heart.flash * (1.0 - late) * _bump((t / heart.period - 0.08) / 0.08)
    thicker = (_course(heart, t) + flash) * kept
    sinks = _course(heart, t, is_linear=True) * kept
    # Counterclockwise from the apex is negative about the axis; the base turns the other way.
    turn = np.radians(heart.twist) * (height - 0.75) * _course(heart, times[:, None])
    inwards = np.sin(polar) ** along * (1.0 - contraction * thicker)
    x, y, z = inwards * x, inwards * y, z - heart.descent * (z.max() + c) * height * sinks
    cos, sin = np.cos(turn), np.sin(turn)
    return np.stack([x * cos - y * sin, x * sin + y * cos, z], axis=2)


def _course(heart: Heart, times: Array, is_linear: bool = False) -> Array:
    """Share of the motion that is reached: up to 1 at end systole and back, again each beat."""
    share = np.mod(times / heart.period, 1.0)
    up = np.clip(share / heart.rise, 0.0, 1.0)
    down = np.clip((share - heart.rise) / (1.0 - heart.rise), 0.0, 1.0)
    rising = up if is_linear else np.sin(np.pi * up**1.2 / 2) ** 2
    return np.where(share < heart.rise, rising, np.cos(np.pi * down**heart.quickness / 2) ** 2)


def _power(x: Array, exponent: float) -> Array:
    return np.asarray(np.sign(x) * np.abs(x) ** exponent)


def _bump(x: Array) -> Array:
    """Evaluate a smooth bump: 1 at 0, 0 from 1 on."""
    return np.where(np.abs(x) < 1.0, np.cos(np.pi * x / 2) ** 2, 0.0)
