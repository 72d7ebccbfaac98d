"""The equilibrium of a frame, reached by Gauss-Newton."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from clouds import breathing_spheroid, rim_of, sampled

from modalmotion.mesh.geometry import vertex_normals
from modalmotion.mesh.sequence import standard_surface
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import SPHERE
from modalmotion.simulate import Acquisition, simulate_ventricle
from modalmotion.template import make_template
from modalmotion.tracking import Observation
from modalmotion.tracking.closest import closest_points
from modalmotion.tracking.deformable import Deformable
from modalmotion.tracking.map_frames import map_frame
from modalmotion.tracking.noise import Noise, Prior
from modalmotion.tracking.normal_equations import bulge, normal_equations

BEAT = simulate_ventricle(grid=(16, 24), acquisition=Acquisition(n_frames=6))
TEMPLATE = make_template(BEAT)
RIM = rim_of(TEMPLATE.faces, TEMPLATE.coordinates[:, 0])
CLOSED = breathing_spheroid()
CLOSED_TEMPLATE = make_template(CLOSED)
NOISE = Noise(sd=1.0, truncation=0.3, n_values=60.0)


def frame_at(k: int, n: int, rng: np.random.Generator) -> tuple[Observation, ...]:
    x = CLOSED.vertices[k].astype(np.float64)
    cloud = sampled(x, CLOSED.faces, n, rng, noise=0.5)
    return (Observation(cloud), Observation(x[[0, 300]], sd=1.0, places=(0, 300)))


def test_force_is_the_slope_of_the_cost(rng: np.random.Generator) -> None:
    surface = Deformable.of(CLOSED_TEMPLATE, 7)
    cloud = frame_at(1, 300, rng)[0]
    a, step = 0.5 * rng.normal(size=(7, 3)), 1e-5 * rng.normal(size=(7, 3))
    # Noise of its own lifts points off a round surface, which is taken off.
    noise = replace(NOISE, sd=1e-3)
    found = normal_equations(surface, a, (cloud,), noise)
    force = found.vector - found.matrix @ a.ravel()
    variance = float(noise.variances(None, float(found.weights.sum())))
    # Weights held: half the squared distances, before and after.
    squares = [
        closest_points(cloud.points, surface.positions(a + s), surface.cells).distances ** 2
        for s in (-step, step)
    ]
    rise = float((found.weights * (squares[1] - squares[0])).sum()) / 2.0 / variance
    assert 2.0 * force @ step.ravel() == pytest.approx(-rise, rel=1e-2)


def test_noise_lifts_points_off_what_is_round_and_not_off_what_is_flat(
    rng: np.random.Generator,
) -> None:
    ball = standard_surface(Lattice(SPHERE, (20, 32)))
    for radii, lifted in (((10.0, 10.0, 10.0), 1.0 / 10.0), ((2e3, 2e3, 2e3), 0.0)):
        x = ball.vertices[0] * np.array(radii)
        points = sampled(x, ball.faces, 8000, rng, noise=1.0)
        found = closest_points(points, x, ball.faces)
        heights = ((points - found.feet) * found.normals[:, 0]).sum(axis=1)
        outward = np.sign((found.normals[:, 0] * found.feet).sum())
        stated = outward * bulge(found, x, ball.faces, 1.0)
        assert stated.mean() == pytest.approx(lifted, abs=0.01)
        assert outward * heights.mean() == pytest.approx(lifted, abs=0.04)
    # Noise as large as the radius: no more than half a deviation.
    x = ball.vertices[0].astype(np.float64)
    found = closest_points(x * 1.1, x, ball.faces)
    assert np.abs(bulge(found, x, ball.faces, 4.0)).max() == pytest.approx(1.0)


def test_the_equilibrium_balances_data_and_prior(rng: np.random.Generator) -> None:
    surface = Deformable.of(CLOSED_TEMPLATE, 18)
    variances = Prior.broad(surface.size).variances(surface.wavenumbers)
    own = map_frame(surface, frame_at(2, 400, rng), np.zeros((len(surface), 3)), variances, NOISE)
    K = surface.stiffness(variances)
    H = own.information.matrix + K
    assert own.covariance @ H == pytest.approx(np.eye(len(K)), abs=1e-6)
    a = own.amplitudes.ravel()
    force = own.information.vector - own.information.matrix @ a
    assert force == pytest.approx(K @ a, abs=1e-6 * np.abs(own.information.vector).max())


def test_a_point_beyond_the_rim_does_not_pull_along_it(rng: np.random.Generator) -> None:
    surface = Deformable.of(TEMPLATE, 7)
    x = TEMPLATE.vertices
    s = TEMPLATE.coordinates[:, 0]
    beyond = x[RIM] + 4.0 * (x[RIM].mean(axis=0) - x[s.argmin()]) / 80.0
    found = normal_equations(surface, np.zeros((7, 3)), (Observation(beyond),), NOISE)
    assert (found.weights == 0).mean() > 0.9


def test_of_two_triangles_as_near_as_each_other_either_says_the_same(
    rng: np.random.Generator,
) -> None:
    surface, a = Deformable.of(TEMPLATE, 7), np.zeros((7, 3))
    x = surface.positions(a)
    # Outside the side at which a triangle of the rim meets one that is none.
    of_rim = surface.rim[surface.cells].any(axis=1)
    sides = np.sort(surface.cells[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 3, 2), axis=2)
    here, beyond = (set(map(tuple, sides[k].reshape(-1, 2).tolist())) for k in (of_rim, ~of_rim))
    between = np.array(sorted(here & beyond))
    out = vertex_normals(x, surface.cells)
    points = np.concatenate([(x + d * out)[between].mean(axis=1) for d in (-3.0, 3.0)])
    one, other = (
        normal_equations(surface, a, (Observation(points + noise),), NOISE)
        for noise in 1e-11 * rng.normal(size=(2, *points.shape))
    )
    # Rounding decides which triangle it is.
    differ = (one.feet != other.feet).any(axis=1)
    assert (surface.rim[one.feet].any(axis=1) != surface.rim[other.feet].any(axis=1))[differ].any()
    assert one.residuals == pytest.approx(other.residuals, abs=1e-8)


@pytest.mark.parametrize("thickness", [0.4, 100.0], ids=["contours", "cloud"])
def test_iterations_come_to_rest_wherever_the_origin_is(
    thickness: float, rng: np.random.Generator
) -> None:
    x = BEAT.vertices[2].astype(np.float64)
    points = sampled(x, BEAT.faces, 6000, rng, noise=0.5)
    heights = (points - x.mean(axis=0)) @ np.array([0.1, 0.2, 1.0])
    points = points[np.abs(heights % 10.0) < thickness][:400]
    at_rest = []
    for origin in (np.zeros(3), np.array([300.0, -500.0, 200.0])):
        template = replace(TEMPLATE, vertices=TEMPLATE.vertices + origin)
        surface = Deformable.of(template, 37).exact_for_affine()
        frame = (Observation(points + origin),)
        prior = Prior.broad(surface.size).variances(surface.wavenumbers)
        a = np.zeros((len(surface), 3))
        for _ in range(15):
            found = normal_equations(surface, a, frame, NOISE)
            H = found.matrix + surface.stiffness(prior)
            step = np.linalg.solve(H, found.vector) - a.ravel()
            a = a + step.reshape(-1, 3)
        # Of a standard deviation of each amplitude; normals that jump leave 0.07 for ever.
        assert float(step @ H @ step) < 1e-4 * len(step)
        at_rest.append(a)
    assert at_rest[0] == pytest.approx(at_rest[1], abs=1e-6)
