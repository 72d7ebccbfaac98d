"""Images of a spheroid cut at its base, whose wall and chest are known in closed form."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from modalmotion.images import Plane, PlaneSet, Volume
from modalmotion.mesh.sequence import mesh_sequence, standard_surface
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import CUP
from modalmotion.template import Template, make_template

Floats = NDArray[np.float64]

LENGTH, RADIUS, WALL = 40.0, 22.0, 9.0
MIDDLE = np.array([12.0, -30.0, 55.0])
AXES = Rotation.from_rotvec([0.3, -0.4, 0.2]).as_matrix()
# The cut: 28 mm above the middle.
CUT = 28.0
APEX = MIDDLE - LENGTH * AXES[:, 2]
BASE = MIDDLE + CUT * AXES[:, 2]
LANDMARKS = {"apex": APEX, "base": BASE}


@dataclass(frozen=True)
class Look:
    """Brightness of blood, wall and chest, noise, and what is done to it in the end."""

    blood: float = 100.0
    wall: float = 40.0
    chest: float = 60.0
    noise: float = 4.0
    bias: float = 0.0


def brightness(points: Floats, radius: float, look: Look, rng: np.random.Generator) -> Floats:
    """Brightness at points (n, 3), mm; the spheroid goes on above the cut, as an atrium."""
    local = (points - MIDDLE) @ AXES
    half = np.array([radius, radius, LENGTH])
    size = np.linalg.norm(local / half, axis=1)
    # First order of the distance: size - 1 over its gradient.
    away = (size - 1.0) * size / np.maximum(np.linalg.norm(local / half**2, axis=1), 1e-9)
    inside = np.clip(0.5 - away, 0.0, 1.0)
    wall = np.clip(0.5 - (away - WALL), 0.0, 1.0)
    values = look.chest + (look.wall - look.chest) * wall
    values += (look.blood - values) * inside
    values *= 1.0 + look.bias * np.clip((points - MIDDLE) @ AXES[:, 0] / 40.0, -1.0, 1.0)
    return np.asarray(values + rng.normal(0.0, look.noise, len(points)))


def volume(
    radius: float = RADIUS,
    look: Look | None = None,
    *,
    affine: Floats | None = None,
    shape: tuple[int, int, int] = (40, 40, 52),
    seed: int = 0,
) -> Volume:
    """Take a volume of 2 mm, or of any affine (3, 4)."""
    if affine is None:
        affine = np.column_stack([2.0 * np.eye(3), MIDDLE - 2.0 * (np.array(shape) - 1) / 2])
    index = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1).reshape(-1, 3)
    points = index @ affine[:, :3].T + affine[:, 3]
    values = brightness(points, radius, look or Look(), np.random.default_rng(seed))
    return Volume(values.reshape(shape).astype(np.float32), affine)


def planes(
    radius: float = RADIUS,
    look: Look | None = None,
    shifts: Floats | None = None,
    seed: int = 0,
    thickness: float = 6.0,
) -> PlaneSet:
    """Take six planes across the axis and two along it, 1.5 mm, each showing all `shifts` aside.

    A pixel is the mean through the slice.
    """
    rng = np.random.default_rng(seed)
    n, width, look = 60, 1.5, look or Look()
    still = replace(look, noise=0.0)
    through = thickness * (np.arange(6) - 2.5) / 6
    u, v, w = AXES.T
    middles = [(u, v, MIDDLE + h * w) for h in np.linspace(-34.0, 24.0, 6)]
    middles += [(u, w, MIDDLE), (v, w, MIDDLE)]
    found = []
    for k, (a, b, middle) in enumerate(middles):
        affine = np.column_stack([width * a, width * b, middle - (n - 1) / 2 * width * (a + b)])
        index = np.stack(np.meshgrid(np.arange(n), np.arange(n), indexing="ij"), -1).reshape(-1, 2)
        points = index @ affine[:, :2].T + affine[:, 2]
        if shifts is not None:
            points = points - shifts[k]
        across = np.cross(a, b)
        layers = [brightness(points + y * across, radius, still, rng) for y in through]
        values = np.mean(layers, axis=0) + rng.normal(0.0, look.noise, len(points))
        found.append(Plane(values.reshape(n, n), affine, thickness))
    return PlaneSet(tuple(found))


def spheroid() -> Template:
    """Take the surface itself, from the tip to the cut."""
    n, m = 20, 40
    polar = np.linspace(0.03, np.pi - np.arccos(CUT / LENGTH), n)[:, None]
    turn = 2.0 * np.pi * np.arange(m) / m
    axes = (RADIUS * np.cos(turn), RADIUS * np.sin(turn), -LENGTH * np.ones(m))
    across = (np.sin(polar), np.sin(polar), np.cos(polar))
    local = np.stack([a * b for a, b in zip(across, axes, strict=True)], axis=-1)
    x = MIDDLE + local.reshape(-1, 3) @ AXES.T
    faces = standard_surface(Lattice(CUP, (n, m))).faces
    return make_template(mesh_sequence(x[None], faces, grid=(n, m), topology="cup"))


def uneven(image: Volume, share: float = 0.15) -> Volume:
    """Blood of another brightness from place to place, by a wave of 40 mm along each axis."""
    index = np.stack(np.meshgrid(*map(np.arange, image.shape), indexing="ij"), axis=-1)
    points = index @ image.affine[:, :3].T + image.affine[:, 3]
    wave = np.sin(2.0 * np.pi * (points - MIDDLE) / 40.0).sum(axis=-1)
    return Volume((image.values * (1.0 + share * wave)).astype(np.float32), image.affine)


def off_surface(vertices: Floats, radius: float = RADIUS) -> float:
    """Mean distance of vertices from the spheroid, mm, to first order."""
    local = (vertices - MIDDLE) @ AXES
    half = np.array([radius, radius, LENGTH])
    size = np.linalg.norm(local / half, axis=1)
    away = (size - 1.0) * size / np.linalg.norm(local / half**2, axis=1)
    return float(np.abs(away).mean())


def enclosed(radius: float = RADIUS) -> float:
    """Volume below the cut, mm^3: pi r^2 (z - z^3 / 3 l^2) from -l to the cut."""
    z = np.array([CUT, -LENGTH])
    high, low = z - z**3 / (3.0 * LENGTH**2)
    return float(np.pi * radius**2 * (high - low))


_LABELLED = (56, 56, 66)


def labels(radius: float = RADIUS) -> Volume:
    """3 in the cavity, 2 in the wall; cut at the base."""
    affine = np.column_stack([1.5 * np.eye(3), MIDDLE - 1.5 * (np.array(_LABELLED) - 1) / 2])
    index = np.stack(np.meshgrid(*map(np.arange, _LABELLED), indexing="ij"), axis=-1)
    local = (index @ affine[:, :3].T + affine[:, 3] - MIDDLE) @ AXES
    inside, outside = (
        np.linalg.norm(local / (np.array([radius, radius, LENGTH]) + w), axis=-1) < 1.0
        for w in (0.0, WALL)
    )
    values = np.where(inside, 3, np.where(outside, 2, 0)).astype(np.uint8)
    values[local[..., 2] > CUT] = 0
    return Volume(values, affine)
