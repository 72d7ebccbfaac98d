"""Points of surfaces, as a scanner sees them: without order, with noise."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray

from modalmotion.mesh import face_normals
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence, standard_surface
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import SPHERE
from modalmotion.tracking import Observation
from modalmotion.tracking.closest import closest_points

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def sampled(x: Floats, faces: Ints, n: int, rng: np.random.Generator, noise: float = 0.0) -> Floats:
    """Points spread over a surface by area, each coordinate with noise."""
    areas = np.linalg.norm(face_normals(x, faces), axis=1)
    corners = x[faces[rng.choice(len(faces), n, p=areas / areas.sum())]]
    u = rng.dirichlet(np.ones(3), n)
    points: Floats = (u[:, :, None] * corners).sum(axis=1) + rng.normal(0.0, noise, (n, 3))
    return points


def rms_distance(points: Floats, x: Floats, faces: Ints) -> float:
    found = closest_points(points, x, faces)
    return float(np.sqrt((found.distances**2).mean()))


def ends_of(x: Floats, s: Floats, rim: Ints) -> tuple[Observation, Observation]:
    """Landmarks of a cup: the vertex nearest to the apex and the middle of the opening."""
    apex = int(s.argmin())
    return (
        Observation(x[[apex]], places=(apex,)),
        Observation(x[rim].mean(axis=0)[None], places=(tuple(rim.tolist()),)),
    )


def rim_of(faces: Ints, s: Floats) -> Ints:
    """Vertices of the openings away from the pole of a cup."""
    sides = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    sides, counts = np.unique(sides, axis=0, return_counts=True)
    rim = np.unique(sides[counts == 1])
    openings: Ints = rim[s[rim] > 0.5]
    return openings


def breathing_spheroid(n_frames: int = 6, bend: float = 0.0) -> MeshSequence:
    """A closed spheroid of 22 x 25 x 40 mm that contracts by a fifth, bent if so wished."""
    base = standard_surface(Lattice(SPHERE, (20, 32)))
    x = base.vertices[0] * np.array([25.0, 22.0, 40.0])
    x[:, 0] += bend * x[:, 2] ** 2
    phase = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(n_frames) / n_frames)
    shrink = 1.0 - phase[:, None] * np.array([0.2, 0.16, 0.1])
    return mesh_sequence(x * shrink[:, None], base.faces, unit="mm")


def as_npz(clouds: list[Floats], **more: object) -> bytes:
    """Write clouds of all frames as one file."""
    buffer = io.BytesIO()
    offsets = np.cumsum([0, *map(len, clouds)])
    np.savez(buffer, points=np.concatenate(clouds), offsets=offsets, **more)  # type: ignore[arg-type]
    return buffer.getvalue()


def small_recording(n_frames: int = 4, seed: int = 0) -> bytes:
    """Clouds of a spheroid that contracts, few enough to be tracked in a moment."""
    beat, rng = breathing_spheroid(n_frames), np.random.default_rng(seed)
    return as_npz([sampled(x, beat.faces, 80, rng, 0.3) for x in beat.vertices], unit="mm")
