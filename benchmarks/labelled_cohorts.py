"""Small labelled cohorts of surfaces that move, on every topology, as people might record them.

Sizes, shapes, poses, habits, tempo, numbers of frames, meshes and noise differ from case to case;
several recordings are of one person. No two cohorts have the same topology and kind of label.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from modalmotion.mesh import lattice_faces
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.modes.topology import PLANE
from modalmotion.simulate import Acquisition, VentricleParameters, simulate_ventricle
from modalmotion.simulate.pose import Pose, random_rotation

Array = NDArray[np.float64]
Rng = np.random.Generator


class Person(NamedTuple):
    """Who is recorded: what all recordings of one person share."""

    name: str
    size: float
    tempo: float
    strength: float
    shape: Array
    habit: Array


class Recorded(NamedTuple):
    """A sequence with its class."""

    sequence: MeshSequence
    label: str
    person: str


@dataclass(frozen=True)
class Cohort:
    """A kind of labelled recordings.

    Parameters
    ----------
    counts : mapping of label to int
        Recordings of each class.
    n_people : int
    record : callable
        Makes one recording.
    """

    counts: Mapping[str, int]
    n_people: int
    record: Callable[[str, Person, Rng], MeshSequence]


def recordings(cohort: Cohort, seed: int | list[int]) -> Iterator[Recorded]:
    """Make all recordings of a cohort; every person does something of each class."""
    rng = np.random.default_rng(seed)
    people = [_person(f"person {k}", rng) for k in range(cohort.n_people)]
    for label, count in cohort.counts.items():
        first = int(rng.integers(cohort.n_people))
        for k in range(count):
            person = people[(first + k) % cohort.n_people]
            yield Recorded(cohort.record(label, person, rng), label, person.name)


def _person(name: str, rng: Rng) -> Person:
    return Person(
        name,
        size=float(np.exp(rng.normal(0.0, 0.25))),
        tempo=float(np.exp(rng.normal(0.0, 0.12))),
        strength=float(np.exp(rng.normal(0.0, 0.2))),
        shape=rng.standard_normal(6),
        habit=rng.standard_normal(6),
    )


def _bump(x: Array, centre: float, width: float) -> Array:
    """Evaluate a Gaussian of height 1."""
    return np.asarray(np.exp(-0.5 * ((x - centre) / width) ** 2))


def _recorded(
    frames: Array, person: Person, rng: Rng, *, noise: float, turned: bool, wander: float = 0.0
) -> Array:
    """Give positions as recorded: of the person's size, somewhere, with noise.

    `noise` and `wander`, a slow motion that means nothing, are in units of the surface.
    """
    n, n_vertices, _ = frames.shape
    t = np.arange(n) / n
    rest = frames[0]
    for k in (1, 2):
        # Linear fields in space: stretching and shearing a little.
        field = rest @ rng.normal(0.0, wander / k, (3, 3))
        frames = frames + np.cos(2 * np.pi * (k * t + rng.uniform()))[:, None, None] * field
    frames = frames + noise * rng.standard_normal((n, n_vertices, 3))
    small = np.radians(rng.normal(0.0, 4.0, 3)) if not turned else None
    angle = Rotation.random(random_state=rng) if small is None else Rotation.from_rotvec(small)
    place = rng.normal(0.0, 2.0, 3)
    return np.asarray(100.0 * person.size * (frames @ angle.as_matrix().T + place))


def _cycle_phases(rng: Rng, fewest: int = 14, most: int = 36) -> Array:
    """Draw phases of one turn that starts anywhere, rad."""
    n = int(rng.integers(fewest, most + 1))
    return np.asarray(2 * np.pi * (np.arange(n) / n + rng.uniform()))


def _course_shares(person: Person, rng: Rng, fewest: int = 20, most: int = 50) -> Array:
    """Draw elapsed shares of a movement, hurried at first or at last."""
    n = int(rng.integers(fewest, most + 1))
    t = np.linspace(0.0, 1.0, n)
    warp = 0.15 * np.log(person.tempo) + rng.normal(0.0, 0.05)
    return np.asarray(t + warp * np.sin(np.pi * t))


def _random_grid(rng: Rng, rows: tuple[int, int], columns: tuple[int, int]) -> tuple[int, int]:
    """Draw rows and an even number of columns."""
    return int(rng.integers(*rows)), 2 * int(rng.integers(columns[0] // 2, columns[1] // 2))


def _lattice_coordinates(grid: tuple[int, int], closed: tuple[bool, bool]) -> tuple[Array, Array]:
    """Give coordinates in [0, 1] or [0, 1) of the nodes, both (nodes,)."""
    axes = [
        np.arange(n) / n if is_closed else (np.arange(n) + 0.5) / n
        for n, is_closed in zip(grid, closed, strict=True)
    ]
    s, u = np.meshgrid(*axes, indexing="ij")
    return s.ravel(), u.ravel()


def _membrane(label: str, person: Person, rng: Rng) -> MeshSequence:
    """Record a sheet with a wave that stands, or runs one way or the other."""
    grid = _random_grid(rng, (9, 16), (12, 20))
    s, u = _lattice_coordinates(grid, (False, False))
    rest = np.stack([s, 1.4 * u, 0.1 * person.shape[0] * s * u], axis=1)
    phase = _cycle_phases(rng)[:, None]
    k = 2 * np.pi * rng.uniform(1.1, 1.4)
    run = {"stands": 0.0, "towards": 0.5, "away": -0.5}[label] + rng.normal(0.0, 0.18)
    size = 0.08 * person.strength * np.exp(rng.normal(0.0, 0.2))
    lift = np.cos(k * u) * np.cos(phase) + run * np.sin(k * u) * np.sin(phase)
    lift = lift + 0.3 * person.habit[0] * np.cos(np.pi * s) * np.cos(phase + person.habit[1])
    frames = np.repeat(rest[None], len(phase), axis=0)
    frames[:, :, 2] += size * lift
    vertices = _recorded(frames, person, rng, noise=0.02, turned=True, wander=0.015)
    return mesh_sequence(vertices, grid=grid, topology="plane", unit="mm")


def _folding(label: str, person: Person, rng: Rng) -> MeshSequence:
    """Record a sheet that folds at its first, middle or last third, and stays folded."""
    grid = _random_grid(rng, (10, 18), (8, 16))
    s, u = _lattice_coordinates(grid, (False, False))
    t = _course_shares(person, rng)[:, None]
    where = {"near": 0.36, "middle": 0.5, "far": 0.64}[label] + rng.normal(0.0, 0.05)
    angle = np.radians(50.0 * person.strength * np.exp(rng.normal(0.0, 0.2)))
    closing = 1.0 / (1.0 + np.exp(-(t - 0.5 - 0.05 * person.habit[0]) / 0.1))
    bend = angle * closing * np.maximum(s - where, 0.0)
    skew = 0.1 * person.habit[1] * (u - 0.5) * closing
    z = np.sin(bend) + skew * s
    x = 1.5 * s - 0.3 * np.maximum(s - where, 0.0) * (1 - np.cos(angle * closing))
    frames = np.stack([x, np.broadcast_to(u, x.shape), z], axis=2)
    vertices = _recorded(frames, person, rng, noise=0.015, turned=True, wander=0.02)
    return mesh_sequence(vertices, grid=grid, topology="plane", unit="mm")


def _torus(label: str, person: Person, rng: Rng) -> MeshSequence:
    """Record a ring whose undulation runs around one way, the other way, or stands."""
    grid = _random_grid(rng, (8, 14), (14, 24))
    s, u = _lattice_coordinates(grid, (True, True))
    a, b = 2 * np.pi * s, 2 * np.pi * u
    phase = _cycle_phases(rng)[:, None]
    start = rng.uniform(0.0, 2 * np.pi)
    run = {"forwards": 0.5, "backwards": -0.5, "stands": 0.0}[label] + rng.normal(0.0, 0.18)
    size = 0.08 * person.strength * np.exp(rng.normal(0.0, 0.2))
    lobes = 2 * (b - start)
    lift = size * (np.cos(lobes) * np.cos(phase) + run * np.sin(lobes) * np.sin(phase))
    swell = 0.05 * person.habit[0] * np.cos(phase + person.habit[1])
    tube = (0.35 + 0.03 * person.shape[0]) * (1.0 + swell)
    ring = 1.0 + tube * np.cos(a)
    frames = np.stack([ring * np.cos(b), ring * np.sin(b), tube * np.sin(a) + lift], axis=2)
    vertices = _recorded(frames, person, rng, noise=0.08, turned=True, wander=0.02)
    return mesh_sequence(vertices, grid=grid, topology="torus", unit="mm")


def _sphere(label: str, person: Person, rng: Rng) -> MeshSequence:
    """Record a ball that becomes oval, squeezes from pole to pole, or breathes."""
    grid = _random_grid(rng, (9, 15), (14, 24))
    s, u = _lattice_coordinates(grid, (False, True))
    polar, b = np.pi * s, 2 * np.pi * u
    phase = _cycle_phases(rng)[:, None]
    size = 0.08 * person.strength * np.exp(rng.normal(0.0, 0.25))
    start = rng.uniform(0.0, 2 * np.pi)
    oval = np.cos(2 * (b - start)) * np.sin(polar) ** 2 * np.cos(phase)
    wave = np.cos(phase - 2.0 * (s - 0.5) * 1.2) * np.sin(polar)
    breath = np.cos(phase) * np.ones_like(s)
    share = {"oval": (0.65, 0.2), "squeezes": (0.0, 0.75), "breathes": (0.0, 0.2)}[label]
    x, y = np.array(share) + rng.normal(0.0, 0.2, 2)
    radius = 1.0 + size * (x * oval + y * wave + (1.0 - y) * breath)
    along = 1.2 + 0.1 * person.shape[0]
    frames = np.stack(
        [
            radius * np.sin(polar) * np.cos(b),
            radius * np.sin(polar) * np.sin(b),
            along * radius * np.cos(polar),
        ],
        axis=2,
    )
    vertices = _recorded(frames, person, rng, noise=0.05, turned=True, wander=0.01)
    return mesh_sequence(vertices, grid=grid, topology="sphere", unit="mm")


_WORDS: Final = {
    "tip, back": ((0.33, 0.82), (0.66, 0.35)),
    "back, tip": ((0.33, 0.35), (0.66, 0.82)),
    "tip, tip": ((0.33, 0.82), (0.66, 0.75)),
    "both": ((0.45, 0.82), (0.5, 0.35)),
}


def _word(label: str, person: Person, rng: Rng, *, turned: bool = False) -> MeshSequence:
    """Record a curve in the plane that says a word of two gestures, each somewhere at some time."""
    n_vertices = 11
    s = np.linspace(0.0, 1.0, n_vertices)
    height = 0.35 + 0.05 * person.shape[0]
    rest = np.stack([s, height * np.sin(np.pi * s ** (1 + 0.1 * person.shape[1])), 0 * s], axis=1)
    t = _course_shares(person, rng)[:, None]
    frames = np.repeat(rest[None], len(t), axis=0)
    for k, (when, where) in enumerate(_WORDS[label]):
        size = 0.1 * person.strength * np.exp(rng.normal(0.0, 0.35))
        at = where + 0.05 * person.habit[k] + rng.normal(0.0, 0.05)
        lift = size * _bump(t, when + rng.normal(0.0, 0.06), 0.09) * _bump(s, at, 0.16)
        frames[:, :, 1] += lift
        frames[:, :, 0] += 0.3 * person.habit[2] * lift
    jaw = 0.04 * np.exp(rng.normal(0.0, 0.3)) * np.sin(3 * np.pi * t + rng.normal(0.0, 0.4))
    frames[:, :, 1] += jaw * (0.5 + s)
    vertices = _recorded(frames, person, rng, noise=0.02, turned=turned)
    return mesh_sequence(vertices, topology="open curve", unit="mm")


def _sheet_with_holes() -> tuple[Array, NDArray[np.int64]]:
    """Make a sheet with two holes: no topology that has natural coordinates."""
    n, m = 11, 15
    x, y = np.meshgrid(np.arange(n) / (n - 1), 1.5 * np.arange(m) / (m - 1), indexing="ij")
    rest = np.stack([x.ravel(), y.ravel(), np.zeros(n * m)], axis=1)
    faces = lattice_faces(PLANE, (n, m))
    centres = rest[faces].mean(axis=1)
    is_hole = np.zeros(len(faces), dtype=np.bool_)
    for hole in (0.45, 1.05):
        is_hole |= np.hypot(centres[:, 0] - 0.5, centres[:, 1] - hole) < 0.17
    kept = faces[~is_hole]
    used = np.unique(kept)
    place = np.full(len(rest), -1)
    place[used] = np.arange(len(used))
    return rest[used], place[kept]


def _gesture(label: str, person: Person, rng: Rng) -> MeshSequence:
    """Record a figure of one mesh that waves with one corner, the other, both, or twists."""
    rest, faces = _sheet_with_holes()
    x, y = rest[:, 0], rest[:, 1]
    t = _course_shares(person, rng)[:, None]
    size = 0.22 * person.strength * np.exp(rng.normal(0.0, 0.25))
    left, right = (np.clip(y - 0.7, 0, None) ** 2 * side for side in (1 - x, x))
    turns = rng.uniform(1.6, 2.4)
    swing = np.sin(2 * np.pi * turns * t + rng.normal(0.0, 0.5)) * _bump(t, 0.5, 0.25)
    share = {"left": (1.0, 0.0), "right": (0.0, 1.0), "both": (0.7, 0.7), "twist": (0.8, -0.8)}
    a, b = np.array(share[label]) + rng.normal(0.0, 0.22, 2) + 0.1 * person.habit[:2]
    frames = np.repeat(rest[None], len(t), axis=0)
    frames[:, :, 2] += 3.0 * size * swing * (a * left + b * right)
    frames[:, :, 1] += 0.15 * person.habit[2] * t * (1.5 - y) * size
    vertices = _recorded(frames, person, rng, noise=0.02, turned=False, wander=0.02)
    return mesh_sequence(vertices, faces, unit="mm")


_WALLS: Final[dict[str, dict[str, float]]] = {
    "plain": {},
    "one wall late": {"delay": 0.03},
    "low at the apex": {"akinesia": 0.3, "akinesia_height": 0.15, "akinesia_extent": 50.0},
    "low at the base": {"akinesia": 0.3, "akinesia_height": 0.8, "akinesia_extent": 50.0},
}


def _cup(label: str, person: Person, rng: Rng) -> MeshSequence:
    """Record a ventricle that is meshed anew in each recording, with something subtle."""
    parameters = replace(
        VentricleParameters(),
        length=float(np.clip(88.0 * person.size, 50.0, 140.0)),
        radius=float(np.clip(25.0 * person.size * np.exp(0.06 * person.shape[0]), 12.0, 45.0)),
        ejection_fraction=float(np.clip(0.55 + 0.05 * person.habit[0], 0.4, 0.68)),
        apex_rotation=float(8.0 + 2.0 * person.habit[1]),
        shape_variation=1.0,
        motion_variation=1.0,
        akinesia_azimuth=float(rng.uniform(0.0, 360.0)),
        delay_azimuth=float(rng.uniform(0.0, 360.0)),
        **_WALLS[label],
    )
    return simulate_ventricle(
        parameters,
        n_vertices=int(rng.integers(300, 700)),
        acquisition=Acquisition(
            n_frames=int(rng.integers(14, 33)),
            noise=1.0,
            start_phase=rng.uniform(),
            pose=Pose(rotation=random_rotation(rng)),
        ),
        rng=rng,
    )


def _ring(label: str, person: Person, rng: Rng) -> MeshSequence:
    """Record a section that contracts evenly, less on one side, or late on one side."""
    n_vertices = 2 * int(rng.integers(12, 33))
    b = 2 * np.pi * np.arange(n_vertices) / n_vertices
    phase = _cycle_phases(rng)[:, None]
    start = rng.uniform(0.0, 2 * np.pi)
    side = 0.5 + 0.5 * np.cos(b - start)
    less = {"even": 0.0, "less": 0.5, "late": 0.0}[label] + rng.normal(0.0, 0.2)
    late = {"even": 0.0, "less": 0.0, "late": 0.9}[label] + rng.normal(0.0, 0.25)
    size = 0.13 * person.strength * np.exp(rng.normal(0.0, 0.15))
    beat = -np.cos(phase - late * side) - 0.3 * np.cos(2 * (phase - late * side) + 0.5)
    radius = 1.0 + 0.06 * person.shape[0] * np.cos(2 * b) + size * beat * (1.0 - less * side)
    frames = np.stack([radius * np.cos(b), radius * np.sin(b), 0.0 * radius], axis=2)
    vertices = _recorded(frames, person, rng, noise=0.03, turned=False, wander=0.02)
    return mesh_sequence(vertices, topology="closed curve", unit="mm")


def _tube(label: str, person: Person, rng: Rng) -> MeshSequence:
    """Record a tube whose constriction travels up or down its length once, quickly or slowly."""
    grid = _random_grid(rng, (10, 18), (12, 20))
    s, u = _lattice_coordinates(grid, (False, True))
    b = 2 * np.pi * u
    t = _course_shares(person, rng)[:, None]
    way, length = {"up": (1, 0.35), "down": (-1, 0.35), "up slowly": (1, 0.75)}[label]
    length = max(0.15, length + rng.normal(0.0, 0.1))
    centre = 0.5 + way * (t - 0.5 + rng.normal(0.0, 0.05)) * 0.8 / length
    size = 0.16 * person.strength * np.exp(rng.normal(0.0, 0.25))
    near = _bump(s, 0.5, 0.8) * np.exp(-0.5 * ((s - centre) / 0.16) ** 2)
    uneven = 1.0 + 0.3 * np.cos(b - rng.uniform(0.0, 2 * np.pi))
    radius = (0.4 + 0.03 * person.shape[0]) * (1.0 - size * near * uneven)
    x, y = radius * np.cos(b), radius * np.sin(b)
    frames = np.stack([x, y, np.broadcast_to(2.0 * s, x.shape)], axis=2)
    vertices = _recorded(frames, person, rng, noise=0.05, turned=True, wander=0.015)
    return mesh_sequence(vertices, grid=grid, topology="cylinder", unit="mm")


def _bulge(label: str, person: Person, rng: Rng) -> MeshSequence:
    """Record a sheet that bulges a little, more, or much: only the amplitude differs."""
    grid = _random_grid(rng, (9, 16), (10, 18))
    s, u = _lattice_coordinates(grid, (False, False))
    phase = _cycle_phases(rng)[:, None]
    size = 0.06 * {"little": 0.75, "more": 1.0, "much": 1.33}[label] * np.exp(rng.normal(0.0, 0.13))
    x, y = rng.normal(0.5, 0.08, 2)
    frames = np.repeat(np.stack([s, 1.2 * u, 0.1 * s * u], axis=1)[None], len(phase), axis=0)
    lift = np.cos(phase) + 0.3 * np.cos(2 * phase + person.habit[0])
    frames[:, :, 2] += size * lift * _bump(s, x, 0.3) * _bump(u, y, 0.3)
    vertices = _recorded(frames, person, rng, noise=0.02, turned=True, wander=0.01)
    return mesh_sequence(vertices, grid=grid, topology="plane", unit="mm")


def _rope(label: str, person: Person, rng: Rng) -> MeshSequence:
    """Record a curve that rises early, late, or for long: only the timing differs."""
    s = np.linspace(0.0, 1.0, int(rng.integers(12, 25)))
    t = _course_shares(person, rng)[:, None]
    when = {"early": 0.42, "late": 0.58, "for long": 0.5}[label] + rng.normal(0.0, 0.05)
    length = {"early": 0.1, "late": 0.1, "for long": 0.17}[label] * np.exp(rng.normal(0.0, 0.2))
    size = 0.15 * person.strength * np.exp(rng.normal(0.0, 0.3))
    lift = size * _bump(t, when, length) * _bump(s, 0.5 + 0.08 * person.habit[0], 0.2)
    frames = np.repeat(np.stack([s, 0.1 * s**2, 0 * s], axis=1)[None], len(t), axis=0)
    frames[:, :, 1] += lift
    frames[:, :, 2] += 0.3 * person.habit[1] * lift
    vertices = _recorded(frames, person, rng, noise=0.02, turned=True, wander=0.02)
    return mesh_sequence(vertices, topology="open curve", unit="mm")


COHORTS: Final[dict[str, Cohort]] = {
    "membrane": Cohort({"stands": 24, "towards": 24, "away": 24}, 12, _membrane),
    "folding": Cohort({"near": 20, "middle": 20, "far": 20}, 10, _folding),
    "torus": Cohort({"forwards": 20, "backwards": 20, "stands": 20}, 10, _torus),
    "sphere": Cohort({"oval": 14, "squeezes": 20, "breathes": 26}, 10, _sphere),
    "words": Cohort(dict.fromkeys(_WORDS, 15), 5, _word),
    "words, turned": Cohort(dict.fromkeys(_WORDS, 20), 10, partial(_word, turned=True)),
    "figure": Cohort({"left": 12, "right": 20, "both": 8, "twist": 16}, 8, _gesture),
    "cup": Cohort(dict.fromkeys(_WALLS, 20), 16, _cup),
    "ring": Cohort({"even": 36, "less": 16, "late": 12}, 16, _ring),
    "tube": Cohort({"up": 16, "down": 16, "up slowly": 16}, 12, _tube),
    "bulge": Cohort({"little": 20, "more": 20, "much": 20}, 10, _bulge),
    "rope": Cohort({"early": 16, "late": 16, "for long": 16}, 8, _rope),
}
"""Every kind, by name."""
