"""Small labelled cohorts of surfaces that move, on every topology, as people might record them.

Sizes, shapes, poses, habits, tempo, numbers of frames, meshes and noise differ from case to case;
several recordings are of one person. No two cohorts have the same topology and kind of label.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import modalmotion as mm
from modalmotion.classification import TrainingCase
from modalmotion.mesh import lattice_faces
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.simulate.surface import Pose, random_rotation

Array = NDArray[np.float64]
Rng = np.random.Generator


class Person(NamedTuple):
    """What all recordings of one person share."""

    size: float
    tempo: float
    strength: float
    shape: Array
    habit: Array


class Cohort(NamedTuple):
    """Numbers of recordings by class, how many people, and what makes one recording."""

    counts: Mapping[str, int]
    n_people: int
    record: Callable[[str, Person, Rng], MeshSequence]


def recordings(cohort: Cohort, seed: int | list[int]) -> Iterator[TrainingCase]:
    """Make all recordings of a cohort; every person does something of each class."""
    rng, people = np.random.default_rng(seed), []
    for _ in range(cohort.n_people):
        size, tempo, strength = (float(np.exp(rng.normal(0.0, sd))) for sd in (0.25, 0.12, 0.2))
        shape, habit = rng.standard_normal((2, 6))
        people.append(Person(size, tempo, strength, shape, habit))
    for label, count in cohort.counts.items():
        first = int(rng.integers(cohort.n_people))
        for k in range(first, first + count):
            who = k % cohort.n_people
            yield TrainingCase(cohort.record(label, people[who], rng), label, f"person {who}")


def _bump(x: Array, centre: float | Array, width: float) -> Array:
    """Evaluate a Gaussian of height 1."""
    return np.asarray(np.exp(-0.5 * ((x - centre) / width) ** 2))


def _recorded(
    places: tuple[Array, Array, Array],
    person: Person,
    rng: Rng,
    noise: float,
    *,
    wander: float = 0.0,
    turned: bool = True,
    **known: Any,
) -> MeshSequence:
    """Record x, y and z, (frames or 1, vertices): of the person's size, somewhere, with noise.

    `noise` and `wander`, a slow motion that means nothing, are in units of the surface; `known` is
    what is known of the mesh.
    """
    frames = np.stack(np.broadcast_arrays(*places), axis=2)
    n = len(frames)
    t = np.arange(n) / n
    rest = frames[0]
    for k in (1, 2):
        field = rest @ rng.normal(0.0, wander / k, (3, 3))
        frames = frames + np.cos(2 * np.pi * (k * t + rng.uniform()))[:, None, None] * field
    frames = frames + noise * rng.standard_normal(frames.shape)
    small = np.radians(rng.normal(0.0, 4.0, 3)) if not turned else None
    angle = Rotation.random(random_state=rng) if small is None else Rotation.from_rotvec(small)
    place = rng.normal(0.0, 2.0, 3)
    vertices = 100.0 * person.size * (frames @ angle.as_matrix().T + place)
    return mesh_sequence(vertices, unit="mm", **known)


def _phases(rng: Rng) -> Array:
    """Draw phases of one turn that starts anywhere, rad, (frames, 1)."""
    n = int(rng.integers(14, 37))
    return np.asarray(2 * np.pi * (np.arange(n) / n + rng.uniform()))[:, None]


def _shares(person: Person, rng: Rng) -> Array:
    """Draw elapsed shares of a movement, hurried at first or at last, (frames, 1)."""
    t = np.linspace(0.0, 1.0, int(rng.integers(20, 51)))
    warp = 0.15 * np.log(person.tempo) + rng.normal(0.0, 0.05)
    return np.asarray(t + warp * np.sin(np.pi * t))[:, None]


def _size(usual: float, person: Person, rng: Rng, spread: float) -> float:
    """Draw how large a motion is."""
    return float(usual * person.strength * np.exp(rng.normal(0.0, spread)))


def _lattice(
    rng: Rng, rows: tuple[int, int], columns: tuple[int, int], *closed: int
) -> tuple[tuple[int, int], Array, Array]:
    """Draw a grid with an even number of columns.

    Coordinates of its nodes, both (nodes,), are in [0, 1) along `closed` axes, in (0, 1) elsewhere.
    """
    grid = int(rng.integers(*rows)), 2 * int(rng.integers(columns[0] // 2, columns[1] // 2))
    axes = [(np.arange(n) + (0.0 if k in closed else 0.5)) / n for k, n in enumerate(grid)]
    s, u = np.meshgrid(*axes, indexing="ij")
    return grid, s.ravel(), u.ravel()


def _membrane(label: str, person: Person, rng: Rng) -> MeshSequence:
    """Record a sheet with a wave that stands, or runs one way or the other."""
    grid, s, u = _lattice(rng, (9, 16), (12, 20))
    phase = _phases(rng)
    k = 2 * np.pi * rng.uniform(1.1, 1.4)
    run = {"stands": 0.0, "towards": 0.5, "away": -0.5}[label] + rng.normal(0.0, 0.18)
    size = _size(0.08, person, rng, 0.2)
    lift = np.cos(k * u) * np.cos(phase) + run * np.sin(k * u) * np.sin(phase)
    lift += 0.3 * person.habit[0] * np.cos(np.pi * s) * np.cos(phase + person.habit[1])
    places = s, 1.4 * u, 0.1 * person.shape[0] * s * u + size * lift
    return _recorded(places, person, rng, 0.02, wander=0.015, grid=grid, topology="plane")


def _folding(label: str, person: Person, rng: Rng) -> MeshSequence:
    """Record a sheet that folds at its first, middle or last third, and stays folded."""
    grid, s, u = _lattice(rng, (10, 18), (8, 16))
    t = _shares(person, rng)
    where = {"near": 0.36, "middle": 0.5, "far": 0.64}[label] + rng.normal(0.0, 0.05)
    angle = np.radians(50.0 * person.strength * np.exp(rng.normal(0.0, 0.2)))
    closing = 1.0 / (1.0 + np.exp(-(t - 0.5 - 0.05 * person.habit[0]) / 0.1))
    bend = angle * closing * np.maximum(s - where, 0.0)
    skew = 0.1 * person.habit[1] * (u - 0.5) * closing
    x = 1.5 * s - 0.3 * np.maximum(s - where, 0.0) * (1 - np.cos(angle * closing))
    places = x, u, np.sin(bend) + skew * s
    return _recorded(places, person, rng, 0.015, wander=0.02, grid=grid, topology="plane")


def _torus(label: str, person: Person, rng: Rng) -> MeshSequence:
    """Record a ring whose undulation runs around one way, the other way, or stands."""
    grid, s, u = _lattice(rng, (8, 14), (14, 24), 0, 1)
    a, b = 2 * np.pi * s, 2 * np.pi * u
    phase = _phases(rng)
    start = rng.uniform(0.0, 2 * np.pi)
    run = {"forwards": 0.5, "backwards": -0.5, "stands": 0.0}[label] + rng.normal(0.0, 0.18)
    size = _size(0.08, person, rng, 0.2)
    lobes = 2 * (b - start)
    lift = size * (np.cos(lobes) * np.cos(phase) + run * np.sin(lobes) * np.sin(phase))
    swell = 0.05 * person.habit[0] * np.cos(phase + person.habit[1])
    tube = (0.35 + 0.03 * person.shape[0]) * (1.0 + swell)
    ring = 1.0 + tube * np.cos(a)
    places = ring * np.cos(b), ring * np.sin(b), tube * np.sin(a) + lift
    return _recorded(places, person, rng, 0.08, wander=0.02, grid=grid, topology="torus")


def _sphere(label: str, person: Person, rng: Rng) -> MeshSequence:
    """Record a ball that becomes oval, squeezes from pole to pole, or breathes."""
    grid, s, u = _lattice(rng, (9, 15), (14, 24), 1)
    polar, b = np.pi * s, 2 * np.pi * u
    phase = _phases(rng)
    size = _size(0.08, person, rng, 0.25)
    start = rng.uniform(0.0, 2 * np.pi)
    oval = np.cos(2 * (b - start)) * np.sin(polar) ** 2 * np.cos(phase)
    wave = np.cos(phase - 2.0 * (s - 0.5) * 1.2) * np.sin(polar)
    breath = np.cos(phase) * np.ones_like(s)
    share = {"oval": (0.65, 0.2), "squeezes": (0.0, 0.75), "breathes": (0.0, 0.2)}[label]
    x, y = np.array(share) + rng.normal(0.0, 0.2, 2)
    radius = 1.0 + size * (x * oval + y * wave + (1.0 - y) * breath)
    ring, along = radius * np.sin(polar), (1.2 + 0.1 * person.shape[0]) * radius * np.cos(polar)
    places = ring * np.cos(b), ring * np.sin(b), along
    return _recorded(places, person, rng, 0.05, wander=0.01, grid=grid, topology="sphere")


_WORDS: Final = {
    "tip, back": ((0.33, 0.82), (0.66, 0.35)),
    "back, tip": ((0.33, 0.35), (0.66, 0.82)),
    "tip, tip": ((0.33, 0.82), (0.66, 0.75)),
    "both": ((0.45, 0.82), (0.5, 0.35)),
}


def _word(label: str, person: Person, rng: Rng, *, turned: bool = False) -> MeshSequence:
    """Record a curve in the plane that says a word of two gestures, each somewhere at some time."""
    x = s = np.linspace(0.0, 1.0, 11)
    y = (0.35 + 0.05 * person.shape[0]) * np.sin(np.pi * s ** (1 + 0.1 * person.shape[1]))
    t = _shares(person, rng)
    for k, (when, where) in enumerate(_WORDS[label]):
        size = _size(0.1, person, rng, 0.35)
        at = where + 0.05 * person.habit[k] + rng.normal(0.0, 0.05)
        lift = size * _bump(t, when + rng.normal(0.0, 0.06), 0.09) * _bump(s, at, 0.16)
        x, y = x + 0.3 * person.habit[2] * lift, y + lift
    jaw = 0.04 * np.exp(rng.normal(0.0, 0.3)) * np.sin(3 * np.pi * t + rng.normal(0.0, 0.4))
    places = x, y + jaw * (0.5 + s), 0 * s
    return _recorded(places, person, rng, 0.02, turned=turned, topology="open curve")


def _sheet_with_holes() -> tuple[Array, NDArray[np.int64]]:
    """Make a sheet with two holes: no topology that has natural coordinates."""
    x, y = np.meshgrid(np.arange(11) / 10, 1.5 * np.arange(15) / 14, indexing="ij")
    rest = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    faces = lattice_faces(mm.PLANE, x.shape)
    away = [np.linalg.norm(rest[faces].mean(axis=1) - (0.5, y, 0.0), axis=1) for y in (0.45, 1.05)]
    used, places = np.unique(faces[np.min(away, axis=0) >= 0.17], return_inverse=True)
    return rest[used], places.reshape(-1, 3)


def _gesture(label: str, person: Person, rng: Rng) -> MeshSequence:
    """Record a figure of one mesh that waves with one corner, the other, both, or twists."""
    rest, faces = _sheet_with_holes()
    x, y = rest[:, 0], rest[:, 1]
    t = _shares(person, rng)
    size = _size(0.22, person, rng, 0.25)
    left, right = (np.clip(y - 0.7, 0, None) ** 2 * side for side in (1 - x, x))
    turns = rng.uniform(1.6, 2.4)
    swing = np.sin(2 * np.pi * turns * t + rng.normal(0.0, 0.5)) * _bump(t, 0.5, 0.25)
    share = {"left": (1.0, 0.0), "right": (0.0, 1.0), "both": (0.7, 0.7), "twist": (0.8, -0.8)}
    a, b = np.array(share[label]) + rng.normal(0.0, 0.22, 2) + 0.1 * person.habit[:2]
    y = y + 0.15 * person.habit[2] * t * (1.5 - y) * size
    places = x, y, 3.0 * size * swing * (a * left + b * right)
    return _recorded(places, person, rng, 0.02, wander=0.02, turned=False, faces=faces)


_WALLS: Final[dict[str, dict[str, float]]] = {
    "plain": {},
    "one wall late": {"delay": 0.03},
    "low at the apex": {"akinesia": 0.3, "akinesia_height": 0.15, "akinesia_extent": 50.0},
    "low at the base": {"akinesia": 0.3, "akinesia_height": 0.8, "akinesia_extent": 50.0},
}


def _cup(label: str, person: Person, rng: Rng) -> MeshSequence:
    """Record a ventricle that is meshed anew in each recording, with something subtle."""
    parameters = mm.VentricleParameters(
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
    n, n_frames, start = int(rng.integers(300, 700)), int(rng.integers(14, 33)), rng.uniform()
    pose = Pose(rotation=random_rotation(rng))
    taken = mm.Acquisition(n_frames=n_frames, noise=1.0, start_phase=start, pose=pose)
    return mm.simulate_ventricle(parameters, n_vertices=n, acquisition=taken, rng=rng)


def _ring(label: str, person: Person, rng: Rng) -> MeshSequence:
    """Record a section that contracts evenly, less on one side, or late on one side."""
    n = 2 * int(rng.integers(12, 33))
    b = 2 * np.pi * np.arange(n) / n
    phase = _phases(rng)
    start = rng.uniform(0.0, 2 * np.pi)
    side = 0.5 + 0.5 * np.cos(b - start)
    less = {"even": 0.0, "less": 0.5, "late": 0.0}[label] + rng.normal(0.0, 0.2)
    late = {"even": 0.0, "less": 0.0, "late": 0.9}[label] + rng.normal(0.0, 0.25)
    size = _size(0.13, person, rng, 0.15)
    beat = -np.cos(phase - late * side) - 0.3 * np.cos(2 * (phase - late * side) + 0.5)
    radius = 1.0 + 0.06 * person.shape[0] * np.cos(2 * b) + size * beat * (1.0 - less * side)
    places, kind = (radius * np.cos(b), radius * np.sin(b), 0.0 * b), "closed curve"
    return _recorded(places, person, rng, 0.03, wander=0.02, turned=False, topology=kind)


def _tube(label: str, person: Person, rng: Rng) -> MeshSequence:
    """Record a tube whose constriction travels up or down its length once, quickly or slowly."""
    grid, s, u = _lattice(rng, (10, 18), (12, 20), 1)
    b = 2 * np.pi * u
    t = _shares(person, rng)
    way, length = {"up": (1, 0.35), "down": (-1, 0.35), "up slowly": (1, 0.75)}[label]
    length = max(0.15, length + rng.normal(0.0, 0.1))
    centre = 0.5 + way * (t - 0.5 + rng.normal(0.0, 0.05)) * 0.8 / length
    size = _size(0.16, person, rng, 0.25)
    near = _bump(s, 0.5, 0.8) * _bump(s, centre, 0.16)
    uneven = 1.0 + 0.3 * np.cos(b - rng.uniform(0.0, 2 * np.pi))
    radius = (0.4 + 0.03 * person.shape[0]) * (1.0 - size * near * uneven)
    places = radius * np.cos(b), radius * np.sin(b), 2.0 * s
    return _recorded(places, person, rng, 0.05, wander=0.015, grid=grid, topology="cylinder")


def _bulge(label: str, person: Person, rng: Rng) -> MeshSequence:
    """Record a sheet that bulges a little, more, or much: only the amplitude differs."""
    grid, s, u = _lattice(rng, (9, 16), (10, 18))
    phase = _phases(rng)
    size = 0.06 * {"little": 0.75, "more": 1.0, "much": 1.33}[label] * np.exp(rng.normal(0.0, 0.13))
    x, y = rng.normal(0.5, 0.08, 2)
    lift = np.cos(phase) + 0.3 * np.cos(2 * phase + person.habit[0])
    places = s, 1.2 * u, 0.1 * s * u + size * lift * _bump(s, x, 0.3) * _bump(u, y, 0.3)
    return _recorded(places, person, rng, 0.02, wander=0.01, grid=grid, topology="plane")


def _rope(label: str, person: Person, rng: Rng) -> MeshSequence:
    """Record a curve that rises early, late, or for long: only the timing differs."""
    s = np.linspace(0.0, 1.0, int(rng.integers(12, 25)))
    t = _shares(person, rng)
    when = {"early": 0.42, "late": 0.58, "for long": 0.5}[label] + rng.normal(0.0, 0.05)
    length = {"early": 0.1, "late": 0.1, "for long": 0.17}[label] * np.exp(rng.normal(0.0, 0.2))
    size = _size(0.15, person, rng, 0.3)
    lift = size * _bump(t, when, length) * _bump(s, 0.5 + 0.08 * person.habit[0], 0.2)
    places = s, 0.1 * s**2 + lift, 0.3 * person.habit[1] * lift
    return _recorded(places, person, rng, 0.02, wander=0.02, topology="open curve")


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
