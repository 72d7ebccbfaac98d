"""Numerical extremes of the fit on meshes, each test named after its row."""

from __future__ import annotations

from dataclasses import replace
from operator import attrgetter

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from template_surfaces import (
    Floats,
    Moving,
    cup_points,
    describe,
    fit_sequence,
    make_ventricle,
    ventricle,
)

from modalmotion.errors import ModeCountError, TopologyError
from modalmotion.mesh import vertex_areas
from modalmotion.mesh.sequence import mesh_sequence
from modalmotion.modes import ModeLabel, ModeSet, lowest_modes
from modalmotion.modes.topologies import CUP
from modalmotion.signature.fit import LARGEST_CONDITION, Fit, factored, make_basis
from modalmotion.template import Template, choose_modes, make_template

EPS = float(np.finfo(np.float64).eps)


@pytest.fixture(scope="module", name="heart")
def _heart() -> Moving:
    return make_ventricle(800, np.random.default_rng(0))


def fit_on(template: Template, vertices: Floats, faces: np.ndarray, n_modes: int = 7) -> Fit:
    basis = make_basis(template, choose_modes(template, n_modes)[0])
    return fit_sequence(mesh_sequence(vertices, faces), template, basis)


@pytest.mark.parametrize(("offset", "bound"), [(1e6, 3e-9), (1e9, 3e-6)])
def test_coordinates_offset(heart: Moving, offset: float, bound: float) -> None:
    vertices, faces = heart
    before = describe((vertices, faces)).amplitudes
    after = describe((vertices + offset, faces)).amplitudes
    assert np.abs(after - before).max() <= bound


@pytest.mark.parametrize("scale", [1e-200, 1e-155, 1e-12, 1e-3, 1e12, 1e155, 1e200])
def test_unit_change(heart: Moving, scale: float) -> None:
    vertices, faces = heart
    before, after = describe((vertices, faces)), describe((vertices * scale, faces))
    size = np.abs(before.amplitudes).max()
    assert np.abs(after.amplitudes / scale - before.amplitudes).max() <= 1e-12 * size
    for name in ("errors.rms", "errors.weighted_rms", "errors.p95", "errors.max", "motion.rms"):
        one, other = (attrgetter(name)(each.fit) for each in (before, after))
        assert other / scale == pytest.approx(one, rel=1e-9, abs=1e-12), name
    assert after.fit.rotations.is_determined.all()
    assert np.array(after.template.lengths) / scale == pytest.approx(before.template.lengths)
    assert after.template.coordinates == pytest.approx(before.template.coordinates, abs=1e-11)


@pytest.mark.parametrize("power", [-40, 3, 300])
def test_unit_change_by_a_power_of_two_keeps_every_bit(heart: Moving, power: int) -> None:
    vertices, faces = heart
    scale = 2.0**power
    before, after = describe((vertices, faces)), describe((vertices * scale, faces))
    assert (after.fit.amplitudes == before.fit.amplitudes * scale).all()
    assert (after.fit.errors.max == before.fit.errors.max * scale).all()


def square_modes(n: int) -> ModeSet:
    """All modes with wavenumbers below n along both axes of a cup."""
    labels = [
        ModeLabel((r, p), part)  # type: ignore[arg-type]
        for r in range(n)
        for p in range(n)
        for part in (("cos",) if p == 0 else ("cos", "sin"))
    ]
    return ModeSet.of(CUP, labels)


@pytest.mark.every(2)
@pytest.mark.parametrize(
    "n", [8, 12, 16, 20, *(pytest.param(n, marks=pytest.mark.soak) for n in (24, 28))]
)
def test_number_of_modes_towards_number_of_vertices(n: int) -> None:
    rng = np.random.default_rng(0)
    coordinates = np.stack([np.sqrt(rng.random(1572)), rng.random(1572)], axis=1)
    weights = np.full(1572, 1 / 1572)
    modes = square_modes(n)
    shapes = modes.shapes_at(coordinates)
    if n > 20:
        with pytest.raises(ModeCountError, match="would be noise") as caught:
            factored(modes, shapes, weights)
        assert float(caught.value.details["condition"]) > LARGEST_CONDITION  # type: ignore[arg-type]
        return
    exact = float(np.linalg.cond(np.sqrt(weights)[:, None] * shapes))
    basis = factored(modes, shapes, weights)
    assert basis.condition == pytest.approx(exact, rel=1e-6)
    a = rng.normal(size=len(modes))
    lost = np.abs(basis.projector @ (shapes @ a) - a).max()
    # The condition itself and not its square, as normal equations would lose.
    assert lost <= 100 * EPS * exact * np.abs(a).max() * np.sqrt(len(modes))


