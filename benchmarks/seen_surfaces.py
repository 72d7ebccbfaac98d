"""Surfaces that are known in every frame, and what of them is seen: points, strays, holes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import modalmotion as mm
from modalmotion.mesh import cavity_of, face_normals, vertex_areas
from modalmotion.mesh.geometry import vertex_normals
from modalmotion.mesh.sequence import standard_surface
from modalmotion.simulate import MotionClass, Pose, draw_parameters
from modalmotion.simulate.surface import random_rotation
from modalmotion.tracking import Observation, of_surface

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
PHASES = np.arange(6) / 6

Cases = Iterable[tuple["Truth", np.random.Generator]]
Seen = tuple["Truth", list[list[Observation]]]


@dataclass(frozen=True)
class Truth:
    """A surface that is known in every frame, with the vertices of its ends."""

    vertices: Floats
    faces: Ints
    ends: tuple[tuple[int, ...], ...] = ()
    grid: tuple[int, ...] | None = None  # of a ventricle's lattice, whose rows follow the tissue

    @staticmethod
    def of(sequence: mm.MeshSequence, every: int = 1) -> Truth:
        """Take the apex and the middle of each opening as ends; none of a closed surface."""
        template = mm.make_template(sequence)
        openings = cavity_of(template.faces, template.n_vertices).openings
        ends: list[tuple[int, ...]] = []
        if openings:
            s = template.coordinates[:, 0]
            rims = [np.unique(edges) for edges in openings]
            ends = [tuple(np.flatnonzero(s <= s.min() + 1e-9).tolist())]
            ends += [tuple(rim.tolist()) for rim in rims if s[rim].mean() > 0.5]
        x = sequence.vertices[::every].astype(np.float64)
        return Truth(x, template.faces, tuple(ends), sequence.grid)

    @property
    def volumes(self) -> Floats:
        """Of each frame."""
        return np.abs(cavity_of(self.faces, self.vertices.shape[1]).volume(self.vertices))

    @property
    def ejection_fraction(self) -> float:
        """Share of the largest volume that is lost, percent."""
        return float(100.0 * (1.0 - self.volumes.min() / self.volumes.max()))

    def start(self) -> mm.MeshSequence:
        """Return the surface of frame 0."""
        topology = "cup" if len(self.ends) == 2 else None
        return mm.mesh_sequence(self.vertices[:1], self.faces, topology=topology, unit="mm")

    def seen(
        self,
        n: int,
        noise: float,
        rng: np.random.Generator,
        strays: float = 0.0,
        unseen: float = 0.0,
        has_start: bool = True,
    ) -> list[list[Observation]]:
        """Random points of each frame and the landmarks, of vertices or of ends, with noise.

        A share `strays` of them fills the space around; a share `unseen` of the surface, one patch
        of the same tissue in all frames, has none.
        """
        hidden, frames = self._patch(unseen, rng), []
        faces = self.faces[~hidden[self.faces].any(axis=1)]
        for x in self.vertices:
            cloud = sampled(x, faces, n, rng) + rng.normal(0.0, noise, (n, 3))
            k = round(strays * n)
            cloud[:k] = rng.uniform(cloud.min(axis=0) - 10, cloud.max(axis=0) + 10, (k, 3))
            frames.append([Observation(cloud), *self._marks(x, noise, rng, has_start=has_start)])
        return frames

    def remeshed(self, rng: np.random.Generator) -> list[list[Observation]]:
        """Each frame with other vertices and other triangles, in an order of its own."""
        frames = []
        for x in self.vertices:
            middles = x[self.faces].mean(axis=1)[rng.permutation(len(self.faces))]
            marks = self._marks(x, 0.0, rng, has_start=True)
            frames.append([Observation(middles), of_surface(x, self.faces), *marks])
        return frames

    def _marks(
        self, x: Floats, noise: float, rng: np.random.Generator, *, has_start: bool
    ) -> Iterator[Observation]:
        for name, end in zip(("apex", "base"), self.ends, strict=False):
            # A ring around the apex is one place of it.
            own = end[:1] if has_start and name == "apex" else end
            sd = max(noise / len(own) ** 0.5, 0.1)
            place = x[list(own)].mean(axis=0) + rng.normal(0.0, sd, 3)
            yield Observation(place[None], sd=sd, places=(own if has_start else name,))

    def _patch(self, share: float, rng: np.random.Generator) -> NDArray[np.bool_]:
        """Choose the vertices next to one of them, drawn by area, that have so much of it all."""
        hidden = np.zeros(self.vertices.shape[1], dtype=np.bool_)
        if share > 0:
            x = self.vertices[0]
            areas = vertex_areas(x, self.faces)
            spot = x[rng.choice(len(x), p=areas / areas.sum())]
            order = np.argsort(np.linalg.norm(x - spot, axis=1))
            hidden[order[np.cumsum(areas[order]) < share * areas.sum()]] = True
        return hidden


def seen_clouds(cases: Cases, noise: float, **seen: Any) -> Iterator[Seen]:
    """See 2,000 points of each frame of all; see `Truth.seen`."""
    for truth, rng in cases:
        yield truth, truth.seen(2000, noise, rng, **seen)


def in_turn(
    seed: int, first: int, n: int
) -> Iterator[tuple[mm.VentricleParameters, np.random.Generator]]:
    """Draw ventricles whose classes take turns, each with random numbers of its own."""
    for k in range(n):
        rng = np.random.default_rng([seed, first + k])
        yield draw_parameters(list(MotionClass)[k % len(MotionClass)], rng), rng


def ventricles(seed: int, n: int) -> Cases:
    """Simulate ventricles in any pose."""
    for parameters, rng in in_turn(seed, 0, n):
        acquisition = mm.Acquisition(n_frames=len(PHASES), pose=Pose(rotation=random_rotation(rng)))
        one = mm.simulate_ventricle(parameters, grid=(24, 48), acquisition=acquisition, rng=rng)
        yield Truth.of(one), rng


def dented(seed: int, n: int) -> Cases:
    """Simulate ventricles with dents that come and go in a beat, finer than usual modes."""
    for truth, rng in ventricles(seed, n):
        x, share = truth.vertices, np.sin(np.pi * PHASES)
        spots = x[0][rng.integers(x.shape[1], size=4)]
        depths = np.exp(-((x[0][:, None] - spots) ** 2).sum(axis=2) / 2 / 6.0**2).sum(axis=1)
        inward = -4.0 * depths[:, None] * vertex_normals(x[0], truth.faces)
        yield replace(truth, vertices=x + share[:, None, None] * inward), rng


def quartered(seed: int, n: int) -> Cases:
    """Make closed surfaces, no ellipsoids: each quarter has its own width, profile and motion."""
    base = standard_surface(mm.Lattice(mm.SPHERE, (24, 48)))
    unit = base.vertices[0] / np.linalg.norm(base.vertices[0], axis=1, keepdims=True)
    turns, height = np.arctan2(unit[:, 1], unit[:, 0]), np.clip(np.abs(unit[:, 2]), 0.0, 1.0)
    for k in range(n):
        rng = np.random.default_rng([seed, 1000 + k])
        away = turns[:, None] - np.pi / 2 * np.arange(4) - rng.uniform(0.0, 7.0)
        quarters = np.exp(3.0 * np.cos(away))
        quarters /= quarters.sum(axis=1, keepdims=True)
        width = quarters @ rng.uniform(18.0, 28.0, 4)
        power = quarters @ rng.uniform(1.7, 2.8, 4)
        less, late = quarters @ rng.uniform(0.08, 0.26, 4), quarters @ rng.uniform(-0.06, 0.06, 4)
        profile = width * np.maximum(1.0 - height**power, 0.0) ** (1.0 / power)
        length, phase = rng.uniform(30.0, 45.0), PHASES[:, None]
        radius = profile * (1.0 - less * (0.5 - 0.5 * np.cos(2 * np.pi * (phase - late))))
        axial = length * (1.0 - 0.1 * (0.5 - 0.5 * np.cos(2 * np.pi * phase))) * unit[:, 2]
        frames = np.stack([radius * np.cos(turns), radius * np.sin(turns), axial], axis=2)
        yield Truth(frames, base.faces), rng


def sampled(x: Floats, faces: Ints, n: int, rng: np.random.Generator) -> Floats:
    """Draw points evenly from a surface."""
    areas = np.linalg.norm(face_normals(x, faces), axis=1)
    corners = x[faces[rng.choice(len(faces), n, p=areas / areas.sum())]]
    points: Floats = (rng.dirichlet(np.ones(3), n)[:, :, None] * corners).sum(axis=1)
    return points
