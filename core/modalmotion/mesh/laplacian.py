"""Laplacians of triangle meshes, and the solution of systems with them.

Unknowns are numbered so that neighbours are near (reverse Cuthill and McKee), then eliminated by
minimum degree: quick for any numbering, where minimum degree alone takes thirty times as long on
some meshes refined by subdivision.

Conjugate gradients, preconditioned by a V-cycle of smoothed aggregation (Vanek, Mandel and
Brezina, Algebraic multigrid by smoothed aggregation, Computing, 1996): groups of strongly joined
unknowns are the unknowns of the next level, whose interpolation is a step of Jacobi away from a
constant on each group. Memory grows as the matrix; groups and sweeps are in `native/multigrid.c`.
"""

from collections.abc import Callable
from typing import Any, Final

import numpy as np
import scipy

from modalmotion.mesh.triangles import corners_of, face_normals
from modalmotion.numeric.native import run
from modalmotion.progress import Progress, Reporter, share_fallen, silent
from modalmotion.representation import Floats, Ints


def cotangent_laplacian(vertices: Floats, faces: Ints) -> "scipy.sparse.csc_array":
    """Stiffness of linear elements: minus the Laplacian, weighted by cotangents.

    Parameters
    ----------
    vertices : (vertices, 3) float64, length unit
    faces : (faces, 3) int64

    Returns
    -------
    (vertices, vertices) scipy.sparse.csc_array of float64
        Positive semidefinite and independent of the unit; triangles without area and
        vertices without triangles contribute nothing.

    Notes
    -----
    Pinkall and Polthier, Computing discrete minimal surfaces and their conjugates,
    Experimental Mathematics, 1993.
    """
    n = len(vertices)
    corners = corners_of(vertices, faces)
    normals = face_normals(vertices, faces)
    twice_area = np.sqrt(np.einsum("ij,ij->i", normals, normals))
    safe = np.where(twice_area > 0, twice_area, np.inf)
    rows, columns, values = [], [], []
    for k in range(3):
        b, c = faces[:, (k + 1) % 3], faces[:, (k + 2) % 3]
        # cot of the angle at a weighs the side bc
        to_b, to_c = (corners[(k + i) % 3] - corners[k] for i in (1, 2))
        to_b *= to_c
        dot = to_b[:, 0] + to_b[:, 1] + to_b[:, 2]
        rows.append(np.minimum(b, c))
        columns.append(np.maximum(b, c))
        values.append(-0.5 * dot / safe)
    return _symmetric(n, np.concatenate(rows), np.concatenate(columns), np.concatenate(values))


def graph_laplacian(edges: Ints, n_vertices: int) -> "scipy.sparse.csc_array":
    """Stiffness of equal springs along the edges: degree minus adjacency.

    Parameters
    ----------
    edges : (edges, 2) int64
        Each once.
    n_vertices : int

    Returns
    -------
    (vertices, vertices) scipy.sparse.csc_array of float64
    """
    return _symmetric(n_vertices, edges[:, 0], edges[:, 1], np.full(len(edges), -1.0))


def _symmetric(n: int, rows: Ints, columns: Ints, values: Floats) -> "scipy.sparse.csc_array":
    off = scipy.sparse.csc_array((values, (rows, columns)), shape=(n, n))
    off = off + off.T
    diagonal = -np.asarray(off.sum(axis=0)).ravel()
    return scipy.sparse.csc_array(off + scipy.sparse.diags_array(diagonal))


# Couplings below this share of the diagonals join no group: with less, thin triangles slow it.
_STRONG: Final = 0.08
# Of the Jacobi step, over the largest eigenvalue.
_OMEGA: Final = 4.0 / 3.0
_POWER_STEPS: Final = 15
_COARSEST: Final = 500
_MOST_LEVELS: Final = 20

# Of the residual, over that of zero. What is slower than so many steps is better solved directly.
_TOLERANCE: Final = 1e-13
_MOST_STEPS: Final = 60
# By this step it must have fallen so far: it takes 25 for all on triangles of usual shape.
_LOOK_AT: Final = 15
_FALLEN: Final = 1e-4

# Of the time, until there are levels.
_SET_UP: Final = 0.3


def solve_by_multigrid(
    matrix: "scipy.sparse.csc_array", right: Floats, report: Reporter = silent
) -> Floats | None:
    """Solve a sparse symmetric positive definite system.

    Parameters
    ----------
    matrix : (n, n) scipy.sparse.csc_array of float64
    right : (n,) float64
    report : callable, optional
        Told the share of the solution that is there.

    Returns
    -------
    (n,) float64, or None
        None if it converges too slowly, as on long thin triangles.
    """
    # The rows of a symmetric matrix are its columns.
    A = scipy.sparse.csr_matrix(
        (matrix.data, matrix.indices.astype(np.int32), matrix.indptr.astype(np.int32)),
        shape=matrix.shape,
    )
    diagonal = A.diagonal()
    if not (diagonal > 0).all():
        return None
    cycle = _cycle_of(A)
    x = np.zeros(len(right))
    residual = right.copy()
    direction = np.zeros_like(x)
    before, done = 1.0, 0.0
    start = float(np.linalg.norm(right))
    for number in range(_MOST_STEPS):
        left = float(np.linalg.norm(residual))
        if left <= _TOLERANCE * start:
            return x
        done = max(done, share_fallen(left, start, _TOLERANCE * start))
        report(Progress(_SET_UP + (1 - _SET_UP) * done))
        if number == _LOOK_AT and left > _FALLEN * start:
            return None
        z = cycle(residual)
        now = float(residual @ z)
        if not now > 0:
            return None
        direction *= now / before
        direction += z
        before = now
        image = A @ direction
        step = now / float(direction @ image)
        x += step * direction
        residual -= step * image
    return None