def test_conditions_grow_until_they_are_refused() -> None:
    rng = np.random.default_rng(0)
    coordinates = np.stack([np.sqrt(rng.random(1572)), rng.random(1572)], axis=1)
    conditions = [np.linalg.cond(square_modes(n).shapes_at(coordinates)) for n in (8, 16, 24)]
    assert conditions[0] < 1e3 < conditions[1] < LARGEST_CONDITION < conditions[2]


def test_fewer_vertices_than_modes(heart: Moving) -> None:
    vertices, faces = heart
    template = make_template(mesh_sequence(vertices, faces))
    few = factored(
        lowest_modes(CUP, 7),
        lowest_modes(CUP, 7).shapes_at(template.coordinates[:9]),
        np.full(9, 1 / 9),
    )
    assert np.isfinite(few.projector).all()
    with pytest.raises(ModeCountError, match="6 vertices") as caught:
        factored(
            lowest_modes(CUP, 7),
            lowest_modes(CUP, 7).shapes_at(template.coordinates[:6]),
            np.full(6, 1 / 6),
        )
    assert caught.value.details == {"modes": 7, "most": 6}
    with pytest.raises(ModeCountError):
        make_basis(template, lowest_modes(CUP, template.n_vertices + 1))


def uniform(template: Template) -> Template:
    """The same, all vertices of the same weight."""
    return replace(template, weights=np.full(template.n_vertices, 1 / template.n_vertices))


@pytest.mark.parametrize("sigma", [0.5, 1.0, 2.0])
def test_vertex_noise(heart: Moving, sigma: float) -> None:
    vertices, faces = heart
    template = uniform(make_template(mesh_sequence(vertices, faces)))
    basis = make_basis(template, choose_modes(template, 7)[0])
    noise = np.random.default_rng(1).normal(size=(400, *vertices.shape[1:])) * sigma
    noise[0] = 0.0
    moved = mesh_sequence(vertices[0] + noise, faces)
    a = fit_sequence(moved, template, basis, remove_rotation=False).amplitudes[1:]
    # The covariance of least squares: sigma^2 (Phi' Phi)^-1.
    spread = sigma * np.sqrt(np.diag(np.linalg.inv(basis.shapes.T @ basis.shapes)))
    measured = a.std(axis=(0, 2))
    assert measured == pytest.approx(spread, rel=0.1)
    assert measured.mean() == pytest.approx(sigma / np.sqrt(template.n_vertices), rel=0.25)


def test_pure_translation(heart: Moving) -> None:
    vertices, faces = heart
    steps = np.array([[0.0, 0, 0], [3, -4, 12], [1e3, 0, 0], [1e-9, 0, 0]])
    found = fit_on(
        make_template(mesh_sequence(vertices, faces)),
        vertices[0] + steps[:, None],
        faces,
    )
    assert found.amplitudes[:, 0] == pytest.approx(steps, abs=1e-11)
    assert np.abs(found.amplitudes[:, 1:]).max() <= 1e-11
    assert found.errors.max.max() <= 1e-11
    assert found.motion.rms == pytest.approx(np.linalg.norm(steps, axis=1), abs=1e-11)


