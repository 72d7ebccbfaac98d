"""The simulated ventricle moves as its parameters say, everywhere on its surface."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from modalmotion.errors import ParameterError
from modalmotion.simulate import Pose, Spacing, VentricleParameters
from modalmotion.simulate.parameters import (
    TERRITORY_CENTRES,
    Beat,
    SmoothField,
    Territory,
    random_field,
)
from modalmotion.simulate.surface import Spheroid, directions, random_rotation, rotation_matrix
from modalmotion.simulate.ventricle import MaterialPoints, region_weight

HEALTHY = VentricleParameters()
STILL = SmoothField(np.zeros((1, 3)), np.zeros(1), np.zeros((1, 3)))


def motion_of(
    parameters: VentricleParameters,
    nu: ArrayLike,
    theta: ArrayLike,
    *fields: SmoothField,
) -> MaterialPoints:
    angles = np.broadcast_arrays(np.atleast_1d(nu), np.atleast_1d(theta))
    polar, azimuth = (np.array(a, dtype=np.float64) for a in angles)
    shape, displacement, lag = fields or (STILL, STILL, STILL)
    return MaterialPoints(parameters, polar, azimuth, shape, displacement, lag)


def base_of(parameters: VentricleParameters) -> float:
    return float(np.radians(parameters.truncation))


def end_systole(parameters: VentricleParameters) -> float:
    return parameters.beat.end_systole


@given(
    period=st.floats(0.45, 2.0),
    early=st.floats(0.2, 1.0),
    delay=st.floats(0.0, 0.05),
)
def test_a_beat_begins_and_ends_at_rest_and_stays_between(
    period: float, early: float, delay: float
) -> None:
    beat = Beat(period, early)
    assert beat.end_systole < beat.relaxed < beat.filled < period
    late = np.array([0.0, delay])
    curve = np.array([beat.contraction(t, late) for t in np.linspace(0.0, period, 300)])
    assert np.abs(curve[[0, -1]]).max() <= 1e-12
    assert curve.min() >= -1e-12
    assert curve.max() <= 1 + 1e-12
    assert beat.twist(0.0) == beat.twist(period) == beat.flash(0.0) == 0.0
    # The volume rests from the end of ejection to the end of isovolumic relaxation.
    for t in (beat.end_systole, beat.relaxed):
        assert beat.contraction(t, np.zeros(1)) == pytest.approx(1.0, abs=1e-12)


def test_a_third_of_the_untwisting_comes_before_filling() -> None:
    beat = HEALTHY.beat
    assert beat.twist(beat.end_systole) == pytest.approx(1.0)
    assert 1.0 - beat.twist(beat.relaxed) == pytest.approx(0.37, abs=0.02)


def test_a_late_wall_does_the_same_later() -> None:
    beat = HEALTHY.beat
    times = np.linspace(0.1, 0.7 * beat.filled, 20)
    on_time = [beat.contraction(t, np.zeros(1)) for t in times]
    late = [beat.contraction(t + 0.07, np.array([0.07])) for t in times]
    assert np.allclose(on_time, late, rtol=0, atol=1e-12)


def test_the_axis_shortens_by_the_stated_share() -> None:
    p = replace(HEALTHY, longitudinal_shortening=0.21, apex_share=0.4)
    motion = motion_of(p, [0.0, base_of(p)], 0.0)
    rest, systole = motion.positions(0.0, 0.3), motion.positions(end_systole(p), 0.3)
    assert rest[:, 2] == pytest.approx([0.0, p.length])
    assert systole[1, 2] - systole[0, 2] == pytest.approx(p.length * (1 - 0.21), rel=1e-12)
    assert systole[0, 2] == pytest.approx(0.4 * 0.21 * p.length)


def test_apex_and_base_turn_as_seen_from_the_apex() -> None:
    p = replace(HEALTHY, apex_rotation=12.0, base_rotation=-5.0)
    for nu, degrees in ((1e-4, 12.0), (base_of(p), -5.0)):
        motion = motion_of(p, nu, 0.3)
        rest, systole = (motion.positions(t, 0.3)[0] for t in (0.0, end_systole(p)))
        # Seen along +z, from below, counterclockwise is the negative sense about +z.
        angle = np.arctan2(rest[1], rest[0]) - np.arctan2(systole[1], systole[0])
        assert np.degrees(angle) == pytest.approx(degrees, abs=1e-3)


@pytest.mark.parametrize("territory", Territory)
def test_an_akinetic_wall_does_not_move_inward_and_the_opposite_wall_does(
    territory: Territory,
) -> None:
    azimuth, height = TERRITORY_CENTRES[territory]
    p = replace(HEALTHY, akinesia=1.0, akinesia_azimuth=azimuth, akinesia_height=height)
    nu = 2 * np.arcsin(np.sqrt(height * np.sin(base_of(p) / 2) ** 2))
    motion = motion_of(p, nu, np.radians([azimuth, azimuth + 180.0]))
    rest, systole = (np.hypot(*motion.positions(t, 0.4)[:, :2].T) for t in (0.0, end_systole(p)))
    assert systole[0] == pytest.approx(rest[0], rel=1e-12)
    assert systole[1] < 0.65 * rest[1]


def test_height_is_what_a_fine_sum_along_the_wall_gives() -> None:
    p = replace(HEALTHY, akinesia=1.0, delay=0.1, septal_flash=0.3, apex_share=0.0)
    time, theta = 0.25, 3.9
    nu = np.linspace(0.0, base_of(p), 20_001)
    middle = (nu[1:] + nu[:-1]) / 2
    n = directions(middle, np.full_like(middle, theta))
    late = (1.0 + n[:, 0]) / 2
    flash = p.septal_flash * (1.0 - late) ** 2
    q = (1.0 - flash) * p.beat.contraction(time, p.delay * late) + flash * p.beat.flash(time)
    # Along the axis the region lacks half of what it lacks towards it.
    q *= 1.0 - 0.5 * region_weight(p, n)
    height = Spheroid(p.length, p.radius, base_of(p)).height_at(nu)
    summed = ((1.0 - p.longitudinal_shortening * q) * np.diff(height)).sum()
    motion = motion_of(p, base_of(p), theta)
    assert motion.positions(time, 0.3)[0, 2] == pytest.approx(summed, rel=1e-4)


def test_the_lateral_wall_contracts_late_in_left_bundle_branch_block() -> None:
    p = replace(HEALTHY, delay=0.12, delay_azimuth=0.0)
    # The polar angle of the equator: there the walls are the full delay apart.
    motion = motion_of(p, np.pi / 2, np.radians([0.0, 180.0]))
    times = np.linspace(0.0, p.beat.end_systole + 0.12, 400)
    radii = np.array([np.hypot(*motion.positions(t, 0.3)[:, :2].T) for t in times])
    halfway = radii[0] * (1 - 0.15 * (1 - 0.5 * (1 / (1 - np.cos(base_of(p)))) ** 4))
    lateral, septal = (times[np.argmax(radii[:, i] < halfway[i])] for i in (0, 1))
    assert lateral - septal == pytest.approx(0.12, abs=0.005)


def test_the_septum_flashes_before_ejection() -> None:
    p = replace(HEALTHY, delay=0.1, septal_flash=0.3)
    motion = motion_of(p, np.pi / 2, np.radians([180.0, 0.0]))
    rest, early = (np.hypot(*motion.positions(t, 0.3)[:, :2].T) for t in (0.0, 0.07))
    septal, lateral = 1 - early / rest
    assert septal > 0.05
    assert abs(lateral) < 0.001


@pytest.mark.parametrize(
    "change",
    [
        {},
        {"akinesia": 1.2, "akinesia_height": 0.02},
        {"delay": 0.12, "septal_flash": 0.4},
        {"shape_variation": 2.0, "motion_variation": 2.0},
    ],
)
def test_the_motion_has_no_kink_at_the_apex(
    change: dict[str, float], rng: np.random.Generator
) -> None:
    p = replace(HEALTHY, **change)
    fields = [random_field(p.motion_variation, 0.5, rng) for _ in range(3)]
    step = 1e-4
    for theta in np.radians([0.0, 50.0, 130.0]):
        across = motion_of(p, [step, 0.0, step], [theta, 0.0, theta + np.pi], *fields)
        u = across.positions(0.2, 0.4) - across.positions(0.0, 0.4)
        slopes = (u[0] - u[1]) / step, (u[1] - u[2]) / step
        # A smooth function's one-sided slopes differ by its curvature times the step.
        assert np.abs(slopes[0] - slopes[1]).max() <= 1e3 * step


def test_the_motion_is_periodic(rng: np.random.Generator) -> None:
    p = replace(HEALTHY, delay=0.1, septal_flash=0.2, akinesia=0.7)
    fields = [random_field(2.0, 0.5, rng) for _ in range(3)]
    motion = motion_of(p, [0.2, 1.0, 1.9], [0.1, 2.0, 4.0], *fields)
    assert np.allclose(motion.positions(0.0, 0.4), motion.positions(p.period, 0.4), atol=1e-9)


def test_a_random_field_has_its_size_and_is_smooth(rng: np.random.Generator) -> None:
    fields = [random_field(1.5, 0.5, rng) for _ in range(300)]
    x = rng.standard_normal((50, 3))
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    values = np.array([f.at(x) for f in fields])
    assert np.sqrt((values**2).sum(axis=-1).mean()) == pytest.approx(1.5, rel=0.05)
    # Covariance exp(-d^2 / 2 l^2) at the distance d.
    shifted = np.array([f.at(x + np.array([0.25, 0.0, 0.0])) for f in fields])
    assert (values * shifted).mean() / (values**2).mean() == pytest.approx(
        np.exp(-(0.25**2) / (2 * 0.5**2)), abs=0.03
    )


@pytest.mark.parametrize("spacing", Spacing)
def test_rows_are_equally_far_apart(spacing: Spacing) -> None:
    spheroid = Spheroid(90.0, 26.0, 2.0)
    nu = spheroid.polar_angle(np.linspace(0.0, 1.0, 9), spacing)
    if spacing == Spacing.HEIGHT:
        steps = np.diff(spheroid.height_at(nu))
    else:
        fine = [np.linspace(a, b, 2000) for a, b in pairwise(nu)]
        steps = np.array(
            [
                np.hypot(np.diff(spheroid.radius_at(f)), np.diff(spheroid.height_at(f))).sum()
                for f in fine
            ]
        )
    assert np.allclose(steps, steps.mean(), rtol=1e-5)
    assert nu[[0, -1]] == pytest.approx([0.0, 2.0])


def test_the_disc_is_a_conformal_image() -> None:
    spheroid = Spheroid(90.0, 26.0, 2.0)
    nu, h = np.linspace(0.05, 1.95, 20), 1e-4
    rho = spheroid.isothermal_radius(nu)
    slope = (spheroid.isothermal_radius(nu + h) - spheroid.isothermal_radius(nu - h)) / (2 * h)
    # The same scale along a meridian and around.
    assert np.allclose(slope / spheroid.speed_at(nu), rho / spheroid.radius_at(nu), rtol=1e-3)
    assert float(spheroid.isothermal_radius(np.array(2.0))) == pytest.approx(1.0)


@settings(max_examples=30)
@given(st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3))
def test_rotation_vectors_are_scipys(vector: list[float]) -> None:
    assert np.allclose(
        rotation_matrix(np.array(vector)), Rotation.from_rotvec(vector).as_matrix(), atol=1e-12
    )


def test_a_pose_is_rigid_and_its_drift_comes_back(rng: np.random.Generator) -> None:
    pose = Pose(random_rotation(rng), (5.0, -3.0, 100.0), (0.05, 0.1, 0.0), (2.0, 0.0, 1.0))
    body = rng.standard_normal((1, 6, 3)) * 30
    placed = pose.place(np.repeat(body, 3, axis=0), np.array([0.0, 0.5, 1.0]), np.zeros(3))
    for frame in placed:
        apart = np.linalg.norm(frame[:, None] - frame, axis=-1)
        assert np.allclose(apart, np.linalg.norm(body[0][:, None] - body[0], axis=-1))
    assert np.allclose(placed[0], placed[2])
    assert np.abs(placed[1] - placed[0]).max() > 1.0


@pytest.mark.parametrize(
    ("change", "parameter"),
    [
        ({"ejection_fraction": 0.9}, "ejection_fraction"),
        ({"length": float("nan")}, "length"),
        ({"radius": -1.0}, "radius"),
        ({"period": 0.0}, "period"),
        ({"akinesia": 2.0}, "akinesia"),
        ({"period": 0.5, "delay": 0.2}, "delay"),
    ],
)
def test_parameters_out_of_range_are_refused_by_name(
    change: dict[str, float], parameter: str
) -> None:
    with pytest.raises(ParameterError) as caught:
        replace(HEALTHY, **change)
    assert caught.value.details["parameter"] == parameter
    assert caught.value.remedy


def test_a_pose_that_is_not_finite_is_refused() -> None:
    with pytest.raises(ParameterError):
        Pose(translation=(0.0, float("inf"), 0.0))


def test_derived_numbers_follow_from_the_parameters() -> None:
    assert HEALTHY.twist == HEALTHY.apex_rotation - HEALTHY.base_rotation
