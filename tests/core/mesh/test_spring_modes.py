"""Spring modes of a mesh: true eigenvectors, the same whatever solver finds them."""

from __future__ import annotations

import numpy as np
import pytest
import scipy
from scipy.linalg import eigh
from scipy.sparse import csc_array
from scipy.sparse.linalg import eigsh
from template_surfaces import make_ventricle, ring_points, sheet_points

import modalmotion.mesh.spring_modes as eigenpairs_module
from modalmotion.errors import LimitError, ModeCountError
from modalmotion.mesh import connectivity_of, graph_laplacian
from modalmotion.mesh.sequence import mesh_sequence
from modalmotion.mesh.spring_modes import lowest_eigenpairs, spring_modes
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import PLANE
from modalmotion.template import choose_modes, make_template

NO_PROBES = np.zeros((0, 0))


def laplacian_of(faces: np.ndarray, n: int) -> csc_array:
    return graph_laplacian(connectivity_of(faces, n).edges, n)


def symmetric_torus(rows: int, columns: int) -> csc_array:
    """A lattice closed both ways: almost every eigenvalue comes four or eight times."""
    index = np.arange(rows * columns).reshape(rows, columns)
    edges = np.concatenate(
        [np.stack([index.ravel(), np.roll(index, -1, axis).ravel()], axis=1) for axis in (0, 1)]
    )
    return graph_laplacian(edges, rows * columns)


def test_they_are_eigenvectors() -> None:
    vertices, faces = make_ventricle(650, np.random.default_rng(0))
    n = vertices.shape[1]
    modes = spring_modes(faces, n, 25)
    K = laplacian_of(faces, n)
    residual = K @ modes.shapes - modes.shapes * modes.eigenvalues
    assert np.abs(residual).max() <= 1e-10
    assert modes.shapes.T @ modes.shapes / n == pytest.approx(np.eye(25), abs=1e-10)
    exact = eigh(K.toarray(), eigvals_only=True)
    assert modes.eigenvalues == pytest.approx(exact[:25], abs=1e-11)
    assert modes.shapes[:, 0] == pytest.approx(1.0, abs=1e-9)


