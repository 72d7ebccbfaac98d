"""Enclosed volume: laws first, then solids whose volume is known."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from solids import exact_volume
from template_surfaces import MAKERS

from modalmotion.errors import TopologyError
from modalmotion.mesh import Cavity, cavity_of, lattice_faces
from modalmotion.modes.topologies import CUP, CYLINDER, SPHERE, TORUS, Topology

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

ENCLOSING = ("cup", "cylinder", "sphere", "torus")


def surface(name: str, seed: int = 0, n: int = 220) -> tuple[Floats, Ints]:
    positions, faces = MAKERS[name](n, np.random.default_rng(seed))
    return positions[3], faces


@pytest.mark.parametrize("name", ENCLOSING)
def test_the_volume_is_that_of_the_sum_over_tetrahedra(name: str) -> None:
    x, faces = surface(name)
    wound = cavity_of(faces, len(x)).faces
    assert float(Cavity(wound).volume(x)) == pytest.approx(exact_volume(x, wound), rel=1e-12)


@pytest.mark.every(2)
@pytest.mark.parametrize("name", ENCLOSING)
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=15, deadline=None)
def test_rigid_motion_scale_and_winding(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    x, faces = surface(name)
    v = abs(float(cavity_of(faces, len(x)).volume(x)))
    R = Rotation.random(rng=rng).as_matrix()
    # Each triangle wound at random, and the sign is one for all of them.
    flipped = np.where(rng.random((len(faces), 1)) < 0.5, faces[:, ::-1], faces)
    cavity = cavity_of(flipped[rng.permutation(len(faces))], len(x))
    moved = x @ R.T + rng.normal(size=3) * 100
    assert abs(float(cavity.volume(moved))) == pytest.approx(v, rel=1e-11)
    # Far away a coordinate is rounded to 1e-10 mm; volume moves by that times the area.
    far = x + 1e6
    assert abs(float(cavity.volume(far))) == pytest.approx(v, rel=1e-9)
    k = float(rng.uniform(0.01, 100))
    assert abs(float(cavity.volume(k * x))) == pytest.approx(k**3 * v, rel=1e-12)
    # A linear map multiplies by its determinant: lids are flat fans to means.
    A = rng.normal(size=(3, 3))
    image = float(cavity.volume(x @ A.T))
    signed = float(cavity.volume(x))
    assert image == pytest.approx(np.linalg.det(A) * signed, rel=1e-9, abs=1e-11 * v)


def test_the_parts_of_a_cut_solid_add_up() -> None:
    # A tube cut along a ring: both parts close the cut by the same fan.
    rows, columns = 12, 16
    z, turn = np.divmod(np.arange(rows * columns), columns)
    radius = 10 + 2 * np.cos(turn) + 0.3 * z
    a = 2 * np.pi * turn / columns
    x = np.stack([radius * np.cos(a), radius * np.sin(a), 3.0 * z + np.sin(2 * a)], axis=1)
    faces = lattice_faces(CYLINDER, (rows, columns))
    level = faces.max(axis=1) // columns
    low, high = faces[level <= 5], faces[level > 5]
    whole, part, rest = (float(Cavity(f).volume(x)) for f in (faces, low, high))
    assert whole == pytest.approx(part + rest, rel=1e-12)
    assert min(part / whole, rest / whole) > 0.2


def ellipsoid_error(n: int) -> float:
    axes = np.array([20.0, 30.0, 45.0])
    s = (np.arange(n) + 0.5) / n * np.pi
    a = 2 * np.pi * np.arange(2 * n) / (2 * n)
    unit = np.stack(
        [
            np.outer(np.sin(s), np.cos(a)),
            np.outer(np.sin(s), np.sin(a)),
            -np.cos(s)[:, None] + 0 * a,
        ],
        axis=-1,
    ).reshape(-1, 3)
    cavity = cavity_of(lattice_faces(SPHERE, (n, 2 * n)), len(unit))
    assert len(cavity.openings) == 2
    return abs(float(cavity.volume(unit * axes))) / float(4 / 3 * np.pi * axes.prod()) - 1


def test_an_ellipsoid_whose_poles_are_holes_has_its_volume_to_second_order() -> None:
    errors = [ellipsoid_error(n) for n in (8, 16, 32)]
    assert -0.07 < errors[0] < 0
    for coarse, fine in pairwise(errors):
        assert coarse / fine == pytest.approx(4, abs=0.3)


def test_a_torus_by_pappus() -> None:
    n, m, core, tube = 60, 120, 30.0, 8.0
    i, j = np.divmod(np.arange(n * m), m)
    a, b = 2 * np.pi * i / n, 2 * np.pi * j / m
    out = core + tube * np.cos(a)
    x = np.stack([out * np.cos(b), out * np.sin(b), tube * np.sin(a)], axis=1)
    cavity = cavity_of(lattice_faces(TORUS, (n, m)), n * m)
    assert cavity.openings == ()
    # A polygon of n corners has this share of its circle's area; so has the path around.
    share = [np.sin(2 * np.pi / k) * k / (2 * np.pi) for k in (n, m)]
    expected = 2 * np.pi**2 * core * tube**2 * share[0] * share[1]
    assert abs(float(cavity.volume(x))) == pytest.approx(expected, rel=2e-3)


def test_a_cube_with_two_windows_that_touch_in_a_corner() -> None:
    # Both windows lie in faces of the cube: the fan over the two of them closes it still.
    n = 3
    grid = np.stack(np.meshgrid(*[np.arange(n + 1)] * 3, indexing="ij"), -1).reshape(-1, 3)
    index = np.arange((n + 1) ** 3).reshape(n + 1, n + 1, n + 1)
    quads = []
    for axis in range(3):
        for side in (0, n):
            sheet = np.take(index, side, axis=axis)
            corners = [sheet[:-1, :-1], sheet[1:, :-1], sheet[1:, 1:], sheet[:-1, 1:]]
            quads.append(np.stack([c.ravel() for c in corners], axis=1))
    q = np.concatenate(quads)
    centre = grid[q].mean(axis=1)
    on_top = centre[:, 2] == n
    window = on_top & (np.abs(centre[:, :2] - [0.5, 0.5]).max(axis=1) < 0.1)
    window |= on_top & (np.abs(centre[:, :2] - [1.5, 1.5]).max(axis=1) < 0.1)
    q = q[~window]
    faces = np.concatenate([q[:, [0, 1, 2]], q[:, [0, 2, 3]]])
    cavity = cavity_of(faces, len(grid))
    assert [len(edges) for edges in cavity.openings] == [8]
    assert abs(float(cavity.volume(grid.astype(float)))) == pytest.approx(n**3, rel=1e-12)


@pytest.mark.parametrize("topology", [CUP, CYLINDER, SPHERE, TORUS])
def test_lattices_have_the_openings_of_their_ends(topology: Topology) -> None:
    faces = lattice_faces(topology, (5, 8))
    n_openings = {CUP: 2, CYLINDER: 2, SPHERE: 2, TORUS: 0}[topology]
    assert len(cavity_of(faces, 40).openings) == n_openings


def test_vertices_of_no_triangle_are_not_read() -> None:
    x, faces = surface("cup")
    with_stray = np.concatenate([[[np.nan, np.inf, 0.0]], x])
    assert Cavity(faces + 1).volume(with_stray) == Cavity(faces).volume(x)


def mobius() -> Ints:
    n = 8
    strip = [(2 * i, 2 * i + 1, 2 * i + 2) for i in range(n - 1)]
    strip += [(2 * i + 1, 2 * i + 3, 2 * i + 2) for i in range(n - 1)]
    strip += [(2 * n - 2, 2 * n - 1, 1), (2 * n - 1, 0, 1)]
    return np.array(strip)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda f: f[:0], "no triangles"),
        (lambda f: np.concatenate([f, [[*f[0, :2], 999]]]), "three triangles or more"),
        (lambda f: np.concatenate([f, f + f.max() + 1]), "2 separate pieces"),
        (lambda f: mobius(), "one side only"),
        (lambda f: np.array([[0, 0, 1]]), "no triangles"),
    ],
)
def test_what_encloses_nothing_is_refused_by_name(make: Callable[[Ints], Ints], words: str) -> None:
    _, faces = surface("sphere", n=60)
    with pytest.raises(TopologyError, match=words) as caught:
        cavity_of(make(faces), 1000)
    assert caught.value.remedy
