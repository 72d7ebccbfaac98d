"""Recordings that are no ventricle's beat, of many kinds, drawn at random.

What a model of ventricles is to give no class to.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from project import DATA
from scipy.spatial.transform import Rotation

from modalmotion.formats import read_sequence
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.modes.topologies import CYLINDER
from modalmotion.simulate import Acquisition, MotionClass, draw_parameters, simulate_ventricle

Floats = NDArray[np.float64]
Draw = Callable[[np.random.Generator], MeshSequence]


_FEWEST, _MOST = 10, 40


def resting(rng: np.random.Generator) -> MeshSequence:
    """One ventricle that does not move: a lattice, as cup or cylinder, or a triangulation."""
    parameters = draw_parameters(list(MotionClass)[int(rng.integers(5))], rng)
    kind = rng.integers(4)
    one = simulate_ventricle(
        parameters,
        grid=(int(rng.integers(12, 30)), 2 * int(rng.integers(12, 30))),
        n_vertices=int(rng.integers(500, 1500)) if kind < 2 else None,
        acquisition=Acquisition(n_frames=1),
        rng=rng,
    )
    return replace(one, topology=CYLINDER) if kind == 2 else one


def moving(shape: MeshSequence, vertices: Floats) -> MeshSequence:
    """A shape on other paths, one beat long."""
    times = np.arange(len(vertices)) / len(vertices)
    return mesh_sequence(
        vertices,
        shape.faces,
        grid=shape.grid,
        topology=shape.topology,
        times=times,
        unit=shape.unit,
    )


def _frames(rng: np.random.Generator) -> int:
    return int(rng.integers(_FEWEST, _MOST + 1))


def _still(shape: MeshSequence, n_frames: int) -> Floats:
    return np.repeat(shape.vertices.astype(np.float64), n_frames, axis=0)


def _shaken(vertices: Floats, most: float, rng: np.random.Generator) -> Floats:
    noise: Floats = rng.normal(0.0, rng.uniform(0.0, most), vertices.shape)
    return vertices + noise


def static(rng: np.random.Generator) -> MeshSequence:
    """Nothing moves, but for jitter of up to 1 mm, or the dust of float32 far from the origin."""
    shape = resting(rng)
    x = _still(shape, _frames(rng))
    if rng.uniform() < 0.4:
        far = (x + rng.normal(0.0, 1e4, 3)).astype(np.float32)
        return moving(shape, np.asarray(far + rng.choice([0.0, 1e-3], far.shape)))
    return moving(shape, x if rng.uniform() < 0.2 else _shaken(x, 1.0, rng))


def noise(rng: np.random.Generator) -> MeshSequence:
    """Each vertex in each frame anywhere near its place, 0.3 to 20 mm."""
    shape = resting(rng)
    x = _still(shape, _frames(rng))
    return moving(shape, x + 10 ** rng.uniform(-0.5, 1.3) * rng.standard_normal(x.shape))


def smooth_noise(rng: np.random.Generator) -> MeshSequence:
    """A field that is smooth over the surface, and new in each frame."""
    shape = resting(rng)
    n = _frames(rng)
    fields = _smooth_fields(shape, n, rng)
    return moving(shape, _still(shape, n) + rng.uniform(1.0, 10.0) * fields)


def rotating(rng: np.random.Generator) -> MeshSequence:
    """About any axis: steadily, to and fro, whole turns or by chance; up to 1 mm of noise."""
    shape = resting(rng)
    n = _frames(rng)
    return moving(shape, _shaken(_turned(shape, n, rng), 1.0, rng))


def _turned(shape: MeshSequence, n: int, rng: np.random.Generator) -> Floats:
    phase = np.arange(n) / n
    angle = [
        rng.uniform(-7.0, 7.0) * phase,
        rng.uniform(0.1, 3.0) * np.sin(2 * np.pi * (phase + rng.uniform())),
        2 * np.pi * rng.integers(1, 4) * phase,
        rng.uniform(0.05, 1.0) * np.cumsum(rng.standard_normal(n)),
    ][int(rng.integers(4))]
    axis = rng.standard_normal(3)
    turns = Rotation.from_rotvec(angle[:, None] * axis / np.linalg.norm(axis)).as_matrix()
    about = shape.vertices[0].mean(axis=0) + rng.normal(0.0, 30.0, 3)
    turned: Floats = np.einsum("fij,nj->fni", turns, shape.vertices[0] - about) + about
    return turned


def translating(rng: np.random.Generator) -> MeshSequence:
    """As a whole, along a straight line or any path; up to 1 mm of noise."""
    shape = resting(rng)
    n = _frames(rng)
    path = rng.uniform(1.0, 20.0) * np.cumsum(rng.standard_normal((n, 3)), axis=0)
    if rng.uniform() < 0.5:
        path = np.arange(n)[:, None] * rng.normal(0.0, 3.0, 3)
    return moving(shape, _shaken(_still(shape, n) + path[:, None], 1.0, rng))


def jumping(rng: np.random.Generator) -> MeshSequence:
    """At rest, but in one frame bent out of shape by 3 to 15 mm."""
    shape = resting(rng)
    n = _frames(rng)
    x = _still(shape, n)
    x[int(rng.integers(n))] += rng.uniform(3.0, 15.0) * _smooth_fields(shape, 1, rng)[0]
    return moving(shape, _shaken(x, 0.5, rng))


def breathing(rng: np.random.Generator) -> MeshSequence:
    """Larger and smaller in all directions alike, by 3 to 25 %."""
    shape = resting(rng)
    n = _frames(rng)
    growth = rng.uniform(0.03, 0.25) * np.sin(2 * np.pi * (np.arange(n) / n + rng.uniform()))
    x = _still(shape, n)
    middle = x[0].mean(axis=0)
    return moving(shape, _shaken(middle + (x - middle) * (1 + growth)[:, None, None], 0.6, rng))


def waves(rng: np.random.Generator) -> MeshSequence:
    """A ring of constriction that travels along a tube, as in a gut."""
    shape, s, outward, axis = _tube(rng)
    n = _frames(rng)
    phase = np.arange(n) / n
    runs = rng.integers(1, 4) * rng.choice([-1.0, 1.0])
    length = rng.uniform(0.5, 2.5)
    wave = np.sin(2 * np.pi * (length * s - runs * phase[:, None]))
    pulled = rng.uniform(2.0, 8.0) * wave[:, :, None] * outward
    along = rng.uniform(0.0, 3.0) * np.cos(2 * np.pi * (length * s - runs * phase[:, None]))
    x = shape.vertices[0] + pulled + along[:, :, None] * axis
    return moving(shape, _shaken(x, 0.6, rng))


def bending(rng: np.random.Generator) -> MeshSequence:
    """A tube that sways from side to side, or whose free end goes round."""
    shape, s, _, axis = _tube(rng)
    n = _frames(rng)
    phase = 2 * np.pi * (np.arange(n) / n)
    a, b = _across(axis)
    sway = np.cos(phase)[:, None] * a
    sway += rng.choice([0.0, 1.0]) * np.sin(phase + rng.normal(0.0, 0.3))[:, None] * b
    lean = rng.uniform(5.0, 25.0) * (s**2)[None, :, None] * sway[:, None]
    return moving(shape, _shaken(shape.vertices[0] + lean, 0.6, rng))


def swaying(rng: np.random.Generator) -> MeshSequence:
    """A few smooth random fields, each at its own phase of one or two turns a recording."""
    shape = resting(rng)
    n = _frames(rng)
    x = _still(shape, n)
    for field in _smooth_fields(shape, int(rng.integers(2, 5)), rng):
        phase = int(rng.integers(1, 3)) * np.arange(n) / n + rng.uniform()
        x += rng.uniform(2.0, 6.0) * np.sin(2 * np.pi * phase)[:, None, None] * field
    return moving(shape, _shaken(x, 0.6, rng))


def shuffled(rng: np.random.Generator) -> MeshSequence:
    """A ventricle's frames in any order."""
    beat = _beat(rng)
    return replace(beat, vertices=beat.vertices[rng.permutation(beat.n_frames)])


