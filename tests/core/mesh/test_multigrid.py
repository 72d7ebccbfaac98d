"""Multigrid gives what the factorisation gives, or says that it does not."""

from __future__ import annotations

import numpy as np
import pytest
import scipy
from template_remeshing import subdivided
from template_surfaces import make_ventricle
from threadpoolctl import threadpool_limits

from modalmotion.mesh import cotangent_laplacian, laplacian, solve_positive_definite
from modalmotion.mesh.laplacian import solve_by_multigrid
from modalmotion.progress import Progress

Floats = np.ndarray


def ventricle() -> tuple[scipy.sparse.csc_array, Floats]:
    """A system of 5,000 unknowns as natural coordinates have them: held at its base."""
    vertices, faces = subdivided(make_ventricle(1500, np.random.default_rng(1)))
    place = vertices[0] if vertices.ndim == 3 else vertices
    stiffness = cotangent_laplacian(place, faces)
    free = place[:, 2] < np.quantile(place[:, 2], 0.95)
    return scipy.sparse.csc_array(stiffness[free][:, free]), np.ones(free.sum())


def test_it_is_the_direct_solution() -> None:
    matrix, right = ventricle()
    assert len(right) > 4000
    direct = solve_positive_definite(matrix, right)
    found = solve_by_multigrid(matrix, right)
    assert found is not None
    assert np.abs(found - direct).max() < 1e-10 * np.abs(direct).max()


def test_it_is_the_same_on_any_number_of_threads_and_in_every_run() -> None:
    matrix, right = ventricle()
    np.random.seed(3)  # noqa: NPY002 (of which it must not depend)
    first = solve_by_multigrid(matrix, right)
    with threadpool_limits(1):
        one = solve_by_multigrid(matrix, right)
    with threadpool_limits(2):
        two = solve_by_multigrid(matrix, right)
    assert first is not None
    assert one is not None
    assert two is not None
    for other in (one, two):
        assert np.abs(other - first).max() <= 1e-12 * np.abs(first).max()


def test_large_systems_take_it_where_it_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    matrix, right = ventricle()
    direct = solve_positive_definite(matrix, right)
    factored = scipy.sparse.linalg.splu
    sizes = []

    def noted(matrix: scipy.sparse.csc_array, **options: object) -> object:
        sizes.append(matrix.shape[0])
        return factored(matrix, **options)

    monkeypatch.setattr(scipy.sparse.linalg, "splu", noted)
    monkeypatch.setattr(laplacian, "LARGE", 1000)
    found = solve_positive_definite(matrix, right)
    # Nothing larger than the coarsest level was factored.
    assert max(sizes) <= 500
    assert np.abs(found - direct).max() < 1e-10 * np.abs(direct).max()


@pytest.mark.parametrize(("name", "value"), [("_FALLEN", 1e-12), ("_MOST_STEPS", 5)])
def test_what_converges_too_slowly_is_solved_directly(
    monkeypatch: pytest.MonkeyPatch, name: str, value: float
) -> None:
    matrix, right = ventricle()
    direct = solve_positive_definite(matrix, right)
    monkeypatch.setattr(laplacian, name, value)
    monkeypatch.setattr(laplacian, "LARGE", 1000)
    assert solve_by_multigrid(matrix, right) is None
    assert (solve_positive_definite(matrix, right) == direct).all()


def test_what_is_not_positive_is_refused() -> None:
    matrix, right = ventricle()
    assert solve_by_multigrid(scipy.sparse.csc_array(-matrix), right) is None
    nothing = solve_by_multigrid(matrix, 0 * right)
    assert nothing is not None
    assert not nothing.any()


def test_it_tells_how_far_it_is() -> None:
    matrix, right = ventricle()
    seen: list[Progress] = []
    solve_by_multigrid(matrix, right, seen.append)
    told = [progress.share for progress in seen]
    assert len(told) > 10
    assert told == sorted(told)
    assert 0 < told[0] < 0.5
    assert 0.9 < told[-1] <= 1