@pytest.mark.parametrize("degrees", [1, 10, 30, 90, 180])
def test_pure_rotation(heart: Moving, degrees: float) -> None:
    vertices, faces = heart
    template = make_template(mesh_sequence(vertices, faces))
    assert template.landmarks is not None
    turn = Rotation.from_rotvec(np.radians(degrees) * template.landmarks.axis).as_matrix()
    centre = template.weights @ vertices[0]
    moved = np.stack([vertices[0], (vertices[0] - centre) @ turn.T + centre])
    found = fit_on(template, moved, faces)
    assert np.abs(found.amplitudes).max() <= 1e-11
    assert found.motion.rms.max() <= 1e-11
    assert found.rotations.matrices[1] == pytest.approx(turn, abs=1e-13)
    assert found.rotations.is_determined.all()
    basis = make_basis(template, choose_modes(template, 7)[0])
    kept = fit_sequence(mesh_sequence(moved, faces), template, basis, remove_rotation=False)
    assert kept.motion.rms[1] > 0.2 * np.radians(degrees)


def test_mirror_image_is_never_a_rotation(heart: Moving) -> None:
    vertices, faces = heart
    moved = np.stack([vertices[0], vertices[0] * [1, 1, -1]])
    found = fit_on(make_template(mesh_sequence(moved, faces)), moved, faces)
    assert np.linalg.det(found.rotations.matrices) == pytest.approx(1.0)
    assert found.motion.rms[1] > 1.0


@pytest.mark.parametrize("dimension", [0, 1, 2])
def test_collinear_and_coplanar_points(heart: Moving, dimension: int) -> None:
    vertices, faces = heart
    flat = np.zeros((1, 1, 3))
    flat[..., :dimension] = 1.0
    moved = np.concatenate([vertices[:1], vertices[:3] * flat])
    found = fit_on(make_template(mesh_sequence(moved, faces)), moved, faces)
    assert np.isfinite(found.amplitudes).all()
    assert np.linalg.det(found.rotations.matrices) == pytest.approx(1.0)
    assert found.rotations.is_determined.tolist() == [True] + [dimension == 2] * 3


@pytest.mark.parametrize("n", [1, 2])
def test_one_or_two_vertices(n: int) -> None:
    vertices = np.random.default_rng(0).normal(size=(3, n, 3))
    sequence = mesh_sequence(vertices, topology="open curve")
    template = make_template(sequence)
    basis = make_basis(template, choose_modes(template, 1)[0])
    found = fit_sequence(sequence, template, basis)
    assert np.isfinite(found.amplitudes).all()
    assert not found.rotations.is_determined.any()
    assert np.linalg.det(found.rotations.matrices) == pytest.approx(1.0)


def test_static_sequence(heart: Moving) -> None:
    vertices, faces = heart
    found = describe((np.repeat(vertices[:1], 5, axis=0), faces))
    for values in (
        found.fit.amplitudes,
        found.fit.errors.weighted_rms,
        found.fit.errors.p95,
        found.fit.errors.max,
        found.fit.motion.rms,
    ):
        assert (values == 0).all()
    assert (found.fit.rotations.matrices == np.eye(3)).all()


@pytest.mark.parametrize("n_frames", [1, 2])
def test_one_and_two_frames(heart: Moving, n_frames: int) -> None:
    vertices, faces = heart
    found = describe((vertices[:n_frames], faces))
    assert found.fit.amplitudes.shape == (n_frames, 7, 3)
    assert (found.fit.amplitudes[0] == 0).all()


def test_zero_area_mesh(heart: Moving) -> None:
    vertices, faces = heart
    point = mesh_sequence(np.ones((2, vertices.shape[1], 3)), faces)
    with pytest.raises(TopologyError, match="at the same place in every frame"):
        make_template(point)
    line = vertices * [1, 0, 0]
    collapsed = describe((line, faces), 3)
    assert "no area" in collapsed.template.reason
    assert np.isfinite(collapsed.fit.amplitudes).all()