@pytest.mark.every(3)
@pytest.mark.parametrize("shape", [(30, 30), (24, 40), (26, 26)])
def test_any_solver_gives_the_same_vectors(
    shape: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    K = symmetric_torus(*shape)
    ones = np.ones((K.shape[0], 1))
    values, vectors = lowest_eigenpairs(K, 13, ones)
    # Another solver: dense, and its spaces turned at random.
    exact_values, exact = eigh(K.toarray())
    rng = np.random.default_rng(0)
    for i in range(K.shape[0]):
        same = np.flatnonzero(np.abs(exact_values - exact_values[i]) < 1e-9)
        if same[0] == i:
            exact[:, same] = exact[:, same] @ np.linalg.qr(rng.normal(size=(len(same),) * 2))[0]
    monkeypatch.setattr(
        eigenpairs_module, "_solve", lambda _, count, __: (exact_values[:count], exact[:, :count])
    )
    other_values, others = lowest_eigenpairs(K, 13, ones)
    assert values == pytest.approx(other_values, abs=1e-10)
    assert np.abs(vectors - others).max() <= 1e-7


def test_no_copy_of_a_multiple_frequency_is_lost() -> None:
    K = symmetric_torus(40, 40)
    values, _ = lowest_eigenpairs(K, 30, np.ones((1600, 1)))
    p = np.arange(40)
    line = 4 * np.sin(np.pi * p / 40) ** 2
    exact = np.sort((line[:, None] + line[None, :]).ravel())[:30]
    assert values == pytest.approx(exact, abs=1e-10)


def test_a_lost_copy_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    K, ones = symmetric_torus(30, 30), np.ones((900, 1))
    expected, _ = lowest_eigenpairs(K, 9, ones)
    solver, calls = eigsh, []

    def forgetful(matrix: csc_array, k: int, **options: object) -> tuple[np.ndarray, np.ndarray]:
        values, vectors = solver(matrix, k=k + 1, **options)
        order = np.argsort(values)
        calls.append(k)
        # The second of the four lowest waves is missed at first.
        kept = np.delete(order, 2) if len(calls) == 1 else order[:-1]
        return values[kept], vectors[:, kept]

    monkeypatch.setattr(scipy.sparse.linalg, "eigsh", forgetful)
    values, _ = lowest_eigenpairs(K, 9, ones)
    assert len(calls) > 1
    assert values == pytest.approx(expected, abs=1e-10)


def test_they_are_the_same_over_runs() -> None:
    vertices, faces = make_ventricle(1500, np.random.default_rng(0))
    one, other = (spring_modes(faces, vertices.shape[1], 20) for _ in range(2))
    assert (one.shapes == other.shapes).all()
    assert one.connectivity_id == other.connectivity_id


def test_they_depend_on_the_connectivity_alone() -> None:
    vertices, faces = make_ventricle(800, np.random.default_rng(0))
    one = choose_modes(make_template(mesh_sequence(vertices, faces), closed_form=False), 9)[0]
    bent = make_template(mesh_sequence(vertices**3, faces[::-1, [1, 2, 0]]), closed_form=False)
    other = choose_modes(bent, 9)[0]
    assert (one.shapes_on(bent) == other.shapes_on(bent)).all()
    assert one == other


def test_pieces_have_a_constant_each() -> None:
    _, faces = ring_points(200, np.random.default_rng(0))
    n = int(faces.max()) + 1
    both = np.concatenate([faces + n + 3, faces])
    modes = spring_modes(both, 2 * n + 5, 6)
    first, second = slice(0, n), slice(n + 3, 2 * n + 3)
    isolated = [n, n + 1, n + 2, 2 * n + 3, 2 * n + 4]
    assert (modes.shapes[isolated] == 0).all()
    assert modes.eigenvalues[:2] == pytest.approx(0, abs=1e-10)
    assert modes.eigenvalues[2] > 1e-3
    used = np.concatenate([modes.shapes[first], modes.shapes[second]])
    assert used[:, 0] == pytest.approx(1.0, abs=1e-9)
    # Of equal pieces that with the first vertex comes first, and with a positive sign.
    assert modes.shapes[first, 1] == pytest.approx(1.0, abs=1e-9)
    assert modes.shapes[second, 1] == pytest.approx(-1.0, abs=1e-9)
    assert (used**2).mean(axis=0) == pytest.approx(1.0)


def test_the_largest_piece_comes_first() -> None:
    _, small = ring_points(60, np.random.default_rng(0))
    _, large = ring_points(200, np.random.default_rng(0))
    n = int(small.max()) + 1
    modes = spring_modes(np.concatenate([small, large + n]), n + int(large.max()) + 1, 3)
    assert (modes.shapes[n:, 1] > 0).all()
    assert (modes.shapes[:n, 1] < 0).all()


def test_labels_are_ranks() -> None:
    _, faces = make_ventricle(300, np.random.default_rng(0))
    modes = spring_modes(faces, int(faces.max()) + 1, 3)
    assert [str(label) for label in modes.labels] == ["(spring 0)", "(spring 1)", "(spring 2)"]
    assert [label.wavenumbers for label in modes.labels] == [(0,), (1,), (2,)]
    assert modes.topology is None
    assert len(modes) == 3


def test_more_than_there_are() -> None:
    faces = np.array([[0, 1, 2], [1, 2, 3]])
    assert len(spring_modes(faces, 9, 4)) == 4
    for n in (0, 5):
        with pytest.raises(ModeCountError, match="there are 4"):
            spring_modes(faces, 9, n)


def test_many_equal_parts_are_refused_before_they_cost_minutes() -> None:
    disc = np.array([[0, i + 1, (i + 1) % 40 + 1] for i in range(40)])
    heap = np.concatenate([disc + 41 * k for k in range(110)])
    windmill = np.array([[0, 2 * i + 1, 2 * i + 2] for i in range(300)])
    for faces, limit in ((heap, "pieces"), (windmill, "equal_frequencies")):
        with pytest.raises(LimitError) as caught:
            spring_modes(faces, int(faces.max()) + 1, 7)
        assert caught.value.limit == limit
        assert caught.value.remedy
    # As many as a hundred pieces are modes like any other.
    few = spring_modes(heap[: 40 * 12], 41 * 12, 13)
    assert few.eigenvalues[:12] == pytest.approx(0, abs=1e-9)
    assert few.eigenvalues[12] > 0.01


def test_frequencies_are_those_of_long_waves() -> None:
    # On a square grid of springs without diagonals they are the closed form's.
    rows, columns = 30, 40
    lattice = Lattice(PLANE, (rows, columns))
    exact = np.sort(lattice.angular_frequencies(lattice.lowest_modes(6)))
    index = np.arange(rows * columns).reshape(rows, columns)
    edges = np.concatenate(
        [
            np.stack([index[:-1].ravel(), index[1:].ravel()], axis=1),
            np.stack([index[:, :-1].ravel(), index[:, 1:].ravel()], axis=1),
        ]
    )
    values, _ = lowest_eigenpairs(
        graph_laplacian(edges, rows * columns), 6, np.ones((rows * columns, 1))
    )
    assert np.sqrt(np.maximum(values, 0)) == pytest.approx(exact, abs=1e-7)
    # On a flat sheet of triangles, long waves have the wavenumbers of the sheet.
    places, faces = sheet_points(2000, np.random.default_rng(0), 0.0)
    flat = np.concatenate([places * [60, 36], np.zeros((len(places), 1))], axis=1)
    template = make_template(mesh_sequence(flat[None], faces), closed_form=False)
    springs = choose_modes(template, 4)[0]
    slow = springs.frequencies_on(template, 1.0)
    k = np.pi * np.array([0, 1 / 60, 1 / 36, np.hypot(1 / 60, 1 / 36)])
    assert slow == pytest.approx(k, rel=0.1, abs=1e-6)
    assert springs.frequencies_on(template, 3.0) == pytest.approx(3 * slow)
