"""Moving surfaces whose positions without noise are known, and noise of several kinds on them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any, Final

import numpy as np
from mixed_noise import with_noise
from numpy.typing import NDArray
from real_data import recording
from scipy.spatial import ConvexHull

import modalmotion as mm
from modalmotion.mesh import lattice_faces
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.signature.fit import make_basis
from modalmotion.template import choose_modes, make_template

Floats = NDArray[np.float64]
Rng = np.random.Generator
INDIVIDUAL: Final = mm.VentricleParameters(shape_variation=2.0, motion_variation=2.0)


def individual(
    rng: Rng, n_vertices: int = 1500, grid: tuple[int, int] | None = None, n_frames: int = 25
) -> MeshSequence:
    """Simulate a ventricle with a shape and a motion of its own, triangulated without a grid."""
    mesh: dict[str, Any] = {"grid": grid} if grid else {"n_vertices": n_vertices}
    frames = mm.Acquisition(n_frames=n_frames)
    return mm.simulate_ventricle(INDIVIDUAL, acquisition=frames, rng=rng, **mesh)


@cache
def smoothed(name: str) -> MeshSequence:
    """Limit a recording to 60 modes and few harmonics of its own, so that it holds no noise."""
    recorded = recording(name)
    x = recorded.vertices.astype(np.float64)
    n_frames = len(x)
    template = make_template(recorded)
    basis = make_basis(template, choose_modes(template, 60)[0])
    turns = 2 * np.pi * np.arange(n_frames) / n_frames
    n_waves = min(6, (n_frames - 2) // 4)
    waves = [f(p * turns) for p in range(1, n_waves + 1) for f in (np.cos, np.sin)]
    # A line too: not every recording is a cycle.
    time = np.linalg.qr(np.stack([np.ones(n_frames), turns, *waves], axis=1))[0]
    coefficients = np.einsum("mv,fvd->fmd", basis.projector, x - x[0])
    u = np.einsum("vm,fk,gk,gmd->fvd", basis.shapes, time, time, coefficients, optimize=True)
    return replace(recorded, vertices=x[0] + u)


def closed_body(rng: Rng, bend: float = 0.0, n_vertices: int = 1500) -> Floats:
    """Draw a long closed body with smooth lumps, bent by `bend` per mm, its faces `hull()`."""
    p = _directions(n_vertices)
    x = p * (25.0, 22.0, 40.0)
    x[:, 0] += bend * x[:, 2] ** 2
    waves, phases = rng.normal(0.0, 1.5, (6, 3)), rng.uniform(0.0, 2 * np.pi, 6)
    lumps = 2.0 * np.cos(p @ waves.T + phases) @ rng.standard_normal(6)
    return np.asarray(x + lumps[:, None] * p)


@cache
def hull(n_vertices: int = 1500) -> NDArray[np.int64]:
    """Triangles of `closed_body`, wound outward."""
    p = _directions(n_vertices)
    faces: NDArray[np.int64] = ConvexHull(p).simplices.astype(np.int64)
    a, b, c = (p[faces[:, k]] for k in range(3))
    inward = np.einsum("fd,fd->f", np.cross(b - a, c - a), a + b + c) < 0
    faces[inward] = faces[inward, ::-1]
    return faces


def moving_body(rng: Rng, n_frames: int = 20) -> MeshSequence:
    """Let a pear with a bulge on one side beat, one end more than the other."""
    x = closed_body(rng)
    x[:, :2] *= 1.0 + 0.004 * x[:, 2:]
    x[:, 0] += 8.0 * np.exp(-np.sum((x - (25.0, 0.0, 10.0)) ** 2, axis=1) / 300.0)
    return _beating(x, hull(), rng, n_frames)


def moving_tube(rng: Rng, n_frames: int = 20) -> MeshSequence:
    """Let a conical tube with a bulge beat; nothing states that it is a lattice."""
    shape = (24, 40)
    along, around = np.meshgrid(*((np.arange(n) + 0.5) / n for n in shape), indexing="ij")
    turn = 2 * np.pi * around
    bulge = np.exp(-2.0 * (1.0 - np.cos(turn - 0.5)) - 8.0 * (along - 0.3) ** 2)
    r = 26.0 - 9.0 * along + 7.0 * bulge + np.cos(2 * turn + rng.uniform(0, 6))
    x = np.stack([r * np.cos(turn), 0.8 * r * np.sin(turn), 90 * along], axis=2).reshape(-1, 3)
    return _beating(x, lattice_faces(mm.CYLINDER, shape), rng, n_frames)


def drawn_noise(clean: MeshSequence, rng: Rng) -> tuple[float, MeshSequence]:
    """Draw size and kind of the noise too; its RMS, and the noisy surface."""
    sigma = float(rng.choice([0.2, 0.6, 1.5]))
    n_mixings, between = int(rng.choice([0, 0, 1, 5, 20])), float(rng.choice([0.0, 0.0, 0.5, 0.9]))
    return sigma, with_noise(clean, sigma, rng, mixed=n_mixings, correlation=between)


def _directions(n: int) -> Floats:
    """Spread unit vectors evenly along a spiral."""
    k = np.arange(n) + 0.5
    height, turn = 1 - 2 * k / n, np.pi * (3 - np.sqrt(5)) * k
    radius = np.sqrt(1 - height**2)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), height], axis=1)


def _beating(x: Floats, faces: NDArray[np.int64], rng: Rng, n_frames: int) -> MeshSequence:
    phases = 2 * np.pi * np.arange(n_frames) / n_frames
    share = (x[:, 2] - x[:, 2].min()) / np.ptp(x[:, 2])
    inward = 0.1 + 0.15 * share * rng.uniform(0.5, 1.5)
    swing = 4.0 * np.stack([np.cos(2.5 * share), share**2, 0.2 * share], axis=1)
    u = [(1 - np.cos(p)) / 2 * -inward[:, None] * x + np.sin(p) * swing for p in phases]
    return mesh_sequence(x + np.stack(u), faces, unit="mm")
