"""Weighted least-squares fit of modal amplitudes, and the errors of each frame.

Modal superposition (2) u = Phi a of Nastar (1994), inverted: a = argmin |u - Phi a|_W. By
QR of the weighted shapes, never by normal equations, whose condition is the square.

A plain name counts every vertex that was sent, and all alike; `weighted` precedes what
counts each by its share of the surface.

The edges decide, which hardly change when a surface moves; the fit says only where to look.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.mesh.alignment import Displacements, PositionBlock, ReferenceShape, Rotations
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.numeric.products import (
    exceeded_by_a_twentieth,
    lengths,
    power_of_two,
    product,
    tile,
)
from modalmotion.representation import numeral, shown
from modalmotion.signature.basis import Basis
from modalmotion.template import Template
from modalmotion.template.body_frame import to_local


@dataclass(frozen=True, eq=False)
class FrameErrors:
    """Distances between vertices and their reconstruction.

    Parameters
    ----------
    rms : (frames,) float64, length unit
        Over all vertices.
    weighted_rms : (frames,) float64, length unit
        Over the surface, each vertex by its weight: what the fit makes least.
    p95 : (frames,) float64, length unit
        A twentieth of all vertices are farther off.
    max : (frames,) float64, length unit
        Of any vertex.
    surface_max : (frames,) float64, length unit
        Of any vertex that is in a triangle.
    """

    rms: NDArray[np.float64]
    weighted_rms: NDArray[np.float64]
    p95: NDArray[np.float64]
    max: NDArray[np.float64]
    surface_max: NDArray[np.float64]

    @staticmethod
    def joined(parts: list[FrameErrors]) -> FrameErrors:
        """Put the errors of consecutive frames together."""
        return FrameErrors(
            *(
                np.concatenate([getattr(part, f.name) for part in parts])
                for f in fields(FrameErrors)
            )
        )


def errors_of(
    squares: NDArray[np.float64],
    weights: NDArray[np.float64],
    scale: float,
    loose: NDArray[np.float64] | None = None,
) -> FrameErrors:
    """Take the errors from distances.

    Parameters
    ----------
    squares : (frames, vertices) float64, in units of the scale squared
        At the vertices of the surface.
    weights : (vertices,) float64
        Their shares of it.
    scale : float, length unit
    loose : (frames, n) float64, length unit, optional
        Distances of the vertices in no triangle, which may be of any size.
    """
    weighted = _weighted_rms(squares, weights, scale)
    largest = scale * np.sqrt(squares.max(axis=1))
    if loose is None or not loose.shape[1]:
        rms = scale * np.sqrt(squares.mean(axis=1))
        p95 = scale * np.sqrt(exceeded_by_a_twentieth(squares))
        return FrameErrors(rms, weighted, p95, largest, largest)
    distances = np.concatenate([scale * np.sqrt(squares), loose], axis=1)
    rms, most = _plain_rms(distances)
    return FrameErrors(rms, weighted, exceeded_by_a_twentieth(distances), most, largest)


def rms_of(
    squares: NDArray[np.float64],
    weights: NDArray[np.float64],
    scale: float,
    loose: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Take the plain and the weighted RMS alone from distances; parameters as of `errors_of`."""
    weighted = _weighted_rms(squares, weights, scale)
    if not loose.shape[1]:
        return scale * np.sqrt(squares.mean(axis=1)), weighted
    return _plain_rms(np.concatenate([scale * np.sqrt(squares), loose], axis=1))[0], weighted


def _weighted_rms(
    squares: NDArray[np.float64], weights: NDArray[np.float64], scale: float
) -> NDArray[np.float64]:
    # einsum adds in one order on any number of threads.
    weighted: NDArray[np.float64] = scale * np.sqrt(np.einsum("fn,n->f", squares, weights))
    return weighted


