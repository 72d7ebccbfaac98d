"""Weighted least-squares fit of modal amplitudes to displacements.

Modal superposition (2) u = Phi a of Nastar (1994), inverted: a = argmin |u - Phi a|_W. By
QR of the weighted shapes, never by normal equations, whose condition is the square.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from modalmotion.fit.basis import Basis
from modalmotion.fit.frame_errors import FrameErrors, errors_of, rms_of
from modalmotion.mesh.alignment import Displacements, PositionBlock, ReferenceShape, Rotations
from modalmotion.numeric.products import product, tile
from modalmotion.numeric.scale import lengths
from modalmotion.representation import shown
from modalmotion.template.body_frame import to_local

__all__ = ["Fit", "fit_displacements", "project"]


@shown()
@dataclass(frozen=True, eq=False)
class Fit:
    """Amplitudes of every frame, and their errors.

    Parameters
    ----------
    amplitudes : (frames, modes, n) float64, length unit
        Of x, y, z, of the radial, tangential and axial displacement, or of the offset.
    rotations : Rotations
        Removed before the fit, about the centroid of each frame.
    translations : (frames, 3) float64, length unit
        Path of the weighted centroid from the reference's.
    errors : FrameErrors
    motion_rms, weighted_motion_rms : (frames,) float64, length unit
        RMS displacement from the reference, rotation removed: the errors `rms` and
        `weighted_rms` with no modes.
    reference_amplitudes : (modes, 3) float64, length unit
        Amplitudes of the reference itself, of its positions from its centroid; zero where
        components are radial, tangential and axial.
    """

    amplitudes: NDArray[np.float64]
    rotations: Rotations
    translations: NDArray[np.float64]
    errors: FrameErrors
    motion_rms: NDArray[np.float64]
    weighted_motion_rms: NDArray[np.float64]
    reference_amplitudes: NDArray[np.float64]


def fit_displacements(
    displacements: Displacements, basis: Basis, frames: NDArray[np.float64] | None = None
) -> Fit:
    """Fit every frame, in blocks of bounded memory.

    Parameters
    ----------
    displacements : Displacements
    basis : Basis
    frames : (vertices, n, 3) float64, optional
        Local directions of the components, from `local_frames`, or the only one of an offset;
        x, y, z by default.

    Returns
    -------
    Fit
    """
    products = _Products.of(basis, displacements.shape, frames)
    parts = [products.fit(block) for block in displacements.positions()]
    columns: dict[str, NDArray[np.float64]] = {
        column.name: np.concatenate([getattr(part, column.name) for part in parts])
        for column in fields(Fit)
        if column.name not in ("rotations", "errors", "reference_amplitudes")
    }
    rotations = Rotations(
        np.concatenate([part.rotations.matrices for part in parts]),
        np.concatenate([part.rotations.is_determined for part in parts]),
    )
    errors = FrameErrors.joined([part.errors for part in parts])
    return Fit(
        rotations=rotations,
        errors=errors,
        reference_amplitudes=parts[0].reference_amplitudes,
        **columns,
    )


def project(basis: Basis, displacements: NDArray[np.float64]) -> NDArray[np.float64]:
    """Amplitudes of displacements: their weighted least-squares fit.

    Parameters
    ----------
    basis : Basis
    displacements : (frames, vertices, 3) float64, length unit
        Fastest as a view on memory that runs along the vertices, as a `DisplacementBlock` has
        them.

    Returns
    -------
    (frames, modes, 3) float64, length unit
    """
    rows = np.ascontiguousarray(displacements.transpose(0, 2, 1))
    f, _, n = rows.shape
    a = product(rows.reshape(3 * f, n), basis.columns)[:, : len(basis.modes)]
    return a.reshape(f, 3, -1).transpose(0, 2, 1)


@dataclass(frozen=True, eq=False)
class _Products:
    """Rotation and fit of frames in two products over the vertices.

    The turned displacements u = R'(x - d) + d - rest, d the drift of the centroid, are never
    built. The products of x with the projector, the reference and the weights give rotation and
    amplitudes; the residual is taken before turning back, where it is as long:

        |u - Phi a| = |x - (R a Phi + R rest + d - R d)|.

    Local components turn from vertex to vertex: displacements in them are built first, and are
    positions from a reference at rest in the centroid, with no rotation left.

    Parameters
    ----------
    basis : Basis
    shape : ReferenceShape
        Of the blocks.
    frames : (vertices, n, 3) float64 or None
        Local directions; None for x, y, z.
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
    frames: NDArray[np.float64] | None
    columns: NDArray[np.float64]
    rows: NDArray[np.float64]
    of_one: NDArray[np.float64]
    of_rest: NDArray[np.float64]

    @staticmethod
    def of(basis: Basis, shape: ReferenceShape, frames: NDArray[np.float64] | None) -> _Products:
        """Prepare the products of one basis and one reference."""
        m, n = basis.projector.shape
        rest = shape.rest if frames is None else np.zeros_like(shape.rest)
        # Products are fastest with a multiple of four columns.
        columns = np.zeros((n, -(-(m + 4) // 4) * 4))
        columns[:, :m] = basis.columns[:, :m]
        columns[:, m : m + 4] = shape.moments
        rows = np.concatenate([basis.rows, rest, np.ones((1, n))])
        known = product(rows[m:], basis.columns)[:, :m]
        return _Products(basis, shape, frames, columns, rows, known[3], known[:3])

    def fit(self, block: PositionBlock) -> Fit:
        """Fit a block, in the unit of the sequence."""
        f, _, n = block.positions.shape
        m, shape = len(self.basis.modes), self.shape
        x, turned = block.positions, None
        if self.frames is not None:
            turned = block.turned_back()
            x = to_local(turned.u, self.frames)
        n_directions = x.shape[1]
        rows = x.reshape(n_directions * f, n)
        sums = product(rows, self.columns).reshape(f, n_directions, -1)
        if turned is None:
            rotations, drifts = block.alignment(sums[:, :, m : m + 4])
            R, d = rotations.matrices, drifts
        else:
            rotations, drifts = turned.rotations, turned.drifts
            R = np.tile(np.eye(n_directions), (f, 1, 1))
            d = np.zeros((f, n_directions))
        centre = d[:, :, None] * self.of_one
        # a = P u = R'(P x - d P 1) + d P 1 - P rest
        a = R.transpose(0, 2, 1) @ (sums[:, :, :m] - centre) + centre - self.of_rest[:n_directions]
        # A frame that repeats the reference has not moved at all.
        a[block.is_still] = 0.0
        model = np.zeros((f, n_directions, m + 4))
        model[:, :, :m] = R @ a
        model[:, :, m : m + n_directions] = R
        model[:, :, m + 3] = d - (R @ d[:, :, None])[:, :, 0]
        amplitudes = np.ascontiguousarray(a.transpose(0, 2, 1)) * shape.scale
        loose = block.loose.displacements(rotations, drifts * shape.scale)
        still = np.ascontiguousarray(model[:, :, m:])
        motion_rms, weighted_motion_rms = rms_of(*self._squares(rows, still, m), lengths(loose))
        if self.frames is not None:
            loose = np.einsum("nij,fnj->fni", self.frames[block.loose.vertices], loose)
        loose -= self.basis.shapes[block.loose.vertices] @ amplitudes
        errors = errors_of(*self._squares(rows, model, 0), lengths(loose))
        return Fit(
            amplitudes=amplitudes,
            rotations=rotations,
            translations=drifts * shape.scale,
            errors=errors,
            motion_rms=motion_rms,
            weighted_motion_rms=weighted_motion_rms,
            reference_amplitudes=np.ascontiguousarray(self.of_rest.T) * shape.scale,
        )

    def _squares(
        self, rows: NDArray[np.float64], model: NDArray[np.float64], first: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
        """Squares of distances from a model by the shapes from the first on; weights; scale."""
        coefficients = model.reshape(len(rows), -1)
        squares = _squared_distances(rows, coefficients, self.rows[first:], model.shape[1])
        weights = self.shape.weights
        if len(self.shape.ignored):
            squares = np.delete(squares, self.shape.ignored, axis=1)
            weights = np.delete(weights, self.shape.ignored)
        return squares, weights, self.shape.scale


def _squared_distances(
    rows: NDArray[np.float64],
    coefficients: NDArray[np.float64],
    shapes: NDArray[np.float64],
    n_directions: int,
) -> NDArray[np.float64]:
    """Squares of rows - coefficients shapes, the directions added, (frames, vertices).

    A few vertices at a time, while they are in the cache.
    """
    m, n = rows.shape
    squares = np.empty((m // n_directions, n))
    step = tile(m, n, len(shapes))[1]
    for j in range(0, n, step):
        part = product(coefficients, shapes[:, j : j + step])
        np.subtract(rows[:, j : j + step], part, out=part)
        part *= part
        by_frame = part.reshape(len(squares), n_directions, -1)
        np.add.reduce(by_frame, axis=1, out=squares[:, j : j + step])
    return squares
