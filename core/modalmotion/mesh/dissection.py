"""Direct solution of sparse symmetric systems on surfaces.

The order of elimination decides the cost. Cutting the surface in halves along the longest
direction, again and again, and eliminating the cuts last (George, Nested dissection of a
regular finite element mesh, SIAM Journal on Numerical Analysis, 1973) keeps the factor at
about n log n entries however the vertices are numbered. Orders that look at the numbering
alone cost up to twenty times as much on a mesh refined by subdivision.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from modalmotion.mesh.multigrid import solve_by_multigrid
from modalmotion.mesh.space_order import space_order
from modalmotion.progress import ShareReport, silent

LARGE: Final = 50_000
"""Unknowns from which on multigrid is quicker."""

# Unknowns in the last pieces, which are not cut any more.
_LEAF = 64


def nested_dissection(
    positions: NDArray[np.float64], rows: NDArray[np.int64], columns: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Order of elimination that keeps the factor small.

    Parameters
    ----------
    positions : (n, 3) float64
        Place of each unknown.
    rows, columns : (entries,) int64
        Nonzero entries off the diagonal; one triangle of the matrix is enough.

    Returns
    -------
    (n,) int64
        Unknowns in the order in which to eliminate them.
    """
    n = len(positions)
    coordinates = np.ascontiguousarray(positions.T)
    n_levels = max(0, int(np.ceil(np.log2(max(n, 1) / _LEAF))))
    region = np.zeros(n, dtype=np.int64)
    # Base 3, most significant digit first: 0 and 1 for the halves, 2 for the cut between.
    key = np.zeros(n, dtype=np.int64)
    active = np.arange(n)
    is_cut = np.zeros(n, dtype=np.bool_)
    for level in range(n_levels):
        side = np.zeros(n, dtype=np.int64)
        side[active] = _halves(coordinates[:, active], region[active], 2**level)
        # An edge between the halves loses its end in the first half.
        crossing = side[rows] != side[columns]
        first, second = rows[crossing], columns[crossing]
        cut = np.where(side[first] == 0, first, second)
        is_cut[cut] = True
        side[cut] = 2
        key *= 3
        key += side
        region *= 2
        region += side
        active = active[~is_cut[active]]
        inside = ~(crossing | is_cut[rows] | is_cut[columns])
        rows, columns = rows[inside], columns[inside]
    return np.argsort(key, kind="stable")


def _halves(
    coordinates: NDArray[np.float64], region: NDArray[np.int64], n_regions: int
) -> NDArray[np.bool_]:
    """Unknowns beyond the mean of their region along its longest direction."""
    count = np.maximum(np.bincount(region, minlength=n_regions), 1)
    offsets = np.empty_like(coordinates)
    spread = np.empty((3, n_regions))
    for axis in range(3):
        mean = np.bincount(region, weights=coordinates[axis], minlength=n_regions) / count
        offsets[axis] = coordinates[axis] - mean[region]
        spread[axis] = np.bincount(region, weights=offsets[axis] ** 2, minlength=n_regions)
    longest = spread.argmax(axis=0)[region]
    beyond: NDArray[np.bool_] = np.take_along_axis(offsets, longest[None], axis=0)[0] > 0
    return beyond


def solve_positive_definite(
    matrix: scipy.sparse.csc_array,
    right: NDArray[np.float64],
    positions: NDArray[np.float64],
    report: ShareReport = silent,
) -> NDArray[np.float64]:
    """Solve a sparse symmetric positive definite system.

    Parameters
    ----------
    matrix : (n, n) scipy.sparse.csc_array of float64
    right : (n,) or (n, k) float64
    positions : (n, 3) float64
        Place of each unknown; used for the order of elimination only.
    report : callable, optional
        Told the share of a large system's solution that is there.

    Returns
    -------
    (n,) or (n, k) float64

    Raises
    ------
    RuntimeError
        If the matrix is singular.

    Notes
    -----
    Large systems are solved by multigrid if it converges, to 1e-10 of the largest value of the
    direct solution; a factor of a million unknowns takes gigabytes.
    """
    entries = matrix.tocoo()
    if len(right) >= LARGE and right.ndim == 1:
        # Each step reads the whole matrix: where its rows lie anywhere it takes four times as long.
        order = space_order(positions)
        permuted, place = _permuted(entries, order)
        solution = solve_by_multigrid(permuted, right[order], report)
        if solution is not None:
            return solution[place]
        del permuted
    off = entries.row < entries.col
    order = nested_dissection(positions, entries.row[off], entries.col[off])
    permuted, place = _permuted(entries, order)
    factors = scipy.sparse.linalg.splu(
        permuted, permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )
    exact: NDArray[np.float64] = factors.solve(np.ascontiguousarray(right[order]))[place]
    return exact


def _permuted(
    entries: scipy.sparse.coo_array, order: NDArray[np.int64]
) -> tuple[scipy.sparse.csc_array, NDArray[np.int64]]:
    """Renumber the unknowns of a matrix; gives the new number of each besides."""
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    permuted = scipy.sparse.csc_array(
        (entries.data, (place[entries.row], place[entries.col])), entries.shape
    )
    return permuted, place
