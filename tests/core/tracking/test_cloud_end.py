"""Where a cloud ends: its density says so, whatever the noise along it and whatever fills space."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from clouds import Floats

from modalmotion.mesh import lattice_faces
from modalmotion.mesh.sequence import mesh_sequence
from modalmotion.modes.topologies import CYLINDER
from modalmotion.template import make_template
from modalmotion.tracking.closest import closest_points
from modalmotion.tracking.deformable import Deformable, Rim, rim_of
from modalmotion.tracking.ends_of_data import DataEnd, end_of_cloud

RADIUS, LENGTH, N = 25.0, 60.0, 4000


def tube() -> Deformable:
    """A tube along z, its end at z = LENGTH, in rows 3 mm apart."""
    turn = 2.0 * np.pi * np.arange(48) / 48
    ring = np.stack([RADIUS * np.cos(turn), RADIUS * np.sin(turn)], axis=1)
    rows = [np.column_stack([ring, np.full(48, z)]) for z in np.linspace(0.0, LENGTH, 21)]
    x = np.concatenate(rows)
    sequence = mesh_sequence(
        x[None], lattice_faces(CYLINDER, (21, 48)), grid=(21, 48), topology=CYLINDER
    )
    return Deformable.of(make_template(sequence), 12)


SURFACE = tube()
X = SURFACE.template.vertices
# Which end is which is the template's to say.
ENDS = {name: rim for name in ("apex", "base") if (rim := rim_of(SURFACE, name, 20.0)) is not None}
RIM: Rim = next(rim for rim in ENDS.values() if X[rim.sides, 2].min() > LENGTH / 2)


def cloud(rng: np.random.Generator, beyond: float = 0.0, noise: float = 0.0, n: int = N) -> Floats:
    """Points all over the tube, that end `beyond` its end."""
    turn = rng.uniform(0.0, 2.0 * np.pi, n)
    z = rng.uniform(0.0, LENGTH + beyond, n)
    x = np.column_stack([RADIUS * np.cos(turn), RADIUS * np.sin(turn), z])
    return x + rng.normal(0.0, noise, (n, 3))


def found(points: Floats, noise: float) -> DataEnd | None:
    matches = closest_points(points, X, SURFACE.cells)
    return end_of_cloud(SURFACE, RIM, X, [(points, matches)], max(noise, 0.2))


def seen(points: Floats, noise: float) -> DataEnd:
    own = found(points, noise)
    assert own is not None
    return own


def test_a_tube_has_two_rims_in_sectors_all_round() -> None:
    assert set(ENDS) == {"apex", "base"}
    outward, totals = RIM.at(X)
    lengths = np.linalg.norm(outward, axis=1)
    assert totals.sum() == pytest.approx(2.0 * np.pi * RADIUS, rel=0.01)
    assert RIM.n_sectors == round(lengths.sum() / 20.0)
    assert outward / lengths[:, None] == pytest.approx(np.tile([0.0, 0.0, 1.0], (len(lengths), 1)))
    rows, alike = RIM.rows(SURFACE, X, 50.0)
    # A translation is mode 0, of the same size all over.
    assert rows[:, 0, 2] == pytest.approx(SURFACE.shapes[0, 0])
    assert np.abs(rows[:, 0, :2]).max() < 1e-9
    assert ((alike > 0.3) & (alike < 1.0)).all()


@pytest.mark.every(2)
@pytest.mark.parametrize("noise", [0.0, 0.5, 1.5])
@pytest.mark.parametrize("beyond", [-0.2, 0.0, 2.0])
def test_a_cloud_ends_where_its_density_does(noise: float, beyond: float) -> None:
    rng = np.random.default_rng(5)
    draws = [seen(cloud(rng, beyond, noise), noise) for _ in range(25)]
    off = np.array([own.beyond - beyond for own in draws])
    sd = np.sqrt(np.mean([own.variances for own in draws]))
    assert abs(off.mean()) < 3.0 * sd / off.size**0.5 + 0.05
    assert off.std() == pytest.approx(sd, rel=0.2)
    assert np.mean([own.shown for own in draws]) > 0.97


def test_strays_change_nothing_but_how_well_it_is_known() -> None:
    rng = np.random.default_rng(6)
    off, stated = [], []
    for _ in range(25):
        strays = rng.uniform([-40, -40, -20], [40, 40, 80], (N // 2, 3))
        own = seen(np.vstack([cloud(rng, 1.0, 1.0), strays]), 1.0)
        off.append(own.beyond - 1.0)
        stated.append(own.variances)
    plain = seen(cloud(rng, 1.0, 1.0), 1.0)
    sd = np.sqrt(np.mean(stated))
    assert abs(np.mean(off)) < 3.0 * sd / np.size(off) ** 0.5 + 0.1
    assert sd > 1.1 * np.sqrt(plain.variances.mean())


def test_a_lid_over_the_opening_pulls_nothing() -> None:
    rng = np.random.default_rng(7)
    off = []
    for _ in range(25):
        r, turn = RADIUS * np.sqrt(rng.uniform(size=800)), rng.uniform(0, 2 * np.pi, 800)
        lid = np.column_stack([r * np.cos(turn), r * np.sin(turn), np.full(800, LENGTH)])
        own = seen(np.vstack([cloud(rng, 0.0, 0.5), lid]), 0.5)
        off.append(own.beyond)
    assert abs(np.mean(off)) < 0.4


def test_a_hole_at_the_rim_is_not_its_end() -> None:
    rng = np.random.default_rng(8)
    points = cloud(rng, 0.0, 0.5)
    hole = np.linalg.norm(points - [RADIUS, 0.0, LENGTH], axis=1) < 22.0
    own = seen(points[~hole], 0.5)
    used = np.unique(RIM.sides)
    at_hole = RIM.sectors[used[np.linalg.norm(X[used] - [RADIUS, 0.0, LENGTH], axis=1).argmin()]]
    far = RIM.sectors[used[np.linalg.norm(X[used] + [RADIUS, 0.0, -LENGTH], axis=1).argmin()]]
    assert not own.shown[at_hole]
    assert own.shown[far]
    assert abs(own.beyond[far]) < 4.0 * np.sqrt(own.variances[far])


def test_a_cloud_that_goes_on_shows_no_end() -> None:
    own = found(cloud(np.random.default_rng(9), 40.0, 0.5, 2 * N), 0.5)
    assert own is None or not own.shown.any()


def test_a_cloud_that_is_nowhere_near_shows_no_end() -> None:
    points = cloud(np.random.default_rng(10), -25.0, 0.5)
    assert found(points, 0.5) is None


def test_it_is_the_same_in_other_units_and_elsewhere() -> None:
    points = cloud(np.random.default_rng(11), 1.0, 0.5)
    own = seen(points, 0.5)
    matches = closest_points(points / 1000.0, X / 1000.0, SURFACE.cells)
    small = replace(RIM, distances=RIM.distances / 1000.0)
    other = end_of_cloud(SURFACE, small, X / 1000.0, [(points / 1000.0, matches)], 0.0005)
    assert other is not None
    assert other.beyond * 1000.0 == pytest.approx(own.beyond, abs=1e-6)
    assert other.variances * 1e6 == pytest.approx(own.variances, rel=1e-6)
    again = seen(points, 0.5)
    assert np.array_equal(again.beyond, own.beyond)
