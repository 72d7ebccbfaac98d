"""Points of an end: the rim of the opening passes through them."""

from __future__ import annotations

import numpy as np
import pytest
from clouds import Floats, breathing_spheroid, rim_of, rms_distance, sampled

from modalmotion.mesh.sequence import mesh_sequence, standard_surface
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import CUP, SPHERE
from modalmotion.template import make_template
from modalmotion.tracking import Observation, Track, track
from modalmotion.tracking.deformable import Deformable, rim_at
from modalmotion.tracking.noise import Noise
from modalmotion.tracking.normal_equations import normal_equations

BASE = standard_surface(Lattice(CUP, (12, 20)))
SHAPE = BASE.vertices[0] * np.array([25.0, 25.0, 40.0])
TEMPLATE = make_template(mesh_sequence(SHAPE[None], BASE.faces))
S = TEMPLATE.coordinates[:, 0]
RIM = rim_of(BASE.faces, S)
APEX = int(S.argmin())


def tilting_cup() -> Floats:
    """A cup whose base leans to one side, and further in the second frame."""
    frames = []
    for slope, shrink in ((0.3, 1.0), (0.5, 0.85)):
        x = SHAPE * np.array([shrink, shrink, 1.0])
        x[:, 2] += slope * x[:, 0] * S**2 * np.sign(x[RIM, 2].mean() - x[APEX, 2])
        frames.append(x)
    return np.stack(frames)


def tracked(*, by_points: bool) -> tuple[Floats, Track]:
    x, rng = tilting_cup(), np.random.default_rng(0)
    frames = []
    for frame in x:
        valve = frame[RIM][::3] + rng.normal(0.0, 0.3, (len(RIM[::3]), 3))
        base = Observation(valve, end="base")
        if not by_points:
            base = Observation(valve.mean(axis=0)[None], places=("base",))
        cloud = Observation(sampled(frame, BASE.faces, 250, rng, 0.3))
        frames.append([cloud, base, Observation(frame[[APEX]], places=("apex",))])
    return x, track(frames, modes=18, time="open")


def rim_distance(x: Floats, found: Track, frame: int) -> float:
    own = found.template
    rim, _ = rim_at(Deformable.of(own, 2), "base")
    return rms_distance(x[frame][RIM], found.sequence.vertices[frame].astype(np.float64), rim)


def test_a_base_that_leans_is_where_its_points_are() -> None:
    x, by_points = tracked(by_points=True)
    _, by_middle = tracked(by_points=False)
    for frame in (0, 1):
        assert rim_distance(x, by_points, frame) < 0.8
        assert rim_distance(x, by_middle, frame) > 2.0 * rim_distance(x, by_points, frame)


@pytest.mark.parametrize("seed", range(3))
def test_a_point_far_from_the_rim_is_a_stray(seed: int) -> None:
    x, rng, sd = tilting_cup(), np.random.default_rng(seed), 0.3
    cloud = [Observation(sampled(frame, BASE.faces, 250, rng, sd)) for frame in x]
    rows = [[c, Observation(f[RIM], end="base")] for c, f in zip(cloud, x, strict=True)]
    junction = Observation(np.vstack([x[1][RIM], x[1][RIM].mean(axis=0)]), end="base")
    start = mesh_sequence(x[:1], BASE.faces)
    usual, other = (
        track([rows[0], last], start=start, modes=12, time="open").sequence.vertices[1]
        for last in (rows[1], [cloud[1], junction])
    )
    # A point that counted would draw the rim to its middle: 3 mm off.
    assert rms(other - usual) < 2.0 * sd
    assert rms(other - x[1]) < 1.1 * rms(usual - x[1])


def rms(lengths: Floats) -> float:
    return float(np.sqrt((lengths**2).sum(axis=1).mean()))


def test_where_nothing_is_open_their_middle_is_the_end() -> None:
    ball = breathing_spheroid(2)
    rng = np.random.default_rng(0)
    ring = np.array([[3.0, 0.0, 40.0], [-3.0, 0.0, 40.0]])
    frames = [
        [Observation(sampled(x, ball.faces, 80, rng, 0.3)), Observation(ring, end="base")]
        for x in ball.vertices
    ]
    found = track(frames, modes=4, time="open")
    assert found.sequence.topology == SPHERE
    surface, still = Deformable.of(found.template, 4), np.zeros((4, 3))
    noise = Noise(0.3, 0.0, 1.0)
    for sd in (None, 2.0):
        points = Observation(ring, sd=sd, end="base")
        middle = Observation(ring.mean(axis=0)[None], sd=sd, places=("base",))
        own, expected = (normal_equations(surface, still, (x,), noise) for x in (points, middle))
        assert own.matrix == pytest.approx(expected.matrix)
        assert own.vector == pytest.approx(expected.vector)
        assert np.abs(own.vector).max() > 0
