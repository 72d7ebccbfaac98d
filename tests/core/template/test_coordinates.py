"""Natural coordinates where they are known exactly, and what they leave on a heart."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull, Delaunay
from template_surfaces import (
    cup_points,
    describe,
    make_ventricle,
    ring_points,
    root_mean_square,
    shared,
    sphere_points,
    tube_points,
)

from modalmotion.mesh import connectivity_of, cotangent_laplacian, vertex_areas
from modalmotion.mesh.sequence import mesh_sequence
from modalmotion.template import GivenLandmarks, Template, make_template


def template_of(vertices: np.ndarray, faces: np.ndarray, **options: object) -> Template:
    stated = options.pop("topology", None)
    sequence = mesh_sequence(vertices[None], faces, topology=stated)  # type: ignore[arg-type]
    return make_template(sequence, **options)  # type: ignore[arg-type]


def turns_between(a: np.ndarray, b: np.ndarray) -> float:
    step = a - b
    return float(np.abs(step - np.round(step)).max())


def test_cup_against_a_dense_solution() -> None:
    vertices, faces = make_ventricle(400, np.random.default_rng(0))
    start = vertices[0]
    K = cotangent_laplacian(start, faces).toarray()
    rim = np.unique(connectivity_of(faces, int(faces.max()) + 1).loops[0])
    inner = np.setdiff1d(np.arange(len(start)), rim)
    u = np.zeros(len(start))
    u[inner] = np.linalg.solve(K[np.ix_(inner, inner)], vertex_areas(start, faces)[inner])
    s = template_of(start, faces).coordinates[:, 0]
    assert s == pytest.approx((1 - u / u.max()) ** 0.625, abs=1e-10)


def test_cup_on_a_flat_disk() -> None:
    # -Laplace u = 1 on a disk: u = (1 - r^2) / 4.
    rng = np.random.default_rng(0)
    points, _ = cup_points(1600, rng)
    flat = points[:, :2] / (1 - points[:, 2:])
    flat /= np.linalg.norm(flat, axis=1).max()
    faces = Delaunay(flat).simplices
    disk = np.concatenate([flat, np.zeros((len(flat), 1))], axis=1)
    s, _ = template_of(disk, faces, topology="cup").coordinates.T
    assert s == pytest.approx(np.linalg.norm(flat, axis=1) ** 1.25, abs=0.02)


def test_cup_on_a_hemisphere() -> None:
    # A cap around the pole, its rim at polar angle a: u = 2 log(cos(t/2) / cos(a/2)).
    points, faces = cup_points(3000, np.random.default_rng(0), 0.0)
    polar = np.arccos(np.clip(-points[:, 2], -1, 1))
    a = polar.max()
    u = 2 * np.log(np.cos(polar / 2) / np.cos(a / 2))
    s, theta = template_of(
        points, faces, landmarks=GivenLandmarks(theta_zero=(1.0, 0.0, 0.0))
    ).coordinates.T
    top = 2 * np.log(1 / np.cos(a / 2))
    assert s == pytest.approx((1 - u / top) ** 0.625, abs=0.01)
    # The axis runs from the apex at the south to the rim, and theta is right-handed about it.
    clear = polar > 0.2
    azimuth = np.arctan2(points[:, 1], points[:, 0]) / (2 * np.pi)
    assert turns_between(theta[clear], azimuth[clear]) < 0.003


@pytest.mark.parametrize("height", [-0.95, -0.7, -0.4])
def test_a_cup_whose_apex_is_cut_off_keeps_the_coordinates_of_the_whole(height: float) -> None:
    points, faces = cup_points(2000, np.random.default_rng(0), 0.0)
    whole = template_of(points, faces)
    kept = faces[(points[faces][:, :, 2] > height).all(axis=1)]
    cut = template_of(points, kept, topology="cup")
    used = np.unique(kept)
    s = cut.coordinates[used, 0]
    assert s.min() > 0.05
    assert s == pytest.approx(whole.coordinates[used, 0], abs=0.03)
    assert cut.landmarks is not None
    assert whole.landmarks is not None
    assert np.abs(cut.landmarks.axis @ whole.landmarks.axis) == pytest.approx(1.0, abs=1e-3)
    assert cut.landmarks.base == pytest.approx(whole.landmarks.base, abs=1e-9)
    # Nothing is said of it: it is open at both ends.
    assert template_of(points, kept).topology.name == "cylinder"


def test_cylinder_on_a_cone() -> None:
    # Harmonic between two rings of a cone: logarithmic in the radius.
    places, faces = tube_points(2500, np.random.default_rng(0))
    r, turn = 1 + places[:, 0], 2 * np.pi * places[:, 1]
    cone = np.stack([r * np.cos(turn), r * np.sin(turn), 2 * r], axis=1)
    template = template_of(cone, faces)
    assert template.coordinates[:, 0] == pytest.approx(np.log2(r), abs=3e-3)
    # Mean slope of log2 r over the cone, which is dr / (r log 2) on sqrt 5 per unit of r.
    assert template.lengths[0] == pytest.approx(1.5 * np.log(2) * 5**0.5, rel=2e-3)


def test_sphere_on_a_round_one() -> None:
    points = sphere_points(1500, np.random.default_rng(0))
    faces = ConvexHull(points).simplices.astype(np.int64)
    axis = np.array([1.0, 2.0, -0.5]) / np.linalg.norm([1.0, 2.0, -0.5])
    given = GivenLandmarks(base=tuple(axis.tolist()), theta_zero=(0.0, 0.0, 1.0))
    template = template_of(points, faces, landmarks=given)
    polar = np.arccos(np.clip(-points @ axis, -1, 1)) / np.pi
    # The pole lies between vertices: s is off by up to half a step there.
    assert np.abs(template.coordinates[:, 0] - polar).max() < 0.02
    assert root_mean_square(template.coordinates[:, 0] - polar) < 0.004
    assert template.lengths == pytest.approx((np.pi, 4.0), rel=0.02)


def test_torus_on_a_round_one() -> None:
    places, faces = ring_points(3000, np.random.default_rng(0), 0.1)
    R, r = 3.0, 1.0
    a, b = 2 * np.pi * places.T
    ring = np.stack(
        [(R + r * np.cos(a)) * np.cos(b), (R + r * np.cos(a)) * np.sin(b), r * np.sin(a)], axis=1
    )
    template = template_of(
        ring, faces, landmarks=GivenLandmarks(theta_zero=(4.0, 0.0, 0.0), base=(0.0, 0.0, 9.0))
    )
    tube, theta = template.coordinates.T
    # About the mean distance from the axis by area, R + r^2 / 2R: there is more of it outside.
    angle = np.arctan2(r * np.sin(a), r * np.cos(a) - r**2 / (2 * R))
    assert turns_between(tube, angle / (2 * np.pi)) < 0.003
    assert turns_between(theta, b / (2 * np.pi)) < 0.002


def test_lengths_of_a_tube() -> None:
    places, faces = tube_points(2500, np.random.default_rng(0))
    turn = 2 * np.pi * places[:, 1]
    straight = np.stack([3 * np.cos(turn), 3 * np.sin(turn), 20 * places[:, 0]], axis=1)
    assert template_of(straight, faces).lengths == pytest.approx((20.0, 6 * np.pi), rel=2e-3)


@pytest.mark.parametrize(("n_modes", "bound"), [(7, 1.40), (18, 0.93), (37, 0.57)])
def test_what_few_modes_leave_on_the_real_ventricle(n_modes: int, bound: float) -> None:
    moving = shared("heart/lv_endocardium")
    found = describe(moving, n_modes)
    assert len(found.amplitudes[0]) == n_modes
    assert root_mean_square(found.fit.errors.weighted_rms) <= bound
    springs = describe(moving, n_modes, closed_form=False)
    assert root_mean_square(found.fit.errors.weighted_rms) < root_mean_square(
        springs.fit.errors.weighted_rms
    )


@pytest.mark.parametrize("n_modes", [7, 18, 37])
def test_natural_modes_leave_less_than_springs_on_a_simulated_one(n_modes: int) -> None:
    moving = make_ventricle(1000, np.random.default_rng(0))
    natural, springs = (
        root_mean_square(describe(moving, n_modes, closed_form=c).fit.errors.weighted_rms)
        for c in (True, False)
    )
    assert natural < springs
