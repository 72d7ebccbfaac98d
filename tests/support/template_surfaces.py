"""Surfaces that move, simulated at the vertices of any triangulation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from project import DATA
from scipy.spatial import ConvexHull, Delaunay

from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.signature.fit import Basis, Fit, Fitter, make_basis
from modalmotion.signature.parameters import SignatureParameters
from modalmotion.template import GivenLandmarks, Template, choose_modes, make_template
from modalmotion.template.body_frame import Components, body_frame

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Moving = tuple[Floats, Ints]

PHASES = 2 * np.pi * np.arange(12) / 12
SQUEEZE = (1 - np.cos(PHASES)) / 2


def shared(name: str) -> Moving:
    """Vertices (float64) and faces of a file that is not part of the project."""
    path = DATA / f"{name}.npz"
    if not path.is_file():
        pytest.skip(f"{path.name} is not there: it is measured on, not shipped")
    with np.load(path) as arrays:
        return arrays["vertices"].astype(np.float64), arrays["faces"].astype(np.int64)


@dataclass(frozen=True, eq=False)
class Described:
    """Everything that comes of one sequence."""

    sequence: MeshSequence
    template: Template
    fit: Fit
    amplitudes: Floats


def describe(
    moving: Moving,
    n_modes: int = 7,
    *,
    topology: str | None = None,
    landmarks: GivenLandmarks | None = None,
    components: Components = Components.CARTESIAN,
    closed_form: bool = True,
) -> Described:
    """Fit a sequence, amplitudes in the frame of the body where there is one."""
    sequence = mesh_sequence(*moving, topology=topology)
    template = make_template(sequence, landmarks=landmarks, closed_form=closed_form)
    basis = make_basis(template, choose_modes(template, n_modes)[0])
    fit = fit_sequence(sequence, template, basis, components=components)
    amplitudes = fit.amplitudes
    if template.landmarks is not None and components == Components.CARTESIAN:
        amplitudes = amplitudes @ body_frame(template.landmarks).T
    return Described(sequence, template, fit, amplitudes)


def fit_sequence(
    sequence: MeshSequence,
    template: Template,
    basis: Basis,
    **parameters: Any,
) -> Fit:
    """Fit modes at hand."""
    return Fitter.of(sequence, template, SignatureParameters(**parameters)).fit(basis)


def root_mean_square(values: Floats) -> float:
    return float(np.sqrt((values**2).mean()))


def cut_in_two(moving: Moving) -> Moving:
    """The surface in two pieces, upper and lower; copies of the rim come last."""
    vertices, faces = moving
    above = vertices[0, faces, 2].mean(axis=1) > np.median(vertices[0, :, 2])
    rim = np.intersect1d(faces[above], faces[~above])
    copies = np.arange(vertices.shape[1])
    copies[rim] = vertices.shape[1] + np.arange(len(rim))
    faces = np.where(above[:, None], copies[faces], faces)
    return np.concatenate([vertices, vertices[:, rim]], axis=1), faces


# Shapes: where material points lie at each phase.


def ventricle(points: Floats) -> Floats:
    """A beating, twisting, leaning cup over a unit sphere cut above."""
    x, y, z = points.T
    azimuth, height = np.arctan2(y, x), (z + 1) / 1.35
    frames = []
    for phase, c in zip(PHASES, SQUEEZE, strict=True):
        wall = 25 * (1 + 0.12 * np.cos(azimuth - 0.4) * height + 0.05 * np.cos(2 * azimuth))
        wall *= (
            1 - 0.3 * c * (0.6 + 0.4 * np.sqrt(height)) - 0.06 * c * np.cos(azimuth - 1) * height
        )
        twist = 0.25 * c * (1 - height)
        frames.append(
            np.stack(
                [
                    wall * (x * np.cos(twist) - y * np.sin(twist)) + 4 * height * c + 5 * height,
                    wall * (x * np.sin(twist) + y * np.cos(twist)),
                    60 * z * (1 - 0.15 * c) + 3 * np.sin(phase),
                ],
                axis=1,
            )
        )
    return np.array(frames)


def blob(points: Floats) -> Floats:
    """A closed pear that bulges."""
    x, y, z = points.T
    frames = []
    for c in SQUEEZE:
        size = 1 + 0.15 * x * z + 0.1 * y + 0.12 * z**3
        size = size + c * (0.1 * z * z - 0.15 * x + 0.1 * x * y)
        frames.append(np.stack([20 * size * x, 26 * size * y, 40 * size * z * (1 - 0.1 * c)], 1))
    return np.array(frames)


def ring(angles: Floats) -> Floats:
    """A torus whose tube swells; columns are the angles in turns about tube and hole."""
    a, b = 2 * np.pi * angles.T
    frames = []
    for c in SQUEEZE:
        tube = 8 * (1 + 0.2 * np.cos(b) + 0.1 * np.sin(a) - 0.2 * c * np.cos(b - 1))
        core = 30 * (1 + 0.1 * np.cos(2 * b) + 0.08 * np.cos(b + 0.3) + 0.1 * c)
        lift = 2 * np.sin(b) * c + 1.5 * np.cos(a) ** 2
        out = core + tube * np.cos(a)
        frames.append(np.stack([out * np.cos(b), out * np.sin(b), tube * np.sin(a) + lift], 1))
    return np.array(frames)


def tube(places: Floats) -> Floats:
    """An open tube that narrows; columns are s and theta in turns."""
    s, b = places[:, 0], 2 * np.pi * places[:, 1]
    frames = []
    for c in SQUEEZE:
        wall = (15 + 8 * s + 2 * np.sin(3 * s)) * (1 + 0.1 * np.cos(b) * s)
        wall *= 1 - 0.2 * c * (1 - s / 2) + 0.05 * c * np.cos(2 * b)
        turned = b + 0.2 * c * s
        frames.append(
            np.stack(
                [wall * np.cos(turned) + 6 * s, wall * np.sin(turned), 60 * s * (1 - 0.1 * c)], 1
            )
        )
    return np.array(frames)


def sheet(places: Floats) -> Floats:
    """A curved sheet that flaps; columns are s and t."""
    s, t = places.T
    frames = []
    for c in SQUEEZE:
        lift = 6 * np.sin(3 * s) * t + 8 * c * np.sin(np.pi * s) * t + 3 * c * s
        frames.append(np.stack([60 * s * (1 + 0.1 * t), 36 * t * (1 + 0.15 * s), lift], 1))
    return np.array(frames)


# Triangulations, each of about `n` vertices, displaced at random by a share of their distance.


def sphere_points(n: int, rng: np.random.Generator, jitter: float = 0.2) -> Floats:
    rank = np.arange(n) + 0.5
    z, turn = 1 - 2 * rank / n, np.pi * (1 + 5**0.5) * rank
    r = np.sqrt(1 - z * z)
    points = np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=1)
    points += jitter * rng.normal(size=points.shape) * np.sqrt(4 * np.pi / n)
    unit: Floats = points / np.linalg.norm(points, axis=1, keepdims=True)
    return unit


def cup_points(n: int, rng: np.random.Generator, jitter: float = 0.2) -> tuple[Floats, Ints]:
    """The unit sphere below z = 0.35."""
    cut = 0.35
    n_sphere = int(n * 2 / (1 + cut))
    step, radius = np.sqrt(4 * np.pi / n_sphere), np.sqrt(1 - cut**2)
    inside = sphere_points(n_sphere, rng, jitter)
    inside = inside[inside[:, 2] < cut - 0.5 * step]
    n_rim = int(2 * np.pi * radius / step)
    turn = 2 * np.pi * (np.arange(n_rim) + rng.random()) / n_rim
    rim = np.stack([radius * np.cos(turn), radius * np.sin(turn), np.full(n_rim, cut)], axis=1)
    points = np.concatenate([inside, rim])
    # Seen from the north pole the surface is a disk, and Delaunay's rule keeps its meaning.
    faces = Delaunay(points[:, :2] / (1 - points[:, 2:])).simplices.astype(np.int64)
    on_rim = np.arange(len(points)) >= len(inside)
    return points, faces[~on_rim[faces].all(axis=1)]


def ring_points(n: int, rng: np.random.Generator, jitter: float = 0.2) -> tuple[Floats, Ints]:
    rows = int(np.sqrt(n / 3))
    columns = n // rows
    a = (np.arange(rows)[:, None] + 0.5 * (np.arange(columns) % 2)) / rows
    b = np.broadcast_to(np.arange(columns) / columns, a.shape)
    places = np.stack([a.ravel(), b.ravel()], axis=1)
    places += jitter * (rng.random(places.shape) - 0.5) / [rows, columns]
    return _periodic(places % 1.0, (1.0, 3.0), (True, True))


def tube_points(n: int, rng: np.random.Generator, jitter: float = 0.2) -> tuple[Floats, Ints]:
    columns = int(np.sqrt(n * 2))
    rows = n // columns
    s = np.repeat(np.linspace(0, 1, rows), columns).reshape(rows, columns)
    theta = (np.arange(columns)[None] + 0.5 * (np.arange(rows) % 2)[:, None]) / columns
    s = s + jitter * (rng.random(s.shape) - 0.5) / rows * ((s > 0) & (s < 1))
    theta = theta + jitter * (rng.random(s.shape) - 0.5) / columns
    places = np.stack([s.ravel(), theta.ravel() % 1.0], axis=1)
    places, faces = _periodic(places, (1.0, 2.0), (False, True))
    ends = (places[faces, 0] == 0).all(axis=1) | (places[faces, 0] == 1).all(axis=1)
    return places, faces[~ends]


def sheet_points(n: int, rng: np.random.Generator, jitter: float = 0.2) -> tuple[Floats, Ints]:
    rows = int(np.sqrt(n * 0.6))
    columns = n // rows
    axes = np.linspace(0, 1, columns), np.linspace(0, 1, rows)
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    free = (places > 0) & (places < 1)
    places = places + jitter * (rng.random(places.shape) - 0.5) * free / [columns, rows]
    return places, Delaunay(places * [1, 0.6]).simplices.astype(np.int64)


def _periodic(
    places: Floats, scale: tuple[float, float], closed: tuple[bool, bool]
) -> tuple[Floats, Ints]:
    n = len(places)
    copies = [(-1, 0, 1) if c else (0,) for c in closed]
    spread = np.concatenate([places + np.array([i, j]) for i in copies[0] for j in copies[1]])
    triangles = Delaunay(spread * scale).simplices
    centre = spread[triangles].mean(axis=1)
    kept = np.ones(len(triangles), dtype=np.bool_)
    for axis in (0, 1):
        if closed[axis]:
            kept &= (centre[:, axis] >= 0) & (centre[:, axis] < 1)
    return places, (triangles % n)[kept].astype(np.int64)


def make_ventricle(n: int, rng: np.random.Generator, jitter: float = 0.2) -> Moving:
    points, faces = cup_points(n, rng, jitter)
    return ventricle(points), faces


def make_blob(n: int, rng: np.random.Generator, jitter: float = 0.2) -> Moving:
    points = sphere_points(n, rng, jitter)
    return blob(points), ConvexHull(points).simplices.astype(np.int64)


def make_ring(n: int, rng: np.random.Generator, jitter: float = 0.2) -> Moving:
    places, faces = ring_points(n, rng, jitter)
    return ring(places), faces


def make_tube(n: int, rng: np.random.Generator, jitter: float = 0.2) -> Moving:
    places, faces = tube_points(n, rng, jitter)
    return tube(places), faces


def make_sheet(n: int, rng: np.random.Generator, jitter: float = 0.2) -> Moving:
    places, faces = sheet_points(n, rng, jitter)
    return sheet(places), faces


MAKERS: dict[str, Callable[..., Moving]] = {
    "cup": make_ventricle,
    "sphere": make_blob,
    "torus": make_ring,
    "cylinder": make_tube,
    "plane": make_sheet,
}
"""For each topology a surface of it that moves."""
