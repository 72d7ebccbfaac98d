"""What is stated of volumes: what lids sweep, and how far rims may be off."""

from __future__ import annotations

import numpy as np
import pytest
from clouds import breathing_spheroid, ends_of, rim_of, sampled

from modalmotion.mesh.geometry import lid_gradient, volume_gradient
from modalmotion.mesh.sequence import mesh_sequence, standard_surface
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import CUP
from modalmotion.template import make_template
from modalmotion.tracking import Observation, track
from modalmotion.tracking.quality_checks import volume_deviation
from modalmotion.tracking.result import cavity_in

BASE = standard_surface(Lattice(CUP, (12, 32)))
X = BASE.vertices[0] * 20.0
CAVITY = cavity_in(make_template(BASE))
assert CAVITY is not None
RIM = np.unique(max(CAVITY.openings, key=lambda edges: float(X[edges[:, 0], 2].mean())))
# The lattice leaves a hole at the apex, too small to matter.
TIP = np.setdiff1d(np.unique(np.concatenate(CAVITY.openings)), RIM)


def test_a_lid_sweeps_its_area_where_its_rim_moves() -> None:
    assert CAVITY is not None
    g = lid_gradient(CAVITY, X)
    middle = X[RIM].mean(axis=0)
    r = X[RIM] - middle
    radius = np.linalg.norm(r, axis=1).mean()
    assert np.abs(np.delete(g, [*RIM, *TIP], axis=0)).max() == 0.0
    g = g[RIM]
    area = float(np.linalg.norm(g.sum(axis=0)))
    assert area == pytest.approx(np.pi * radius**2, rel=0.02)
    n = g.sum(axis=0) / area
    # Tilted about its middle, or wider in its plane, it sweeps nothing.
    assert (g @ n) @ r[:, 0] == pytest.approx(0.0, abs=1e-9 * area)
    assert (g * r).sum() == pytest.approx(0.0, abs=1e-9 * area)


def test_lids_and_wall_close_the_surface() -> None:
    assert CAVITY is not None
    # Moved as a whole nothing is swept, and the lids alone sweep what the wall leaves open.
    g, lid = volume_gradient(CAVITY, X), lid_gradient(CAVITY, X)
    assert g.sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-9 * float(np.abs(g).sum()))
    wall = np.cross(
        X[CAVITY.faces[:, 1]] - X[CAVITY.faces[:, 0]], X[CAVITY.faces[:, 2]] - X[CAVITY.faces[:, 0]]
    ).sum(axis=0)
    assert lid.sum(axis=0) == pytest.approx(-wall / 2.0, abs=1e-6)


def test_what_nothing_shows_of_a_rim_counts_in_full() -> None:
    rng = np.random.default_rng(0)
    g, lid = rng.normal(size=(4, 3)), rng.normal(size=(4, 3))
    across = np.eye(12)

    def stated(along: float) -> float:
        return volume_deviation(g, lid, across, along * across, 10.0 * 0.5 / 5.0)

    alike = (g**2).sum() + (10.0 * 0.5) ** 2 / 25.0
    assert stated(1.0) == pytest.approx(alike**0.5)
    assert stated(3.0) == pytest.approx((alike + 2.0 * (lid**2).sum()) ** 0.5)
    assert stated(0.5) == pytest.approx(alike**0.5)


def test_a_volume_is_known_better_where_the_base_is_stated() -> None:
    x = X * np.array([[[1.0, 1.0, 1.0]], [[0.9, 0.9, 0.95]]])
    s = make_template(BASE).coordinates[:, 0]
    rim, rng = rim_of(BASE.faces, s), np.random.default_rng(0)
    start = mesh_sequence(x[:1], BASE.faces)
    clouds = [Observation(sampled(frame, BASE.faces, 250, rng, 0.2)) for frame in x]
    ends = [ends_of(frame, s, rim) for frame in x]
    found = [
        track(
            [[cloud, *own[:n]] for cloud, own in zip(clouds, ends, strict=True)],
            start=start,
            modes=9,
            time="open",
        ).volume_deviations
        for n in (1, 2)
    ]
    assert found[0] is not None
    assert found[1] is not None
    assert found[0][0] == found[1][0] == 0.0
    assert found[0][1] > 1.5 * found[1][1]


def test_where_the_reference_has_a_hole_its_shape_is_open_in_all_frames(
    rng: np.random.Generator,
) -> None:
    ball = breathing_spheroid(3)
    clouds = []
    for x in ball.vertices.astype(np.float64):
        points = sampled(x, ball.faces, 800, rng, noise=0.5)
        clouds.append(points[points[:, 0] < 12.0])
    whole = [sampled(x.astype(np.float64), ball.faces, 800, rng, 0.5) for x in ball.vertices]
    holed, full = (track(frames, modes=12) for frames in (clouds, whole))
    unseen, seen = (holed.template.vertices[:, 0] > 16.0, holed.template.vertices[:, 0] < 8.0)
    assert unseen.any()
    for own in holed.deviations[:, :, 0]:
        assert own[unseen].mean() > 2.0 * own[seen].mean()
    assert holed.ejection_fraction_bound is not None
    assert full.ejection_fraction_bound is not None
    assert holed.ejection_fraction_bound > 1.5 * full.ejection_fraction_bound
