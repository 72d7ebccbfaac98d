"""Who is recorded in a labelled cohort, and how a recording comes about."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from modalmotion.mesh.sequence import MeshSequence

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
    closed_form : bool
        False for the spring modes of the mesh.
    """

    counts: Mapping[str, int]
    n_people: int
    record: Callable[[str, Person, Rng], MeshSequence]
    closed_form: bool = True


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


def bump(x: Array, centre: float, width: float) -> Array:
    """Evaluate a Gaussian of height 1."""
    return np.asarray(np.exp(-0.5 * ((x - centre) / width) ** 2))


def recorded(
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
    angle = Rotation.random(random_state=rng) if turned else _small_turn(rng)
    place = rng.normal(0.0, 2.0, 3)
    return np.asarray(100.0 * person.size * (frames @ angle.as_matrix().T + place))


def _small_turn(rng: Rng) -> Rotation:
    return Rotation.from_rotvec(np.radians(rng.normal(0.0, 4.0, 3)))


def cycle_phases(rng: Rng, fewest: int = 14, most: int = 36) -> Array:
    """Draw phases of one turn that starts anywhere, rad."""
    n = int(rng.integers(fewest, most + 1))
    return np.asarray(2 * np.pi * (np.arange(n) / n + rng.uniform()))


def course_shares(person: Person, rng: Rng, fewest: int = 20, most: int = 50) -> Array:
    """Draw elapsed shares of a movement, hurried at first or at last."""
    n = int(rng.integers(fewest, most + 1))
    t = np.linspace(0.0, 1.0, n)
    warp = 0.15 * np.log(person.tempo) + rng.normal(0.0, 0.05)
    return np.asarray(t + warp * np.sin(np.pi * t))


def random_grid(rng: Rng, rows: tuple[int, int], columns: tuple[int, int]) -> tuple[int, int]:
    """Draw rows and an even number of columns."""
    return int(rng.integers(*rows)), 2 * int(rng.integers(columns[0] // 2, columns[1] // 2))


def lattice_coordinates(grid: tuple[int, int], closed: tuple[bool, bool]) -> tuple[Array, Array]:
    """Give coordinates in [0, 1] or [0, 1) of the nodes, both (nodes,)."""
    axes = [
        np.arange(n) / n if is_closed else (np.arange(n) + 0.5) / n
        for n, is_closed in zip(grid, closed, strict=True)
    ]
    s, u = np.meshgrid(*axes, indexing="ij")
    return s.ravel(), u.ravel()
