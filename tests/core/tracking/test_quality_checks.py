"""Tracks that come to an end and are doubtful: each doubt is said, and only where there is one."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from clouds import Floats, breathing_spheroid, rim_of, sampled

from modalmotion.mesh.sequence import mesh_sequence
from modalmotion.mesh.standard_surfaces import standard_surface
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topology import CUP
from modalmotion.template import make_template
from modalmotion.tracking import track
from modalmotion.tracking.quality_checks import doubtful_notes

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


THIN = mesh_sequence(BALL.vertices * np.array([1.0, 1.0, 0.008]), BALL.faces)


def thin() -> list[Floats]:
    """Give points without noise, so that it is not within noise that they lie in a plane."""
    rng = np.random.default_rng(3)
    return [sampled(x, THIN.faces, 120, rng, 0.0) for x in THIN.vertices]


@pytest.mark.parametrize(
    ("observed", "more", "said"),
    [
        (filled, {}, "fill a volume"),
        (flat, {}, "are in a plane or on a line"),
        (thin, {"start": THIN}, "are in a plane or on a line"),
        (lambda: with_frame(CLOUDS[2] / 10), {}, "In frame 2 the points extend over 2.*unit"),
        (lambda: with_frame(CLOUDS[2] + [200.0, 0, 0]), {}, "In frame 2 the surface is 200"),
        (lambda: [x[:4] for x in CLOUDS], {"start": BALL}, "percentage points only"),
        (lambda: [np.zeros((1, 3))] * 4, {"start": BALL}, "percentage points only"),
    ],
    ids=["filled", "flat", "thin", "unit", "elsewhere", "few", "one point"],
)
def test_what_is_doubtful_is_said(
    observed: Callable[[], list[Any]], more: dict[str, Any], said: str
) -> None:
    notes = " ".join(track(observed(), modes=7, **more).notes)
    assert re.search(said, notes)


CUP_SHAPE = standard_surface(Lattice(CUP, (12, 20)))
CUP_FRAMES = [
    CUP_SHAPE.vertices[0] * np.array([25.0 * f, 22.0 * f, 40.0]) for f in (1.0, 0.9, 0.8, 0.9)
]
S = make_template(mesh_sequence(CUP_FRAMES[0][None], CUP_SHAPE.faces)).coordinates[:, 0]
RIM = rim_of(CUP_SHAPE.faces, S)
APEX = [tuple(x[S.argmin()]) for x in CUP_FRAMES]
BASE = [tuple(x[RIM].mean(axis=0)) for x in CUP_FRAMES]


@pytest.mark.parametrize(
    ("landmarks", "unit", "said"),
    [
        ({}, None, "The ends of the surface were not given"),
        ({"apex": APEX[0], "base": BASE[0]}, None, "base is not stated in 3 frames, frame 1"),
        ({"apex": BASE, "base": APEX}, None, "swapped"),
        ({"apex": APEX, "base": BASE}, "um", "mm in the stated unit um"),
    ],
)
def test_what_is_doubtful_in_the_ends_of_a_surface_is_said(
    landmarks: dict[str, Any], unit: str | None, said: str
) -> None:
    rng = np.random.default_rng(4)
    clouds = [sampled(x, CUP_SHAPE.faces, 120, rng, 0.3) for x in CUP_FRAMES]
    notes = track(clouds, landmarks=landmarks, modes=7, unit=unit).notes
    assert sum(said in note for note in notes) == 1
    usual = track(clouds, landmarks={"apex": APEX, "base": BASE}, modes=7, unit="mm").notes
    assert not any(word in " ".join(usual) for word in ("Nobody", "not stated", "swapped", "check"))


def test_an_oval_ball_that_is_well_seen_leaves_no_doubt() -> None:
    assert doubtful_notes(track(CLOUDS, start=BALL, modes=7)) == []


def test_a_turn_that_does_not_show_is_named_with_its_axis() -> None:
    round_about_x = BALL.vertices[:, :, [2, 0, 1]].astype(np.float64)
    round_about_x[:, :, 1] *= 22.0 / 25.0
    rng = np.random.default_rng(3)
    clouds = [sampled(x, BALL.faces, 120, rng, 0.3) for x in round_about_x]
    (doubt,) = doubtful_notes(track(clouds, modes=7))
    assert "so round about the axis (1.00, " in doubt
    assert "torsion" in doubt
