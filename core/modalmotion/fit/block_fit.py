"""The fit of a block of frames, in the layout (frames, 3, vertices) in which products run fast."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modalmotion.alignment.displacements import PositionBlock, no_rotations
from modalmotion.alignment.reference_shape import ReferenceShape
from modalmotion.alignment.rigid import Rotations, kabsch
from modalmotion.fit.basis import Basis
from modalmotion.numeric.products import product, tile
from modalmotion.numeric.quantile import weighted_quantile


@dataclass(frozen=True, eq=False)
class BlockFit:
    """Amplitudes of some frames and what they leave, in units of the block's scale.

    Parameters
    ----------
    amplitudes : (frames, 3, modes) float64
    rotations : Rotations
    drifts : (frames, 3) float64
        Of the weighted centroid from the reference's.
    mean_squares, p95_squares, max_squares : (frames,) float64
        Of the squared distances between vertices and their reconstruction.
    motion_squares : (frames,) float64
        Mean squared displacement.
    """

    amplitudes: NDArray[np.float64]
    rotations: Rotations
    drifts: NDArray[np.float64]
    mean_squares: NDArray[np.float64]
    p95_squares: NDArray[np.float64]
    max_squares: NDArray[np.float64]
    motion_squares: NDArray[np.float64]


def fit_displacements(
    u: NDArray[np.float64],
    rotations: Rotations,
    drifts: NDArray[np.float64],
    basis: Basis,
    weights: NDArray[np.float64],
    ignored: NDArray[np.int64],
) -> BlockFit:
    """Fit displacements as they are.

    Parameters
    ----------
    u : (frames, 3, vertices) float64
    rotations : Rotations
        Removed from them before.
    drifts : (frames, 3) float64
        Of the weighted centroid, part of them.
    basis : Basis
    weights : (vertices,) float64
    ignored : (n,) int64
        Vertices that count in no error.
    """
    f, _, n = u.shape
    rows = u.reshape(3 * f, n)
    a = product(rows, basis.columns)[:, : len(basis.modes)]
    squares = _squared_distances(rows, np.ascontiguousarray(a), basis.rows)
    return _measured(a.reshape(f, 3, -1), rotations, drifts, squares, basis, weights, ignored)


@dataclass(frozen=True, eq=False)
class PositionFit:
    """Rotation and fit of complete frames in two products over the vertices.

    The turned displacements u = R'(x - d) + d - rest, d the centroid of x, are never made. The
    products of x with the projector, the reference and the weights give rotation and amplitudes;
    the residual is taken before turning back, where it is as long:

        |u - Phi a| = |x - (R a Phi + R rest + d - R d)|.

    Parameters
    ----------
    basis : Basis
    shape : ReferenceShape
    columns : (vertices, modes + 4 and filling) float64
        Projector, moments of the reference, weights.
    rows : (modes + 4, vertices) float64
        Shapes, reference, one.
    of_one : (modes,) float64
        Amplitudes of a unit translation.
    of_rest : (3, modes) float64
        Amplitudes of the reference's own positions.
    """

    basis: Basis
    shape: ReferenceShape
    columns: NDArray[np.float64]
    rows: NDArray[np.float64]
    of_one: NDArray[np.float64]
    of_rest: NDArray[np.float64]

    @staticmethod
    def of(basis: Basis, shape: ReferenceShape) -> PositionFit:
        """Prepare the products of one basis and one reference."""
        m, n = basis.projector.shape
        # Products are fastest with a multiple of four columns.
        columns = np.zeros((n, -(-(m + 4) // 4) * 4))
        columns[:, :m] = basis.columns[:, :m]
        columns[:, m : m + 4] = shape.moments
        rows = np.concatenate([basis.rows, shape.rest, np.ones((1, n))])
        known = product(rows[m:], basis.columns)[:, :m]
        return PositionFit(basis, shape, columns, rows, known[3], known[:3])

    def fit(self, block: PositionBlock, remove_rotation: bool) -> BlockFit:
        """Fit a block in which every position is there."""
        f, _, n = block.positions.shape
        m = len(self.basis.modes)
        rows = block.positions.reshape(3 * f, n)
        sums = product(rows, self.columns).reshape(f, 3, -1)
        of_x, d = sums[:, :, :m], sums[:, :, m + 3].copy()
        d[block.is_still] = 0.0
        if remove_rotation:
            rotations = kabsch(sums[:, :, m : m + 3], self.shape.tolerance, self.shape.noise(d))
            rotations.matrices[block.is_still] = np.eye(3)
        else:
            rotations = no_rotations(f)
        R = rotations.matrices
        centre = d[:, :, None] * self.of_one
        # a = P u = R'(P x - d P 1) + d P 1 - P rest
        a = R.transpose(0, 2, 1) @ (of_x - centre) + centre - self.of_rest
        # A frame that repeats the reference has moved by exactly nothing.
        a[block.is_still] = 0.0
        model = np.empty((f, 3, m + 4))
        model[:, :, :m] = R @ a
        model[:, :, m : m + 3] = R
        model[:, :, m + 3] = d - (R @ d[:, :, None])[:, :, 0]
        squares = _squared_distances(rows, model.reshape(3 * f, m + 4), self.rows)
        weights, ignored = self.shape.weights, self.shape.ignored
        return _measured(a, rotations, d, squares, self.basis, weights, ignored)


def _squared_distances(
    rows: NDArray[np.float64], coefficients: NDArray[np.float64], shapes: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Squares of rows - coefficients shapes, the three directions added, (frames, vertices).

    A few vertices at a time, while they are in the cache.
    """
    m, n = rows.shape
    squares = np.empty((m // 3, n))
    step = tile(m, n, len(shapes))[1]
    for j in range(0, n, step):
        part = product(coefficients, shapes[:, j : j + step])
        np.subtract(rows[:, j : j + step], part, out=part)
        part *= part
        np.add.reduce(part.reshape(m // 3, 3, -1), axis=1, out=squares[:, j : j + step])
    return squares


def _measured(
    a: NDArray[np.float64],
    rotations: Rotations,
    drifts: NDArray[np.float64],
    squares: NDArray[np.float64],
    basis: Basis,
    weights: NDArray[np.float64],
    ignored: NDArray[np.int64],
) -> BlockFit:
    if len(ignored):
        squares[:, ignored] = 0.0
    f, _, m = a.shape
    mean = np.einsum("fn,n->f", squares, weights)
    # The residual is orthogonal to the shapes, so |u|^2 = |Q'u|^2 + |r|^2 with Q'u = R a:
    # a sum of squares, without cancellation.
    kept = product(a.reshape(3 * f, m), np.ascontiguousarray(basis.triangle.T)).reshape(f, -1)
    return BlockFit(
        amplitudes=a,
        rotations=rotations,
        drifts=drifts,
        mean_squares=mean,
        p95_squares=weighted_quantile(squares, weights, 0.95),
        max_squares=squares.max(axis=1),
        motion_squares=np.einsum("fk,fk->f", kept, kept) + mean,
    )