def with_debris(moving: Moving, garbage: float) -> Moving:
    """Isolated vertices in front and behind, a vertex twice, triangles without area."""
    vertices, faces = moving
    n = vertices.shape[1]
    far = np.random.default_rng(3).normal(size=(len(vertices), 2, 3)) * garbage
    a, b = next(edge for edge in faces[:, :2] if (faces == edge[0]).any(axis=1).sum() == 6)
    # The side ab is cut in a: the new vertex t lies on a, and takes over what lies beyond.
    at_side = ((faces == a) | (faces == b)).sum(axis=1) == 2
    beyond, empty = faces[at_side].copy(), faces[at_side].copy()
    beyond[beyond == a] = n
    empty[empty == b] = n
    joined = np.concatenate([faces[~at_side], beyond, empty, [[a, a, b]]]) + 1
    return np.concatenate([far[:, :1], vertices, vertices[:, [a]], far[:, 1:]], axis=1), joined


@pytest.mark.parametrize("garbage", [0.0, 50.0, 1e9, 1e160])
def test_degenerate_triangle_isolated_vertex_duplicate_vertex(
    heart: Moving, garbage: float
) -> None:
    before = describe(heart, 18)
    after = describe(with_debris(heart, garbage), 18)
    assert after.template.topology == CUP
    assert np.abs(after.amplitudes - before.amplitudes).max() <= 2e-2
    assert after.fit.errors.weighted_rms == pytest.approx(
        before.fit.errors.weighted_rms, rel=1e-2, abs=1e-9
    )
    assert after.fit.errors.max.max() <= 1.2 * before.fit.errors.max.max()
    # Vertices in no triangle count in no error, however far they lie.
    assert np.isfinite(after.fit.errors.rms).all()
    n = after.template.n_vertices
    assert after.template.isolated.tolist() == [0, n - 1]
    assert (after.template.weights[[0, n - 1]] == 0).all()
    notes = " ".join(map(str, after.template.notes))
    assert "belong to no triangle" in notes
    assert "name a vertex twice" in notes
    assert np.isfinite(after.template.coordinates).all()


def test_isolated_vertices_alone_change_nothing(heart: Moving) -> None:
    vertices, faces = heart
    extra = np.concatenate([vertices, np.full((len(vertices), 3, 3), 7.0)], axis=1)
    before, after = describe(heart, 18), describe((extra, faces), 18)
    assert after.amplitudes == pytest.approx(before.amplitudes, abs=1e-12)
    assert after.fit.errors.weighted_rms == pytest.approx(before.fit.errors.weighted_rms, abs=1e-12)
    assert after.fit.errors.max == pytest.approx(before.fit.errors.max, abs=1e-12)


def test_needles_of_triangles(heart: Moving) -> None:
    # A vertex a hair's breadth from its neighbour: triangles of nearly no area.
    vertices, faces = heart
    a, b = faces[100, :2]
    close = vertices.copy()
    close[:, b] = close[:, a] + 1e-11 * (close[:, b] - close[:, a])
    before, after = describe(heart), describe((close, faces))
    assert after.template.topology == CUP
    assert np.abs(after.amplitudes - before.amplitudes).max() <= 0.05


def test_pole() -> None:
    # The axis of a symmetric cup meets a vertex, where theta has no value.
    points, faces = cup_points(800, np.random.default_rng(0), 0.0)
    turns = np.concatenate([points @ Rotation.from_rotvec([0, 0, k]).as_matrix().T for k in (0, 2)])
    apex = np.array([[0.0, 0.0, -1.0]])
    n = len(points)
    lowest = faces[np.argmin(points[faces, 2].max(axis=1))]
    moved = ventricle(np.concatenate([points, apex]))
    fan = np.array([[lowest[i], lowest[(i + 1) % 3], n] for i in range(3)])
    kept = faces[~(faces == lowest).all(axis=1)]
    found = describe((moved, np.concatenate([kept, fan])), 37)
    assert found.template.topology == CUP
    assert np.isfinite(found.amplitudes).all()
    assert found.fit.errors.weighted_rms.max() < 0.1 * found.fit.motion.rms.max()
    assert len(turns) == 2 * n


def test_weights_are_areas(heart: Moving) -> None:
    vertices, faces = heart
    template = make_template(mesh_sequence(vertices[:1], faces))
    areas = vertex_areas(vertices[0], faces)
    assert template.weights == pytest.approx(areas / areas.sum(), rel=1e-12)