def _plain_rms(
    distances: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Root of the mean square of distances of any size, and the largest of them."""
    most = distances.max(axis=1)
    shares = distances / np.where(most > 0, most, 1.0)[:, None]
    return most * np.sqrt((shares**2).mean(axis=1)), most


def errors_of_offsets(offsets: NDArray[np.float64], template: Template) -> FrameErrors:
    """Take the errors from the vectors between vertices and their reconstruction.

    Parameters
    ----------
    offsets : (frames, vertices, 3) float64, length unit
    template : Template
    """
    loose, weights, isolated = None, template.weights, template.isolated
    if len(isolated):
        loose = lengths(offsets[:, isolated])
        offsets = np.delete(offsets, isolated, axis=1)
        weights = np.delete(weights, isolated)
    scale = power_of_two(float(np.abs(offsets).max(initial=0.0)))
    return errors_of(((offsets / scale) ** 2).sum(axis=2), weights, scale, loose)


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


# A largest error is checked beyond so many p95 errors, or this share of the surface.
_P95S: Final = 8.0
_SHARE: Final = 0.2

# Edges of a stray vertex are longer by at least this share of the error; half of the edges of a
# frame that is numbered otherwise are longer, or shorter, by this factor.
_OF_ERROR: Final = 0.5
_FACTOR: Final = 3.0


def notes_on_strays(sequence: MeshSequence, template: Template, fit: Fit) -> list[str]:
    """Name the frame with the largest error, and its vertex, if they are out of place.

    Costs nothing where the errors are those of a surface that moves.

    Parameters
    ----------
    sequence : MeshSequence
    template : Template
        Its vertices are the reference.
    fit : Fit
        Of the sequence.

    Returns
    -------
    list of str
        Empty, or one note.
    """
    start, unit = template.vertices, sequence.unit or "length units"
    # Direction by direction, which is ten times as fast as all at once.
    extent = max(float(np.ptp(x)) for x in start.T)
    largest = fit.errors.surface_max
    frame, error = int(largest.argmax()), float(largest.max())
    farthest = int(fit.weighted_motion_rms.argmax())
    suspects = []
    if fit.weighted_motion_rms[farthest] > _SHARE * extent:
        suspects.append(farthest)
    if error > min(_P95S * float(fit.errors.p95[frame]), _SHARE * extent):
        suspects.append(frame)
    sides = _sides(template) if suspects else np.zeros((0, 2), dtype=np.int64)
    if not len(sides) or not extent > 0:
        return []
    before = _lengths(start, sides, extent)
    usual = float(np.median(before))
    for suspect in suspects:
        after = _lengths(sequence.vertices[suspect].astype(np.float64), sides, extent)
        length = float(np.median(after))
        if not usual / _FACTOR <= length <= usual * _FACTOR:
            text = (
                f"Frame {suspect} does not go with the others: half of its edges are "
                f"{length / usual if usual > 0 else np.inf:.3g} times as long as in the reference. "
                "Its vertices may be numbered otherwise, or be in another unit; send it again or "
                "leave it out."
            )
            return [text]
    growth = np.full(len(start), np.inf)
    np.minimum.at(growth, sides.ravel(), np.repeat(after - before, 2))
    growth[np.isinf(growth)] = 0.0
    strays = np.flatnonzero(growth > _OF_ERROR * error / extent)
    if frame not in suspects or not len(strays):
        return []
    vertex = int(growth.argmax())
    more = "" if len(strays) == 1 else f" ({len(strays)} such vertices in this frame)"
    text = (
        f"Frame {frame}, vertex {vertex} is out of place: each edge to its neighbours is at least "
        f"{numeral(float(growth[vertex]) * extent)} {unit} longer than in the reference{more}. "
        "Correct the vertex or its number, or leave the frame out: the errors stated here count it."
    )
    return [text]


def _sides(template: Template) -> NDArray[np.int64]:
    """Pairs of neighbours, those inside a surface twice."""
    if len(template.faces):
        sides: NDArray[np.int64] = template.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        proper: NDArray[np.int64] = sides[sides[:, 0] != sides[:, 1]]
        return proper
    if template.surface is not None and template.surface.n_axes == 1:
        along = np.arange(len(template.vertices))
        return np.stack([along[:-1], along[1:]], axis=1)
    return np.zeros((0, 2), dtype=np.int64)


def _lengths(
    vertices: NDArray[np.float64], sides: NDArray[np.int64], extent: float
) -> NDArray[np.float64]:
    """Lengths of sides over the extent, whose squares are ordinary numbers in any unit."""
    along = (vertices[sides[:, 1]] - vertices[sides[:, 0]]) / extent
    lengths: NDArray[np.float64] = np.linalg.norm(along, axis=1)
    return lengths
