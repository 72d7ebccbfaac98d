"""Contours: natural coordinate by arc length of the reference."""

from __future__ import annotations

import numpy as np
import pytest
from template_surfaces import PHASES, SQUEEZE, describe, fit_sequence, shared

from modalmotion.mesh.sequence import mesh_sequence
from modalmotion.signature.distance import signature_distance
from modalmotion.signature.fit import make_basis
from modalmotion.template import GivenLandmarks, choose_modes, make_template
from modalmotion.template.body_frame import body_frame

NO_FACES = np.zeros((0, 3), dtype=np.int64)


def rim(turns: np.ndarray) -> np.ndarray:
    """A closed contour that squeezes."""
    x = 2 * np.pi * turns
    frames = []
    for phase, c in zip(PHASES, SQUEEZE, strict=True):
        r = 20 * (1 + 0.2 * np.cos(x) + 0.1 * np.sin(2 * x)) * (1 - 0.3 * c + 0.1 * c * np.cos(x))
        lift = 2 * np.sin(x) * np.sin(phase)
        frames.append(np.stack([r * np.cos(x), r * np.sin(x), lift + 3], axis=1))
    return np.array(frames)


def tongue(shares: np.ndarray) -> np.ndarray:
    """An open contour that rises."""
    frames = []
    for c in SQUEEZE:
        y = 15 * np.sin(np.pi * shares) + 8 * c * np.sin(2 * np.pi * shares) + 6 * c * shares**2
        frames.append(np.stack([60 * shares - 4 * c, y, 0 * shares], axis=1))
    return np.array(frames)


def crowded(n: int, rng: np.random.Generator) -> np.ndarray:
    """Places from 0 on, below 1, spread unevenly."""
    even = np.arange(n) / n
    places = even + 0.1 * np.sin(2 * np.pi * even) + 0.2 * (rng.random(n) - 0.5) / n
    places[0] = 0.0
    return np.sort(places)


@pytest.mark.parametrize("n", [32, 64, 256])
@pytest.mark.parametrize("topology", ["closed curve", "open curve"])
def test_other_vertices_on_the_same_contour(topology: str, n: int) -> None:
    rng = np.random.default_rng(n)
    if topology == "closed curve":
        one, other = (rim(crowded(m, rng)) for m in (64, n))
    else:
        one, other = (tongue(np.append(crowded(m, rng), 1.0)) for m in (64, n))
    before = describe((one, NO_FACES), 7, topology=topology)
    after = describe((other, NO_FACES), 7, topology=topology)
    assert signature_distance(after.amplitudes, before.amplitudes) <= 0.02


def test_counting_vertices_would_not_do() -> None:
    rng = np.random.default_rng(0)
    found = []
    for n in (64, 128):
        vertices = rim(crowded(n, rng) if n == 64 else np.arange(n) / n)
        sequence = mesh_sequence(vertices, topology="closed curve", grid=(n,))
        template = make_template(sequence)
        basis = make_basis(template, choose_modes(template, 7, sequence.grid)[0])
        found.append(fit_sequence(sequence, template, basis).amplitudes)
    assert signature_distance(found[1], found[0]) > 0.2


@pytest.mark.parametrize("topology", ["closed curve", "open curve"])
def test_nothing_but_the_motion_matters(topology: str) -> None:
    vertices = (
        rim(np.arange(60) / 60) if topology == "closed curve" else tongue(np.linspace(0, 1, 60))
    )
    before = describe((vertices, NO_FACES), 7, topology=topology)
    rotation = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    rotation *= np.sign(np.linalg.det(rotation))
    moved = vertices @ rotation.T * 1e-3 + 1e3
    after = describe((moved, NO_FACES), 7, topology=topology)
    assert signature_distance(after.amplitudes * 1e3, before.amplitudes) <= 1e-9


def test_the_start_of_a_closed_curve_can_be_given() -> None:
    vertices = rim(np.arange(60) / 60)
    before = describe((vertices, NO_FACES), 7, topology="closed curve")
    rolled = np.roll(vertices, 17, axis=1)
    # Vertex 17 is the old start, and the frame of the body turns with it.
    after = describe(
        (rolled, NO_FACES), 7, topology="closed curve", landmarks=GivenLandmarks(theta_zero=17)
    )
    assert signature_distance(after.amplitudes, before.amplitudes) <= 1e-12
    between = tuple((0.25 * vertices[0, 3] + 0.75 * vertices[0, 4]).tolist())
    template = make_template(
        mesh_sequence(vertices[:1], topology="closed curve"),
        landmarks=GivenLandmarks(theta_zero=between),
    )
    theta = template.coordinates[:, 0]
    assert theta[3] == pytest.approx(-0.75 * (theta[4] - theta[3]), abs=1e-12)


def test_coordinates_are_shares_of_the_length() -> None:
    corner = np.array([[0, 0, 0], [3, 0, 0], [3, 4, 0]], dtype=np.float64)[None]
    is_open = make_template(mesh_sequence(corner, topology="open curve"))
    assert is_open.coordinates[:, 0] == pytest.approx([0, 3 / 7, 1])
    assert is_open.lengths == pytest.approx((7.0,))
    assert is_open.weights == pytest.approx([1.5 / 7, 3.5 / 7, 2 / 7])
    is_closed = make_template(mesh_sequence(corner, topology="closed curve"))
    assert is_closed.coordinates[:, 0] == pytest.approx([0, 3 / 12, 7 / 12])
    assert is_closed.lengths == pytest.approx((12.0,))


@pytest.mark.parametrize("topology", ["closed curve", "open curve"])
def test_contours_without_extent(topology: str) -> None:
    point = np.ones((2, 5, 3))
    template = make_template(mesh_sequence(point, topology=topology))
    assert np.isfinite(template.coordinates).all()
    assert template.weights == pytest.approx(np.full(5, 0.2))
    assert any("no length" in note for note in template.notes)
    line = np.linspace(0, 1, 5)[None, :, None] * [1.0, 2.0, 3.0]
    straight = make_template(mesh_sequence(line, topology=topology))
    assert straight.landmarks is not None
    assert "theta_zero" in straight.landmarks.weak


def test_the_real_contour() -> None:
    vertices, faces = shared("heart/lv_contour_64")
    before = describe((vertices, faces), 7, topology="closed curve")
    # The first vertex stays the first, for it says where theta starts.
    middles = (vertices + np.roll(vertices, -1, axis=1)) / 2
    finer = np.stack([vertices, middles], axis=2).reshape(len(vertices), -1, 3)
    for other in (finer, vertices[:, ::2]):
        after = describe((other, faces), 7, topology="closed curve")
        assert signature_distance(after.amplitudes, before.amplitudes) <= 0.02
    landmarks = before.template.landmarks
    assert landmarks is not None
    own = before.fit.amplitudes @ body_frame(landmarks).T
    assert own == pytest.approx(before.amplitudes)