def _cycle_of(A: Any) -> Callable[[Floats], Floats]:
    """Make the V-cycle of a matrix: matrices, interpolations and the solver of the last level."""
    levels: list[tuple[Any, Any, Any]] = []
    constant = np.ones(A.shape[0])
    while A.shape[0] > _COARSEST and len(levels) < _MOST_LEVELS:
        T, coarser = _tentative(A, constant)
        if not 0 < T.shape[1] < A.shape[0]:
            break
        constant = coarser
        inverse = scipy.sparse.diags_array(1.0 / A.diagonal())
        P = scipy.sparse.csr_matrix(T - (_OMEGA / _radius(A)) * (inverse @ (A @ T)))
        R = scipy.sparse.csr_matrix(P.T)
        levels.append((A, P, R))
        A = scipy.sparse.csr_matrix(R @ A @ P)
    coarsest = scipy.sparse.linalg.splu(scipy.sparse.csc_matrix(A))

    def solve(right: Floats, number: int = 0) -> Floats:
        if number == len(levels):
            return np.asarray(coarsest.solve(right))
        A, P, R = levels[number]
        x = np.zeros(len(right))
        _sweep(A, x, right, backward=False)
        x += P @ solve(R @ (right - A @ x), number + 1)
        # The same sweep mirrored: the whole is symmetric.
        _sweep(A, x, right, backward=True)
        return x

    return solve


def _tentative(A: Any, constant: Floats) -> tuple[Any, Floats]:
    """Put strongly joined unknowns into groups, (unknowns, groups), each of unit length.

    Each is constant on its unknowns; the second is the coarser constant.
    """
    n, diagonal, entries = A.shape[0], A.diagonal(), A.tocoo()
    a, b = entries.row, entries.col
    is_strong = (entries.data**2 >= _STRONG**2 * diagonal[a] * diagonal[b]) & (a != b)
    near = scipy.sparse.csr_matrix((np.ones(is_strong.sum()), (a[is_strong], b[is_strong])), (n, n))
    group = np.empty(n, dtype=np.int32)
    n_groups = run("mm_group", n, near.indptr, near.indices, group)
    T = scipy.sparse.csr_matrix((constant.copy(), group, np.arange(n + 1)), (n, n_groups))
    lengths = np.sqrt(np.asarray(T.multiply(T).sum(axis=0)).ravel())
    T.data /= lengths[T.indices]
    return T, lengths


def _sweep(A: Any, x: Floats, right: Floats, *, backward: bool) -> None:
    """Solve each row for its own unknown, one after the other."""
    run("mm_sweep", len(x), A.indptr, A.indices, A.data, right, x, int(backward))


def _radius(A: Any) -> float:
    """Largest eigenvalue of the matrix over its diagonal, by powers from a fixed beginning."""
    inverse = 1.0 / A.diagonal()
    x = np.random.default_rng(0).uniform(0.5, 1.5, A.shape[0])
    x *= np.where(np.arange(len(x)) % 2, 1.0, -1.0)
    value = 1.0
    for _ in range(_POWER_STEPS):
        x = inverse * (A @ x)
        value = float(np.linalg.norm(x))
        x /= value
    return value


LARGE: Final = 50_000
"""Unknowns from which on multigrid is quicker."""


def solve_positive_definite(
    matrix: "scipy.sparse.csc_array", right: Floats, report: Reporter = silent
) -> Floats:
    """Solve a sparse symmetric positive definite system.

    Parameters
    ----------
    matrix : (n, n) csc_array
    right : (n,) or (n, k) float64
    report : callable, optional
        Called with the share done of a large system.

    Returns
    -------
    float64, of the shape of the right-hand side

    Raises
    ------
    RuntimeError
        If the matrix is singular.
    """
    # Neighbours near one another, however the vertices are numbered.
    order = scipy.sparse.csgraph.reverse_cuthill_mckee(matrix.tocsr(), symmetric_mode=True)
    permuted, solution = matrix[order][:, order], None
    if len(right) >= LARGE and right.ndim == 1:
        solution = solve_by_multigrid(permuted, right[order], report)
    if solution is None:
        factors = scipy.sparse.linalg.splu(
            permuted,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
        solution = factors.solve(np.ascontiguousarray(right[order]))
    found = np.empty_like(solution)
    found[order] = solution
    return found
