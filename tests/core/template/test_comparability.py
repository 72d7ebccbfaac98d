"""The same motion gives the same signature, however the surface is triangulated and placed."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from template_remeshing import remeshed, subdivided
from template_surfaces import (
    MAKERS,
    Described,
    Moving,
    describe,
    fit_sequence,
    make_ventricle,
    shared,
)

from modalmotion.mesh.sequence import mesh_sequence
from modalmotion.modes import ModeSet
from modalmotion.signature.distance import resample_to_phase, signature_distance, theta_invariants
from modalmotion.signature.fit import make_basis
from modalmotion.template import GivenLandmarks, choose_modes, make_template
from modalmotion.template.body_frame import Components

# The bound that is promised, and what was measured with room for another seed.
PROMISED = 0.02
REACHED = {"cup": 0.004, "cylinder": 0.002, "torus": 0.002, "plane": 0.002, "sphere": 0.013}


@pytest.fixture(scope="module", name="heart")
def _heart() -> Moving:
    return make_ventricle(1400, np.random.default_rng(0))


@cache
def usual(topology: str) -> tuple[Moving, Described]:
    """A surface of each topology, and what is said of it."""
    moving = MAKERS[topology](1400, np.random.default_rng(0))
    return moving, describe(moving, 18, topology=topology)


@cache
def real_ones_again() -> list[Moving]:
    """The real ventricle on other triangles."""
    moving = shared("heart/lv_endocardium")
    n = moving[0].shape[1]
    others = [remeshed(moving, m, np.random.default_rng(m)) for m in (n // 2, n, 4 * n)]
    return [subdivided(moving), *others]


def turned(moving: Moving, rng: np.random.Generator) -> Moving:
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return moving[0] @ (rotation * np.sign(np.linalg.det(rotation))).T, moving[1]


def renumbered(moving: Moving, rng: np.random.Generator) -> Moving:
    order = rng.permutation(moving[0].shape[1])
    faces = np.argsort(order)[moving[1]]
    return moving[0][:, order], np.roll(faces[rng.permutation(len(faces))], 1, axis=1)


@pytest.mark.every(3)
@pytest.mark.parametrize("topology", sorted(MAKERS))
@pytest.mark.parametrize(
    "change", ["turned", "reversed", "moved", "renumbered", "metres", "half reversed"]
)
def test_nothing_but_the_motion_matters(topology: str, change: str) -> None:
    rng = np.random.default_rng(1)
    (vertices, faces), before = usual(topology)
    unit = 1.0
    if change == "turned":
        vertices, faces = turned((vertices, faces), rng)
    elif change == "reversed":
        faces = faces[:, ::-1]
    elif change == "half reversed":
        faces = np.where(rng.random((len(faces), 1)) < 0.5, faces[:, ::-1], faces)
    elif change == "moved":
        vertices = vertices + 1e6
    elif change == "renumbered":
        vertices, faces = renumbered((vertices, faces), rng)
    else:
        unit = 1e-3
        vertices = vertices * unit
    after = describe((vertices, faces), 18, topology=topology)
    assert signature_distance(after.amplitudes / unit, before.amplitudes) <= 1e-9
    assert after.fit.errors.weighted_rms / unit == pytest.approx(
        before.fit.errors.weighted_rms, rel=1e-9, abs=1e-9
    )
    assert after.template.lengths == pytest.approx(
        [unit * length for length in before.template.lengths], rel=1e-9
    )


@pytest.mark.every(4)
@pytest.mark.parametrize("topology", sorted(MAKERS))
@pytest.mark.parametrize(("n", "jitter"), [(1400, 0.4), (700, 0.2), (5600, 0.2)])
def test_another_triangulation_moves_it_little(topology: str, n: int, jitter: float) -> None:
    _, before = usual(topology)
    moving = MAKERS[topology](n, np.random.default_rng(2), jitter)
    after = describe(moving, 18, topology=topology)
    distance = signature_distance(after.amplitudes, before.amplitudes)
    assert distance <= REACHED[topology] <= PROMISED


@pytest.mark.parametrize("components", list(Components))
def test_so_do_components_of_the_place(components: Components) -> None:
    before = describe(make_ventricle(1400, np.random.default_rng(0)), 18, components=components)
    after = describe(make_ventricle(700, np.random.default_rng(3)), 18, components=components)
    assert signature_distance(after.amplitudes, before.amplitudes) <= 0.006


@pytest.mark.thorough
@pytest.mark.every(3)
@pytest.mark.parametrize("n_modes", [7, 18, 37])
def test_the_real_ventricle_on_another_triangulation(n_modes: int) -> None:
    before = describe(shared("heart/lv_endocardium"), n_modes)
    for other in real_ones_again():
        distance = signature_distance(describe(other, n_modes).amplitudes, before.amplitudes)
        assert distance <= 0.013 <= PROMISED


def test_the_real_ventricle_turned_and_moved() -> None:
    rng = np.random.default_rng(4)
    moving = shared("heart/lv_endocardium")
    before = describe(moving, 37)
    vertices, faces = renumbered(turned(moving, rng), rng)
    after = describe((vertices * 1e-3 + 1e3, faces[:, ::-1]), 37)
    assert signature_distance(after.amplitudes * 1e3, before.amplitudes) <= 1e-9


def test_moving_the_start_angle_only_turns_each_pair(heart: Moving) -> None:
    before = describe(heart, 37)
    place = int(np.argmax(heart[0][0] @ [1.0, -0.7, 0.1]))
    after = describe(heart, 37, landmarks=GivenLandmarks(theta_zero=place))
    assert before.template.landmarks is not None
    assert after.template.landmarks is not None
    assert after.template.landmarks.given == ("theta_zero",)
    zero, axis = before.template.landmarks.theta_zero, before.template.landmarks.axis
    new = after.template.landmarks.theta_zero
    phi = np.arctan2(np.cross(zero, new) @ axis, zero @ new)
    assert abs(phi) > 0.3
    # Back by hand: theta was theta' + phi / 2 pi, and so were the two directions across.
    modes = choose_modes(before.template, 37)[0]
    assert isinstance(modes, ModeSet)
    turn = np.array([[np.cos(phi), -np.sin(phi), 0], [np.sin(phi), np.cos(phi), 0], [0, 0, 1]])
    back = after.amplitudes @ turn.T
    index = {label: k for k, label in enumerate(modes.labels)}
    result = back.copy()
    for label, k in index.items():
        if label.part == "cos" and label._replace(part="sin") in index:
            j, p = index[label._replace(part="sin")], label.wavenumbers[1]
            result[:, k] = np.cos(p * phi) * back[:, k] - np.sin(p * phi) * back[:, j]
            result[:, j] = np.sin(p * phi) * back[:, k] + np.cos(p * phi) * back[:, j]
    assert signature_distance(result, before.amplitudes) <= 1e-9
    invariants = [theta_invariants(d.amplitudes, modes) for d in (before, after)]
    assert signature_distance(invariants[1], invariants[0]) <= 1e-9
    # Without that the start angle would read as another motion.
    assert signature_distance(after.amplitudes, before.amplitudes) > 0.1


def test_components_of_the_place_only_turn_pairs(heart: Moving) -> None:
    place = int(np.argmax(heart[0][0] @ [1.0, -0.7, 0.1]))
    before, after = (
        describe(heart, 18, components=Components.CYLINDRICAL, landmarks=given)
        for given in (None, GivenLandmarks(theta_zero=place))
    )
    modes = choose_modes(before.template, 18)[0]
    assert isinstance(modes, ModeSet)
    one, other = (
        theta_invariants(d.amplitudes, modes, Components.CYLINDRICAL) for d in (before, after)
    )
    assert signature_distance(other, one) <= 1e-9


@pytest.mark.parametrize("n_frames", [12, 25])
def test_twice_the_frame_rate(heart: Moving, n_frames: int) -> None:
    vertices, faces = heart
    slow, fast = (
        describe((resample_to_phase(vertices, n), faces)).amplitudes
        for n in (n_frames, 2 * n_frames)
    )
    assert signature_distance(resample_to_phase(slow, 2 * n_frames), fast) <= 1e-6


def test_uneven_times(heart: Moving) -> None:
    vertices, faces = heart
    dense = resample_to_phase(vertices, 400)
    chosen = np.sort(np.random.default_rng(5).choice(399, 29, replace=False)) + 1
    chosen = np.concatenate([[0], chosen])
    evenly = resample_to_phase(vertices, 24)
    # One template: which frames there are moves the axes of their mean.
    template = make_template(mesh_sequence(evenly, faces))
    basis = make_basis(template, choose_modes(template, 7)[0])
    path, even = (
        fit_sequence(mesh_sequence(x, faces), template, basis).amplitudes
        for x in (dense[chosen], evenly)
    )
    found = resample_to_phase(path, 24, times=chosen / 400, period=1.0)
    assert signature_distance(found, even) <= 1e-4
