"""Surfaces that are known in every frame, what is seen of them, and errors of tracks."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from modalmotion.mesh import cavity_of, face_normals
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.template import make_template
from modalmotion.tracking import Observation, Track
from modalmotion.tracking.closest import closest_points

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Truth:
    """A surface that is known in every frame, with the landmarks of its ends."""

    vertices: Floats
    faces: Ints
    ends: tuple[tuple[int, ...], ...]

    @staticmethod
    def of(sequence: MeshSequence) -> Truth:
        """Take the apex and the middle of each opening as landmarks; none of a closed surface."""
        template = make_template(sequence)
        cavity = cavity_of(template.faces, template.n_vertices)
        ends: list[tuple[int, ...]] = []
        if cavity.openings:
            s = template.coordinates[:, 0]
            rims = [np.unique(edges) for edges in cavity.openings]
            ends = [(int(s.argmin()),)]
            ends += [tuple(rim.tolist()) for rim in rims if s[rim].mean() > 0.5]
        return Truth(sequence.vertices.astype(np.float64), template.faces, tuple(ends))

    def seen(
        self, n: int, noise: float, rng: np.random.Generator, strays: float = 0.0
    ) -> list[list[Observation]]:
        """Random points of each frame, and the landmarks, with noise."""
        frames = []
        for x in self.vertices:
            cloud = sampled(x, self.faces, n, rng) + rng.normal(0.0, noise, (n, 3))
            k = round(strays * n)
            cloud[:k] = rng.uniform(cloud.min(axis=0) - 10, cloud.max(axis=0) + 10, (k, 3))
            frames.append([Observation(cloud)])
            for end in self.ends:
                sd = max(noise / len(end) ** 0.5, 0.1)
                place = x[list(end)].mean(axis=0) + rng.normal(0.0, noise / len(end) ** 0.5, 3)
                frames[-1].append(Observation(place[None], sd=sd, places=(end,)))
        return frames

    def start(self) -> MeshSequence:
        """Return the surface of frame 0."""
        return mesh_sequence(self.vertices[:1], self.faces, unit="mm")

    @property
    def ejection_fraction(self) -> float:
        """Percent."""
        return ejection_fraction(self.vertices, self.faces)


def ejection_fraction(vertices: Floats, faces: Ints) -> float:
    """Share of the largest volume that is lost, percent."""
    v = np.abs(cavity_of(faces, vertices.shape[1]).volume(vertices))
    return float(100.0 * (1.0 - v.min() / v.max()))


def sampled(x: Floats, faces: Ints, n: int, rng: np.random.Generator) -> Floats:
    areas = np.linalg.norm(face_normals(x, faces), axis=1)
    corners = x[faces[rng.choice(len(faces), n, p=areas / areas.sum())]]
    points: Floats = (rng.dirichlet(np.ones(3), n)[:, :, None] * corners).sum(axis=1)
    return points


def surface_distance(x: Floats, faces: Ints, y: Floats, others: Ints) -> tuple[float, float]:
    """Mean distance and 95 % Hausdorff distance of two surfaces, both ways."""
    rng = np.random.default_rng(0)
    one = closest_points(sampled(x, faces, 4000, rng), y, others).distances
    two = closest_points(sampled(y, others, 4000, rng), x, faces).distances
    hausdorff = max(float(np.quantile(d, 0.95)) for d in (one, two))
    return float(one.mean() + two.mean()) / 2, hausdorff


@dataclass(frozen=True)
class Score:
    """Errors of a track against what is known."""

    mean: float
    hausdorff: float
    fraction: float
    vertices: float

    @staticmethod
    def of(result: Track, truth: Truth) -> Score:
        """Compare surfaces in every other frame, vertices in all."""
        faces = result.template.faces
        found = result.sequence.vertices.astype(np.float64)
        both = [
            surface_distance(found[k], faces, truth.vertices[k], truth.faces)
            for k in range(0, len(found), 2)
        ]
        off = np.nan
        if found.shape == truth.vertices.shape:
            squares = ((found - truth.vertices) ** 2).sum(axis=2) @ result.template.weights
            off = float(np.sqrt(squares).mean())
        fraction = (result.ejection_fraction or 0.0) - truth.ejection_fraction
        mean, hausdorff = np.mean(both, axis=0)
        return Score(float(mean), float(hausdorff), fraction, off)


def timed(call: Callable[[], Any]) -> tuple[Any, float]:
    """Return the result of a call and its processor seconds."""
    start = time.process_time()
    result = call()
    return result, time.process_time() - start
