"""Tracks that come to an end and are doubtful: each doubt is said, and only where there is one."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from clouds import Floats, breathing_spheroid, rim_of, sampled

from modalmotion.errors import ShapeError
from modalmotion.mesh.sequence import mesh_sequence, standard_surface
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import CUP
from modalmotion.template import make_template
from modalmotion.tracking import track
from modalmotion.tracking.quality_checks import notes_on

BALL = breathing_spheroid(4)
RNG = np.random.default_rng(0)
CLOUDS = [sampled(x, BALL.faces, 120, RNG, 0.3) for x in BALL.vertices]


def with_frame(frame: Floats) -> list[Floats]:
    return [*CLOUDS[:2], frame, CLOUDS[3]]


def filled() -> list[Floats]:
    rng = np.random.default_rng(1)
    return [x * rng.uniform(0.0, 1.0, (len(x), 1)) ** (1 / 3) for x in CLOUDS]


def flat() -> list[Floats]:
    rng = np.random.default_rng(2)
    return [rng.uniform(-20, 20, (60, 3)) * [1.0, 1.0, 0.05] for _ in range(3)]


@pytest.mark.parametrize(
    ("observed", "more", "said"),
    [
        (filled, {}, "fill a volume"),
        (flat, {}, "are in a plane or on a line"),
        (
            lambda: with_frame(CLOUDS[2] * 5),
            {},
            "In frame 2 the data are .* of another size.*unit",
        ),
        (lambda: with_frame(CLOUDS[2] + [200.0, 0, 0]), {}, "In frame 2 the data are elsewhere"),
        (lambda: [x[:4] for x in CLOUDS], {"start": BALL}, "percentage points only"),
        (lambda: [np.zeros((1, 3))] * 4, {"start": BALL}, "percentage points only"),
    ],
    ids=["filled", "flat", "unit", "elsewhere", "few", "one point"],
)
def test_what_is_doubtful_is_said(
    observed: Callable[[], list[Any]], more: dict[str, Any], said: str
) -> None:
    notes = " ".join(map(str, track(observed(), modes=7, **more).notes))
    assert re.search(said, notes)


def test_a_frame_in_another_unit_collapses_and_is_refused() -> None:
    with pytest.raises(ShapeError, match="frame 2 the surface collapses") as caught:
        track(with_frame(CLOUDS[2] / 10.0), modes=7)
    assert "unit of each frame" in caught.value.remedy


CUP_SHAPE = standard_surface(Lattice(CUP, (12, 20)))
CUP_FRAMES = [
    CUP_SHAPE.vertices[0] * np.array([25.0 * f, 22.0 * f, 40.0]) for f in (1.0, 0.9, 0.8, 0.9)
]
S = make_template(mesh_sequence(CUP_FRAMES[0][None], CUP_SHAPE.faces)).coordinates[:, 0]
RIM = rim_of(CUP_SHAPE.faces, S)
APEX = [tuple(x[S.argmin()]) for x in CUP_FRAMES]
BASE = [tuple(x[RIM].mean(axis=0)) for x in CUP_FRAMES]


def cup_clouds() -> list[Floats]:
    rng = np.random.default_rng(4)
    return [sampled(x, CUP_SHAPE.faces, 120, rng, 0.3) for x in CUP_FRAMES]


def test_ends_that_are_given_in_every_frame_leave_no_doubt() -> None:
    notes = track(cup_clouds(), landmarks={"apex": APEX, "base": BASE}, modes=7, unit="mm").notes
    assert not any(
        word in " ".join(map(str, notes)) for word in ("Nobody", "not stated", "swapped", "check")
    )


@pytest.mark.parametrize(
    ("landmarks", "said"),
    [
        ({}, "The ends of the surface were not given"),
        ({"apex": APEX[0], "base": BASE[0]}, "base is not stated in 3 frames, frame 1"),
        ({"apex": BASE, "base": APEX}, "swapped"),
    ],
)
def test_what_is_doubtful_in_the_ends_of_a_surface_is_said(
    landmarks: dict[str, Any], said: str
) -> None:
    notes = track(cup_clouds(), landmarks=landmarks, modes=7).notes
    assert sum(said in note for note in notes) == 1


def test_a_ball_that_is_well_seen_leaves_no_doubt() -> None:
    (offsets,) = notes_on(track(CLOUDS, start=BALL, modes=7))
    assert "twist and sliding are not measured" in offsets