def _beat(rng: np.random.Generator) -> MeshSequence:
    return simulate_ventricle(
        draw_parameters(list(MotionClass)[int(rng.integers(5))], rng),
        grid=(20, 40),
        acquisition=Acquisition(n_frames=_frames(rng), noise=0.6),
        rng=rng,
    )


def _smooth_fields(shape: MeshSequence, count: int, rng: np.random.Generator) -> Floats:
    """Fields of RMS 1 over the surface, smooth on the scale of half of it."""
    x = shape.vertices[0].astype(np.float64)
    x = (x - x.mean(axis=0)) / x.std()
    waves = rng.normal(0.0, 0.8, (count, 12, 3))
    phases = rng.uniform(0.0, 2 * np.pi, (count, 12))
    sizes = rng.standard_normal((count, 12, 3))
    fields: Floats = np.cos(waves @ x.T + phases[:, :, None]).transpose(0, 2, 1) @ sizes
    fields /= np.sqrt((fields**2).sum(axis=2).mean(axis=1))[:, None, None]
    return fields


def _tube(rng: np.random.Generator) -> tuple[MeshSequence, Floats, Floats, Floats]:
    """A tube as a lattice; how far along each node is, which way is out, and its axis."""
    rows, columns = int(rng.integers(10, 30)), 2 * int(rng.integers(8, 24))
    radius, length = rng.uniform(10.0, 25.0), rng.uniform(60.0, 120.0)
    s, turn = (
        grid.ravel()
        for grid in np.meshgrid(
            (np.arange(rows) + 0.5) / rows,
            2 * np.pi * np.arange(columns) / columns,
            indexing="ij",
        )
    )
    outward = np.stack([np.cos(turn), np.sin(turn), np.zeros_like(s)], axis=1)
    topology = str(rng.choice(["cylinder", "cup"]))
    width = radius * (np.sin(np.pi * s / 2) ** 0.7 if topology == "cup" else np.ones_like(s))
    x = width[:, None] * outward + (length * s)[:, None] * [0.0, 0.0, 1.0]
    turned = Rotation.random(random_state=rng).as_matrix()
    shape = mesh_sequence((x @ turned.T)[None], grid=(rows, columns), topology=topology, unit="mm")
    return shape, s, outward @ turned.T, turned[:, 2]


def _across(axis: Floats) -> tuple[Floats, Floats]:
    first, second = np.linalg.svd(axis[None])[2][1:]
    return first, second


FLAGGED: Final[dict[str, Draw]] = {
    "static": static,
    "noise of vertices": noise,
    "noise, smooth over the surface": smooth_noise,
    "rotation only": rotating,
    "translation only": translating,
    "one frame out of shape": jumping,
    "wave along a tube": waves,
    "bending tube": bending,
    "smooth random motion": swaying,
    "breathing": breathing,
    "frames shuffled": shuffled,
}
"""Kinds that get no class."""


def figures(name: str, folder: Path = DATA) -> list[MeshSequence]:
    """Windows of the named motions of a figure, "fox" or "robot"; none where they are absent."""
    found = []
    for path in sorted((folder / name).glob("*.npz")):
        sequence = read_sequence(path).sequence
        length = min(24, sequence.n_frames)
        for start in range(0, sequence.n_frames - length + 1, max(1, length // 3)):
            part = sequence.vertices[start : start + length]
            found.append(replace(sequence, vertices=part, times=None))
    return found
