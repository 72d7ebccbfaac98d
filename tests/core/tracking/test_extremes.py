"""Observations that are degenerate or extreme: refused with a remedy, or tracked and said."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from clouds import Floats, breathing_spheroid, ends_of, rim_of, rms_distance, sampled

from modalmotion.errors import InputError, ShapeError
from modalmotion.mesh.sequence import mesh_sequence, standard_surface
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import CUP
from modalmotion.template import make_template
from modalmotion.tracking import Observation, Track, track
from modalmotion.tracking.deformable import require_volume
from modalmotion.tracking.result import cavity_in

N_FRAMES = 5
BALL = breathing_spheroid(N_FRAMES)
FLAT = np.array([1.0, 1.0, 0.0])


def clouds(n: int = 120, noise: float = 0.3) -> list[Floats]:
    rng = np.random.default_rng(0)
    return [sampled(x, BALL.faces, n, rng, noise) for x in BALL.vertices]


def on_a_line() -> list[Floats]:
    line: Floats = np.linspace(-1, 1, 50)[:, None] * np.array([1.0, 2.0, 3.0])
    return [line] * 3


def in_a_plane() -> list[Floats]:
    return [x * FLAT for x in clouds()]


ENDS = {"apex": [-1.0, -2.0, -3.0], "base": [1.0, 2.0, 3.0]}


@pytest.mark.parametrize(
    ("observed", "more", "match", "remedy"),
    [
        (on_a_line, {}, "Frame 0.* on a line", "open curve"),
        (on_a_line, {"topology": "cup", "landmarks": ENDS}, "on a line", "starting surface"),
        (in_a_plane, {}, "Frame 0.* in a plane", "topology to plane"),
        (lambda: [np.eye(3)[:2]] * 3, {}, "has 2 points", "starting surface"),
        (lambda: [None] * 3, {}, "Nothing was observed in any frame", "at least one frame"),
        (list, {}, "Nothing was observed in any frame", "at least one frame"),
        (lambda: [x + 1j for x in clouds()], {}, "not rows of real numbers", "one row x, y, z"),
        (
            lambda: [clouds()[0], None, []],
            {},
            "Only frame 0 of 3 was observed, which shows no motion",
            "this frame alone",
        ),
        (
            lambda: [clouds()[0], None, None],
            {"start": BALL},
            "Only frame 0 of 3 was observed",
            "one more frame",
        ),
        (
            clouds,
            {"topology": "cup", "landmarks": {"apex": [0, 0, 0], "base": [0, 0, 0]}},
            "apex and base coincide",
            "two ends",
        ),
        (
            lambda: [*clouds()[:4], np.full((9, 3), np.nan)],
            {},
            "Frame 4: Point 0 is not finite",
            "Omit such points",
        ),
        (
            lambda: [*clouds()[:2], in_a_plane()[2], *clouds()[3:]],
            {"modes": 9},
            "frame 2 the surface collapses",
            "Omit the frame",
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_shows_no_surface_is_refused_with_a_remedy(
    observed: Callable[[], list[Any]], more: dict[str, Any], match: str, remedy: str
) -> None:
    with pytest.raises(InputError, match=match) as caught:
        track(observed(), **more)
    assert remedy in caught.value.remedy


def test_a_sheet_may_be_flat_and_still_to_the_last_bit() -> None:
    rng = np.random.default_rng(0)
    sheets = [rng.uniform(-20, 20, (80, 3)) * FLAT for _ in range(3)]
    found = track(sheets, topology="plane", modes=7)
    assert np.abs(found.sequence.vertices[:, :, 2]).max() < 1e-6
    assert found.ejection_fraction is None
    assert np.isfinite(found.deviations).all()


def test_the_remedies_for_a_line_and_a_plane_work() -> None:
    assert track(on_a_line(), topology="open curve", modes=4).n_frames == 3
    start = mesh_sequence(BALL.vertices[:1], BALL.faces)
    assert track([BALL.vertices[0], *in_a_plane()[:1]], start=start, modes=2).n_frames == 2


def test_a_surface_without_a_volume_does_not_collapse() -> None:
    template = make_template(BALL)
    cavity = cavity_in(template)
    x = BALL.vertices.astype(np.float64)
    require_volume(cavity, x)
    require_volume(None, x * 0.0)
    with pytest.raises(ShapeError, match="frame 3"):
        require_volume(cavity, x * np.array([1, 1, 1, 0.1, 1])[:, None, None])


def test_a_line_in_one_frame_is_stated_in_its_deviation() -> None:
    frames = clouds()
    frames[2] = np.linspace(-30, 30, 40)[:, None] * np.array([0.0, 0.0, 1.0])
    found = track(frames, modes=9)
    others = np.delete(found.deviations, [0, 2], axis=0)
    assert np.median(found.deviations[2]) > 2.0 * np.median(others)
    assert found.coverage[2] < 0.5
    assert any("frame 2" in note for note in found.notes)


def test_two_points_a_frame_leave_the_prior() -> None:
    found = track([x[:2] for x in clouds()], start=BALL, modes=7)
    assert found.ejection_fraction_bound is not None
    assert found.ejection_fraction_bound > 5.0
    assert found.coverage.max() < 0.2


@pytest.mark.thorough
def test_repeated_points_and_frames_change_little() -> None:
    once = track(clouds(60), modes=4)
    assert once.ejection_fraction is not None
    again = track([np.repeat(x, 3, axis=0) for x in clouds(60)], modes=4)
    assert again.ejection_fraction == pytest.approx(once.ejection_fraction, abs=1.0)
    still = track([clouds(60)[0]] * 3, modes=4)
    assert still.ejection_fraction == pytest.approx(0.0, abs=1e-3)


def test_a_million_points_are_thinned_and_said() -> None:
    rng = np.random.default_rng(0)
    many = np.tile(clouds()[1], (8_334, 1)) + rng.normal(0.0, 0.3, (1_000_080, 3))
    found = track([clouds()[0], many], modes=2, start=BALL, time="open")
    assert any("more than 20,000 points" in note for note in found.notes)
    assert rms_distance(many[:200], found.sequence.vertices[1], BALL.faces) < 3.0


def test_holes_leave_the_surface_whole() -> None:
    frames = []
    for x, cloud in zip(BALL.vertices, clouds(200), strict=True):
        hole = np.linalg.norm(cloud - x[300], axis=1) < 12.0
        frames.append(cloud[~hole])
    found = track(frames, modes=9)
    x = BALL.vertices[2].astype(np.float64)
    assert rms_distance(x, found.sequence.vertices[2], found.template.faces) < 1.5


def cup_beat(turn: float) -> tuple[Floats, Any]:
    """A cup that contracts, its base turning about the axis by so many degrees."""
    base = standard_surface(Lattice(CUP, (12, 20)))
    template = make_template(mesh_sequence(base.vertices[:1] * 1.0, base.faces))
    x0 = base.vertices[0] * np.array([25.0, 25.0, 40.0])
    s = template.coordinates[:, 0]
    frames = []
    for phase in np.arange(N_FRAMES) / N_FRAMES:
        c = 0.5 - 0.5 * np.cos(2 * np.pi * phase)
        angle = np.radians(turn) * c * s
        x, y, z = x0.T * (1.0 - 0.15 * c)
        frames.append(
            np.stack(
                [x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle), z],
                axis=1,
            )
        )
    return np.stack(frames), mesh_sequence(np.stack(frames), base.faces)


def tracked_cup(turn: float, *, base_is_seen: bool = True) -> tuple[Floats, Track]:
    x, beat = cup_beat(turn)
    template = make_template(beat)
    s, rng = template.coordinates[:, 0], np.random.default_rng(0)
    rim = rim_of(template.faces, s)
    frames = []
    for frame in x:
        cloud = sampled(frame, template.faces, 200, rng, 0.3)
        apex, base = ends_of(frame, s, rim)
        seen = [Observation(cloud), apex, base]
        if not base_is_seen:
            low = frame[s < 0.5]
            near = np.linalg.norm(cloud[:, None] - low, axis=2).min(axis=1) < 6.0
            seen = [Observation(cloud[near]), apex]
        frames.append(seen)
    start = mesh_sequence(x[:1], beat.faces)
    return x, track(frames, start=start, modes=12)


def test_torsion_of_a_round_surface_is_not_seen_and_that_is_said() -> None:
    x, found = tracked_cup(30.0)
    error = found.sequence.vertices[2] - x[2]
    # The surface is round: the turn does not show, and the surface is right all the same.
    assert rms_distance(x[2], found.sequence.vertices[2], found.template.faces) < 0.6
    assert np.linalg.norm(error, axis=1).mean() > 2.0
    assert any("twist and sliding are not measured" in note for note in found.notes)
    across, along = np.median(found.deviations[2], axis=0)
    assert along > 2.0 * across


def test_a_base_that_is_never_seen_makes_the_fraction_unsure() -> None:
    _, whole = tracked_cup(0.0)
    _, part = tracked_cup(0.0, base_is_seen=False)
    assert whole.ejection_fraction_bound is not None
    assert part.ejection_fraction_bound is not None
    assert part.ejection_fraction_bound > 1.5 * whole.ejection_fraction_bound
    assert part.coverage[1:].max() < 0.8
    assert any("points are at less than 80%" in note for note in part.notes)


def test_the_winding_of_triangles_does_not_matter() -> None:
    rng = np.random.default_rng(0)
    mixed = BALL.faces.copy()
    turned = rng.random(len(mixed)) < 0.5
    mixed[turned] = mixed[turned][:, ::-1]
    usual, other, inside_out = (
        track([(x, faces) for x in BALL.vertices[:2]], start=BALL, modes=4, time="open")
        for faces in (BALL.faces, mixed, BALL.faces[:, ::-1])
    )
    assert other.sequence.vertices == pytest.approx(usual.sequence.vertices, abs=1e-3)
    assert inside_out.sequence.vertices == pytest.approx(usual.sequence.vertices, abs=1e-3)
