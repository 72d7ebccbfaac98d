"""The same ventricle's beat, recorded in another way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from template_remeshing import remeshed, subdivided

from modalmotion.classification import Model, classify
from modalmotion.mesh import lattice_faces
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.modes.topology import CUP
from modalmotion.signature.making import modal_signature
from modalmotion.simulate import (
    Acquisition,
    MotionClass,
    VentricleParameters,
    draw_parameters,
    simulate_ventricle,
)

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Recording:
    """One ventricle and how it is recorded; the same seed gives the same individual.

    Parameters
    ----------
    label : MotionClass
    parameters : VentricleParameters
    grid : (int, int)
    n_vertices : int or None
        Of a triangulation in place of the lattice.
    acquisition : Acquisition
    seed : int
    """

    label: MotionClass
    parameters: VentricleParameters
    grid: tuple[int, int]
    n_vertices: int | None
    acquisition: Acquisition
    seed: int

    def sequence(self, n_vertices: int | None = None, **changes: Any) -> MeshSequence:
        """Simulate it, with another triangulation or acquisition where one is given."""
        return simulate_ventricle(
            self.parameters,
            grid=self.grid,
            n_vertices=self.n_vertices if n_vertices is None else n_vertices,
            acquisition=replace(self.acquisition, **changes),
            rng=np.random.default_rng(self.seed),
        )


def draw_recording(label: MotionClass, rng: np.random.Generator, noise: float = 0.0) -> Recording:
    """Draw one: any severity, lattice or triangulation, 15 to 40 frames, half from any phase."""
    return Recording(
        label=label,
        parameters=draw_parameters(label, rng),
        grid=(int(rng.integers(12, 37)), 2 * int(rng.integers(12, 37))),
        n_vertices=int(rng.integers(500, 2001)) if rng.uniform() < 0.5 else None,
        acquisition=Acquisition(
            n_frames=int(rng.integers(15, 41)),
            start_phase=float(rng.choice([0.0, rng.uniform()])),
            noise=noise,
        ),
        seed=int(rng.integers(2**32)),
    )


Change = Callable[[Recording, MeshSequence, np.random.Generator], MeshSequence | None]


def _with(
    sequence: MeshSequence, vertices: NDArray[Any], faces: NDArray[np.int64] | None = None
) -> MeshSequence:
    if faces is None:
        return replace(sequence, vertices=vertices)
    return mesh_sequence(vertices, faces, topology=CUP, times=sequence.times, unit=sequence.unit)


def _turned(_: Recording, s: MeshSequence, rng: np.random.Generator) -> MeshSequence:
    return _with(s, s.vertices @ Rotation.random(random_state=rng).as_matrix().T)


def _moved(_: Recording, s: MeshSequence, rng: np.random.Generator) -> MeshSequence:
    return _with(s, s.vertices + rng.normal(0.0, 200.0, 3))


def _in_metres(_: Recording, s: MeshSequence, rng: np.random.Generator) -> MeshSequence:
    return replace(s, vertices=s.vertices / 1000.0, unit="m")


def _narrow(_: Recording, s: MeshSequence, rng: np.random.Generator) -> MeshSequence:
    return _with(s, s.vertices.astype(np.float32))


def _start_angle(_: Recording, s: MeshSequence, rng: np.random.Generator) -> MeshSequence | None:
    if s.grid is None:
        return None
    nodes = s.vertices.reshape(s.n_frames, *s.grid, 3)
    by = int(rng.integers(1, s.grid[1]))
    return _with(s, np.roll(nodes, by, axis=2).reshape(s.vertices.shape))


def _vertex_order(_: Recording, s: MeshSequence, rng: np.random.Generator) -> MeshSequence | None:
    if s.grid is not None:
        return None
    order = rng.permutation(s.n_vertices)
    return _with(s, s.vertices[:, order], np.argsort(order)[s.faces])


def _start_frame(_: Recording, s: MeshSequence, rng: np.random.Generator) -> MeshSequence:
    return _with(s, np.roll(s.vertices, int(rng.integers(1, s.n_frames)), axis=0))


def _first_again(_: Recording, s: MeshSequence, rng: np.random.Generator) -> MeshSequence:
    assert s.times is not None
    period = s.times[-1] * s.n_frames / (s.n_frames - 1)
    vertices = np.concatenate([s.vertices, s.vertices[:1]])
    return replace(s, vertices=vertices, times=np.append(s.times, period))


def _frames_between(_: Recording, s: MeshSequence, rng: np.random.Generator) -> MeshSequence:
    """Twice the frames, by the trigonometric polynomial through those that are there."""
    assert s.times is not None
    n = s.n_frames
    spectrum = np.fft.rfft(s.vertices, axis=0)
    if n % 2 == 0:
        spectrum[-1] /= 2
    vertices = 2 * np.fft.irfft(spectrum, 2 * n, axis=0)
    return replace(s, vertices=vertices, times=np.arange(2 * n) * s.times[1] / 2)


def _start_phase(r: Recording, s: MeshSequence, rng: np.random.Generator) -> MeshSequence:
    return r.sequence(start_phase=r.acquisition.start_phase + rng.uniform())


def _frame_rate(r: Recording, s: MeshSequence, rng: np.random.Generator) -> MeshSequence:
    return r.sequence(n_frames=2 * r.acquisition.n_frames)


def _in_four(_: Recording, s: MeshSequence, rng: np.random.Generator) -> MeshSequence | None:
    if s.grid is not None:
        return None
    return _with(s, *subdivided((s.vertices.astype(np.float64), s.faces)))


def _remeshed(_: Recording, s: MeshSequence, rng: np.random.Generator) -> MeshSequence | None:
    if s.grid is not None:
        return None
    moving = s.vertices.astype(np.float64), s.faces
    return _with(s, *remeshed(moving, s.n_vertices, rng))


def _another_mesh(r: Recording, s: MeshSequence, rng: np.random.Generator) -> MeshSequence | None:
    if r.n_vertices is None:
        return None
    return r.sequence(n_vertices=int(r.n_vertices * rng.uniform(1.2, 2.0)))


def _lattice_as_mesh(
    _: Recording, s: MeshSequence, rng: np.random.Generator
) -> MeshSequence | None:
    """The triangles of a lattice, its hole at the apex closed by a fan about one vertex more."""
    if s.grid is None:
        return None
    columns, n = s.grid[1], s.n_vertices
    ring = np.arange(columns)
    fan = np.stack([np.full(columns, n), np.roll(ring, -1), ring], axis=1)
    first, second = s.vertices[:, :columns].mean(axis=1), s.vertices[:, columns : 2 * columns]
    apex = first + (first - second.mean(axis=1)) / 8
    vertices = np.concatenate([s.vertices, apex[:, None]], axis=1)
    return _with(s, vertices, np.concatenate([lattice_faces(CUP, s.grid), fan]))


EXACT: Final[dict[str, Change]] = {
    "turned": _turned,
    "moved": _moved,
    "in metres": _in_metres,
    "float32": _narrow,
    "start angle": _start_angle,
    "order of vertices": _vertex_order,
    "another first frame": _start_frame,
    "first frame repeated at the end": _first_again,
    "twice the frames, interpolated": _frames_between,
}
"""The same data, written in another way."""

RESAMPLED: Final[dict[str, Change]] = {
    "start at any phase": _start_phase,
    "twice the frames, recorded": _frame_rate,
    "each triangle in four": _in_four,
    "another mesh on the same triangles": _remeshed,
    "another mesh of the same ventricle": _another_mesh,
    "lattice as triangles": _lattice_as_mesh,
}
"""The same motion, sampled at other points or times."""

OTHER_COORDINATES: Final = ("lattice as triangles",)
"""Of these, changes of the surface's coordinates: a lattice's rows lie where its sender says."""


@dataclass(frozen=True, eq=False)
class Answer:
    """What a model says before it asks whether it may.

    Parameters
    ----------
    probabilities : (classes,) float64
    features : (features,) float64
    names : tuple of str
    label : str or None
        After it has asked.
    """

    probabilities: Floats
    features: Floats
    names: tuple[str, ...]
    label: str | None


def answer(sequence: MeshSequence, model: Model) -> Answer:
    """Ask a model."""
    signature = modal_signature(sequence, model.signature_parameters)
    found = model.read(signature)
    features = found.values[model.distance(model.domain.reader.read(signature).kinds).argmin()]
    probabilities = model.probabilities(features[None])[0]
    return Answer(probabilities, features, found.names, classify(signature, model).label)
