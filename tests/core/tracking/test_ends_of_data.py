"""Clouds and meshes that end where the surface does say where its rim is; others say nothing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
import pytest
from clouds import Floats, breathing_spheroid, ends_of, rim_of, rms_distance, sampled

from modalmotion.mesh.sequence import mesh_sequence, standard_surface
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import CUP, CYLINDER, PLANE
from modalmotion.template import make_template
from modalmotion.tracking import Observation, Track, of_surface, track
from modalmotion.tracking.deformable import Deformable, rim_at
from modalmotion.tracking.ends_of_data import Ending, with_endings
from modalmotion.tracking.noise import Noise
from modalmotion.tracking.observation import Frame, observed_frames

BASE = standard_surface(Lattice(CUP, (16, 28)))
SHAPE = BASE.vertices[0] * np.array([25.0, 25.0, 40.0])
START = mesh_sequence(SHAPE[None], BASE.faces, topology=CUP, unit="mm")
TEMPLATE = make_template(START)
SURFACE = Deformable.of(TEMPLATE, 18)
S = TEMPLATE.coordinates[:, 0]
RIM = rim_of(BASE.faces, S)
SIDES, _ = rim_at(SURFACE, "base")
N = 1500


def tilting() -> Floats:
    """A cup whose base, flat in the first frame, leans in the others and comes down."""
    up = np.sign(SHAPE[RIM, 2].mean() - SHAPE[S.argmin(), 2])
    frames = [SHAPE]
    for slope, shrink in ((0.1, 0.85), (0.2, 0.7), (0.1, 0.85)):
        x = SHAPE * np.array([shrink, shrink, 1.0])
        x[:, 2] += up * S**2 * (slope * x[:, 0] - 25.0 * (1.0 - shrink))
        frames.append(x)
    return np.stack(frames)


TRUE = tilting()
NOISE = Noise(0.5, 0.2, 40.0)


def clouds(seed: int = 0, noise: float = 0.5, n: int = N) -> list[Floats]:
    rng = np.random.default_rng(seed)
    return [sampled(x, BASE.faces, n, rng, noise) for x in TRUE]


def far_from_rim(found: Track, frame: int = 2) -> float:
    """RMS distance of the true rim from the one that was found."""
    return rms_distance(TRUE[frame][RIM], found.sequence.vertices[frame].astype(np.float64), SIDES)


def follow(observed: Sequence[Any], **more: Any) -> Track:
    return track(observed, start=START, modes=18, unit="mm", **more)


@cache
def followed(seed: int = 0) -> Track:
    return follow(clouds(seed))


def endings(observed: Sequence[Any], pinned: int | None = 0) -> list[list[Ending]]:
    """What is made of frames that do not move."""
    frames, _ = observed_frames(observed)
    given = with_endings(SURFACE, frames, NOISE, pinned)
    return [[part for part in frame if isinstance(part, Ending)] for frame in given]


def marked(frames: Sequence[Floats]) -> list[Any]:
    """Clouds with the landmarks of both ends."""
    pairs = zip(frames, TRUE, strict=True)
    return [[Observation(points), *ends_of(x, S, RIM)] for points, x in pairs]


def weighted(points: Floats) -> Frame:
    return (Observation(points, weights=np.ones(len(points))),)


def test_a_cloud_brings_the_rim_to_where_it_ends() -> None:
    found = followed()
    # Of points with weights nobody knows whether they lie evenly, and the rim is the prior's.
    other = follow([weighted(points) for points in clouds()])
    assert far_from_rim(found) < 0.8
    assert far_from_rim(other) > 2.0 * far_from_rim(found)
    off = [np.abs(own.deviations[2, RIM, 1]).mean() for own in (found, other)]
    assert off[0] < 0.7 * off[1]


def test_the_rim_is_off_by_what_is_stated() -> None:
    z = []
    for seed in range(3):
        found = followed(seed)
        off = found.sequence.vertices[2].astype(np.float64)[RIM] - TRUE[2][RIM]
        axis = TRUE[2][RIM].mean(axis=0) - TRUE[2][S.argmin()]
        z.append(off @ axis / np.linalg.norm(axis) / found.deviations[2, RIM, 1])
    assert np.sqrt(np.mean(np.square(z))) < 1.6


def test_vertices_of_a_mesh_as_a_cloud_end_farther_out_by_as_much_in_all_frames() -> None:
    # They are denser at the apex, and those of the rim stand for half a row beyond it.
    rng = np.random.default_rng(3)
    frames = [x + rng.normal(0.0, 0.3, x.shape) for x in TRUE]
    (first,), *_ = endings([frames[0]] * 2)
    assert first.offset > 0.5
    assert far_from_rim(follow(frames)) < 1.0


def test_strays_do_not_draw_it() -> None:
    rng = np.random.default_rng(3)
    more = [
        np.vstack([own, rng.uniform(own.min(axis=0) - 10, own.max(axis=0) + 10, (N // 3, 3))])
        for own in clouds()
    ]
    assert far_from_rim(follow(more)) < 1.5


def test_clouds_may_have_any_number_of_points() -> None:
    full = clouds()
    found = follow([points[:: 1 + k % 3] for k, points in enumerate(full)])
    assert far_from_rim(found) < 1.5


def test_borders_of_meshes_are_the_rim() -> None:
    # Every frame has triangles of its own, and of a third the diagonals run the other way.
    rng, frames = np.random.default_rng(0), []
    for x in TRUE:
        order = rng.permutation(len(x))
        faces = np.empty(len(x), dtype=np.int64)
        faces[order] = np.arange(len(x))
        frames.append((x[order], faces[BASE.faces]))
    found = follow(frames)
    assert far_from_rim(found) < 0.4
    no_border = [
        Observation(own.points, weights=own.weights) for own in (of_surface(*f) for f in frames)
    ]
    assert far_from_rim(follow(no_border)) > 2.0 * far_from_rim(found)


def test_a_border_is_the_sides_of_one_triangle() -> None:
    own = of_surface(SHAPE, BASE.faces).border
    assert own is not None
    expected = SHAPE[Deformable.of(TEMPLATE, 2).rim_sides[0]]
    middles = own.mean(axis=1), expected.mean(axis=1)
    assert np.sort(middles[0], axis=0) == pytest.approx(np.sort(middles[1], axis=0))
    # Corners apart, as in an STL file.
    soup = SHAPE[BASE.faces].reshape(-1, 3)
    apart = of_surface(soup, np.arange(len(soup)).reshape(-1, 3)).border
    assert apart is not None
    assert np.sort(apart.mean(axis=1), axis=0) == pytest.approx(np.sort(middles[1], axis=0))
    ball = breathing_spheroid(1)
    closed = mesh_sequence(ball.vertices, ball.faces)
    assert of_surface(SHAPE, np.zeros((0, 3), dtype=int)).border is None
    assert (of_surface(closed.vertices[0], closed.faces).border is None) == (
        not len(Deformable.of(make_template(closed), 2).rim_sides[0])
    )


def still(n: int = 3) -> list[Floats]:
    rng = np.random.default_rng(4)
    return [sampled(SHAPE, BASE.faces, N, rng, 0.5) for _ in range(n)]


def contour(x: Floats, step: float = 12.0) -> Floats:
    """Points of planes across the axis, 1 mm apart."""
    rows = []
    points = sampled(x, BASE.faces, 40_000, np.random.default_rng(1))
    for z in np.arange(points[:, 2].min() + 3.0, points[:, 2].max(), step):
        near = points[np.abs(points[:, 2] - z) < 0.2]
        rows.append(near[:120])
    return np.concatenate(rows)


def test_an_even_cloud_is_used() -> None:
    for own in endings(still()):
        assert [part.end for part in own] == ["base"]


CUT = SHAPE[:, 2].mean()


@pytest.mark.parametrize(
    "frames",
    [
        lambda: [contour(SHAPE)] * 3,
        lambda: [weighted(points) for points in still()],
        lambda: [
            (Observation(points, normals=np.tile([1.0, 0, 0], (N, 1))),) for points in still()
        ],
        lambda: [(Observation(p), Observation(SHAPE[RIM], end="base")) for p in still()],
        # Cut in the middle, and with a part of another surface beyond.
        lambda: [p[(p[:, 2] - CUT) * (SHAPE[RIM, 2].mean() - CUT) < 0] for p in still()],
        lambda: [np.vstack([p, p[np.abs(p[:, 2] - SHAPE[RIM, 2].mean()) < 15] * [1, 1, -1]
                 + [0, 0, 2 * SHAPE[RIM, 2].mean()]]) for p in still()],
        lambda: [p[:12] for p in still()],
    ],
    ids=["contours", "weights", "normals", "stated", "cut", "goes on", "few"],
)  # fmt: skip
def test_the_gate_is_shut(frames: Callable[[], list[Any]]) -> None:
    assert not any(endings(frames()))


@pytest.mark.parametrize("step", [6.0, 9.0, 12.0, 15.0])
def test_points_along_contours_are_told_from_a_cloud(step: float) -> None:
    for points, is_used in ((contour(SHAPE, step), False), (still(1)[0], True)):
        frames, _ = observed_frames([points])
        (given,) = with_endings(SURFACE, frames, NOISE, 0)
        assert any(isinstance(part, Ending) for part in given) == is_used


def test_without_anything_known_of_a_rim_the_gate_is_shut() -> None:
    assert all(endings(still(), pinned=0))
    assert not any(endings(still(), pinned=None))


def test_closed_surfaces_and_sheets_have_no_such_end() -> None:
    ball = breathing_spheroid(3)
    surface = Deformable.of(make_template(ball), 8)
    frames, _ = observed_frames(
        [sampled(x, ball.faces, 500, np.random.default_rng(0)) for x in ball.vertices]
    )
    assert with_endings(surface, frames, NOISE, 0) == frames
    sheet = standard_surface(Lattice(PLANE, (12, 12)))
    surface = Deformable.of(make_template(sheet), 8)
    frames, _ = observed_frames(
        [sampled(sheet.vertices[0] * 30, sheet.faces, 500, np.random.default_rng(0))]
    )
    assert with_endings(surface, frames, NOISE, 0) == frames


def test_a_tube_has_two_ends() -> None:
    tube = standard_surface(Lattice(CYLINDER, (16, 28)))
    x = tube.vertices[0] * 20.0
    start = mesh_sequence(x[None], tube.faces, topology=CYLINDER)
    surface = Deformable.of(make_template(start), 12)
    rng = np.random.default_rng(0)
    frames, _ = observed_frames([sampled(x, tube.faces, N, rng, 0.3) for _ in range(2)])
    given = with_endings(surface, frames, NOISE, 0)
    assert [part.end for part in given[1] if isinstance(part, Ending)] == ["apex", "base"]


def test_it_is_the_same_in_other_units_and_turned() -> None:
    usual = followed()
    turn, _ = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    start = mesh_sequence(SHAPE[None] @ turn.T / 1000.0, BASE.faces, topology=CUP, unit="m")
    other = track([p @ turn.T / 1000.0 for p in clouds()], start=start, modes=18, unit="m")
    found = other.sequence.vertices.astype(np.float64) * 1000.0 @ turn
    off = found - usual.sequence.vertices
    # Rounding decides when Gauss-Newton stops: a tenth of a deviation in each amplitude.
    assert np.sqrt((off**2).sum(axis=2).mean()) < 0.3 * usual.deviations[1:, :, 1].mean()


def test_the_same_data_give_the_same_bits() -> None:
    one, two = followed(), follow(clouds())
    assert np.array_equal(one.sequence.vertices, two.sequence.vertices)


def test_that_the_base_is_the_end_of_the_data_is_said() -> None:
    assert any("assumed where the data end" in note for note in followed().notes)
    assert not any("where the data end" in note for note in follow(marked(clouds())).notes)
