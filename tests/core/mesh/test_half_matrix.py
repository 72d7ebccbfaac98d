"""Compiled multigrid gives what the factorisation gives, or says that it does not."""

from __future__ import annotations

import numpy as np
import pytest
import scipy
from mesh_kernels import compiled, large
from template_remeshing import subdivided
from template_surfaces import make_ventricle
from threadpoolctl import threadpool_limits

from modalmotion.mesh import half_matrix
from modalmotion.mesh.half_matrix import HalfMatrix, solve_half
from modalmotion.mesh.near_order import near_order
from modalmotion.mesh.sides import sides_of

Floats = np.ndarray
pytestmark = compiled


def ventricle() -> tuple[HalfMatrix, Floats]:
    """A system of 5,000 unknowns as natural coordinates have them: held at its base."""
    vertices, faces = subdivided(make_ventricle(1500, np.random.default_rng(1)))
    with large():
        near = near_order(vertices[0], faces)
        assert near is not None
        place = vertices[0, near[0]]
        sides = sides_of(near[1], len(place))
    assert sides is not None
    weights, areas = sides.stiffness(place)
    free = place[:, 2] < np.quantile(place[:, 2], 0.95)
    n = int(free.sum())
    number = np.full(len(place), n, dtype=np.uint32)
    number[free] = np.arange(n)
    return HalfMatrix.of(sides, weights).free(number, n), areas[free]


def whole(matrix: HalfMatrix) -> scipy.sparse.csc_array:
    n = len(matrix)
    rows = np.repeat(np.arange(n), np.diff(matrix.first))
    half = scipy.sparse.csc_array((matrix.weight, (rows, matrix.end)), shape=(n, n))
    return scipy.sparse.csc_array(half + half.T + scipy.sparse.diags_array(matrix.diagonal))


def test_it_is_the_direct_solution(monkeypatch: pytest.MonkeyPatch) -> None:
    matrix, right = ventricle()
    # It takes 27; with a cycle that corrects too little, or too much, a third more.
    monkeypatch.setattr(half_matrix, "_MOST_STEPS", 30)
    assert len(right) > 4000
    direct = scipy.sparse.linalg.spsolve(whole(matrix), right)
    found = solve_half(matrix, right)
    assert found is not None
    assert np.abs(found - direct).max() < 1e-11 * np.abs(direct).max()
    # In any unit, beyond what single precision holds.
    tiny = solve_half(matrix, 1e-60 * right)
    assert tiny is not None
    assert np.abs(1e60 * tiny - direct).max() < 1e-11 * np.abs(direct).max()


def test_it_is_the_same_on_any_number_of_threads_and_in_every_run() -> None:
    matrix, right = ventricle()
    first = solve_half(matrix, right)
    assert first is not None
    for n_threads in (1, 2):
        with threadpool_limits(n_threads):
            other = solve_half(matrix, right)
        assert other is not None
        assert (other == first).all()


def test_the_cycle_is_symmetric(rng: np.random.Generator) -> None:
    matrix, _ = ventricle()
    cycle = half_matrix._Cycle.of(matrix)
    assert cycle is not None
    assert len(cycle.levels) >= 2
    a, b = rng.standard_normal((2, len(matrix))).astype(np.float32)
    one, other = float(a @ cycle(b)), float(b @ cycle(a))
    assert one == pytest.approx(other, rel=1e-3, abs=1e-3 * float(np.linalg.norm(cycle(a))))
    assert float(a @ cycle(a)) > 0


@pytest.mark.parametrize(
    ("name", "value"), [("_FALLEN", 1e-12), ("_MOST_STEPS", 5), ("_MOST_LEVELS", 1)]
)
def test_what_converges_too_slowly_is_left_to_others(
    monkeypatch: pytest.MonkeyPatch, name: str, value: float
) -> None:
    matrix, right = ventricle()
    monkeypatch.setattr(half_matrix, name, value)
    assert solve_half(matrix, right) is None


def test_what_is_not_positive_is_refused() -> None:
    matrix, right = ventricle()
    nothing = solve_half(matrix, 0 * right)
    assert nothing is not None
    assert not nothing.any()
    turned = HalfMatrix(matrix.first, matrix.end, matrix.weight, -matrix.diagonal, matrix.kernels)
    assert solve_half(turned, right) is None
    holed = matrix.diagonal.copy()
    holed[5] = 0.0
    loose = HalfMatrix(matrix.first, matrix.end, matrix.weight, holed, matrix.kernels)
    assert solve_half(loose, right) is None
    # Positive diagonals, and yet indefinite.
    strong = HalfMatrix(
        matrix.first, matrix.end, 9 * matrix.weight, matrix.diagonal, matrix.kernels
    )
    assert solve_half(strong, right) is None


def test_it_tells_how_far_it_is() -> None:
    matrix, right = ventricle()
    told: list[float] = []
    solve_half(matrix, right, told.append)
    assert len(told) > 10
    assert told == sorted(told)
    assert 0 < told[0] < 0.5
    assert 0.9 < told[-1] <= 1
