"""Displacements from a reference shape, with the rotation of each frame removed.

Kabsch, A solution for the best rotation to relate two sets of vectors, Acta Crystallographica A,
1976; Umeyama, Least-squares estimation of transformation parameters between two point patterns,
IEEE PAMI, 1991.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.mesh.sequence import MeshSequence
from modalmotion.numeric.scales import power_of_two
from modalmotion.representation import shown

# Relative to the largest singular value of the covariance: below this a direction is not
# spanned by the points, and the rotation about it is not determined by them. Singular values
# are squares of extents, so this is a thickness of a millionth.
RANK_TOLERANCE: Final = 1e-12

# How strongly an undetermined rotation is drawn to none at all; far below any determined one.
_PULL: Final = 1e-9


@shown()
@dataclass(frozen=True)
class Rotations:
    """Rotations that carry the reference onto each frame.

    Parameters
    ----------
    matrices : (frames, 3, 3) float64
        Proper rotations (determinant +1): position = matrix @ (reference position).
    is_determined : (frames,) bool
        False where the points of either set span less than a plane, or the best fit is not
        unique: the rotation is then the smallest of those that fit equally well.
    """

    matrices: NDArray[np.float64]
    is_determined: NDArray[np.bool_]

    @staticmethod
    def none(n_frames: int) -> Rotations:
        """Rotations of frames that are not turned."""
        return Rotations(np.tile(np.eye(3), (n_frames, 1, 1)), np.ones(n_frames, dtype=np.bool_))


def kabsch(
    covariances: NDArray[np.float64],
    tolerance: float = RANK_TOLERANCE,
    noise: NDArray[np.float64] | None = None,
) -> Rotations:
    """Best proper rotation for each covariance matrix.

    Parameters
    ----------
    covariances : (frames, 3, 3) float64, length unit squared
        sum w (x - centroid) (x_ref - centroid_ref)'.
    tolerance : float
        Smallest second singular value, relative to the first, that is not rounding.
    noise : (frames,) float64, length unit squared, optional
        Singular values up to this are rounding, for any size of the first one.

    Returns
    -------
    Rotations
    """
    largest = np.abs(covariances).max(axis=(1, 2), keepdims=True)
    scaled = covariances / np.where(largest > 0, largest, 1.0)
    matrices, S, sign = _nearest_rotations(scaled)
    # Unique iff the second singular value, with the sign of the third, is not zero:
    # s2 + sign s3 > 0 (Umeyama 1991).
    margin = S[:, 1] + sign * S[:, 2]
    is_determined = margin > tolerance * np.where(S[:, 0] > 0, S[:, 0], np.inf)
    if noise is not None:
        is_determined &= margin * largest[:, 0, 0] > noise
    loose = np.flatnonzero(~is_determined)
    if loose.size:
        # Of all that fit equally well the one nearest to none: the smallest turn.
        pulled = scaled[loose] + max(_PULL, 10 * tolerance) * np.eye(3)
        matrices[loose] = _nearest_rotations(pulled)[0]
        matrices[loose[S[loose, 0] == 0.0]] = np.eye(3)
    return Rotations(matrices, is_determined)


def _nearest_rotations(
    matrices: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Rotations R with the largest trace of R' C, singular values of C, sign of the last one."""
    # R = U diag(1, 1, det(U V')) V' for C = U S V': never a reflection.
    U, S, Vt = np.linalg.svd(matrices)
    sign = np.where(np.linalg.det(U) * np.linalg.det(Vt) < 0, -1.0, 1.0)
    U = U.copy()
    U[:, :, 2] *= sign[:, None]
    return U @ Vt, S, sign


# Relative rounding of sums over thousands of vertices.
_ROUNDING: Final = 1e-13

# Sizes between these need no scaling: their squares are ordinary numbers.
_SMALLEST: Final = 2.0**-200
_LARGEST: Final = 2.0**200


@dataclass(frozen=True, eq=False)
class ReferenceShape:
    """The shape that displacements are measured from, centred.

    Parameters
    ----------
    centre : (3,) float64, length unit
        Weighted centroid.
    rest : (3, vertices) float64, in units of `scale`
        Positions from it.
    weights : (vertices,) float64
        Shares that add up to 1.
    scale : float, length unit
        A power of two; 1 unless the surface is so large or small that squares would
        overflow or vanish.
    tolerance : float
        Of `kabsch`: the thickness that rounding of the stored positions gives to a line.
    ignored : (n,) int64
        Vertices that are not read here: in no triangle.
    """

    centre: NDArray[np.float64]
    rest: NDArray[np.float64]
    weights: NDArray[np.float64]
    scale: float
    tolerance: float
    ignored: NDArray[np.int64]

    @cached_property
    def spread(self) -> float:
        """Root mean square distance from the centroid, in units of the scale."""
        return float(np.sqrt((self.weights * (self.rest**2).sum(axis=0)).sum()))

    def noise(self, drift: NDArray[np.float64]) -> NDArray[np.float64]:
        """Bound the rounding of covariances of frames that drifted so far, (frames,)."""
        far: NDArray[np.float64] = np.sqrt((drift**2).sum(axis=1))
        return _ROUNDING * self.spread * far

    @cached_property
    def moments(self) -> NDArray[np.float64]:
        """Columns that sum positions x to sum w x x_ref' and to sum w x, (vertices, 4)."""
        return np.concatenate([self.rest * self.weights, self.weights[None]]).T

    @staticmethod
    def at(
        sequence: MeshSequence,
        weights: NDArray[np.float64],
        start: NDArray[np.float64],
        ignored: NDArray[np.int64] | None = None,
    ) -> ReferenceShape:
        """Centre positions (vertices, 3) that a sequence is measured from."""
        ignored = np.zeros(0, dtype=np.int64) if ignored is None else ignored
        counted = weights > 0
        centre = weights @ start
        rest = np.ascontiguousarray(start.T - centre[:, None])
        tolerance = _rank_tolerance(sequence, counted, centre, rest)
        scale = _scale(sequence, counted, centre)
        rest[:, ignored] = 0.0
        return ReferenceShape(centre, rest / scale, weights, scale, tolerance, ignored)


def _scale(
    sequence: MeshSequence, counted: NDArray[np.bool_], centre: NDArray[np.float64]
) -> float:
    """Power of two that brings every counted offset from the centre to 1 or below, or 1."""
    positions = sequence.vertices if counted.all() else sequence.vertices[:, counted]
    low, high = float(positions.min()), float(positions.max())
    largest = max(high - float(centre.min()), float(centre.max()) - low)
    if largest == 0.0 or _SMALLEST < largest < _LARGEST:
        return 1.0
    return power_of_two(largest)


def _rank_tolerance(
    sequence: MeshSequence,
    counted: NDArray[np.bool_],
    centre: NDArray[np.float64],
    rest: NDArray[np.float64],
) -> float:
    """Square of the thickness that rounding of the stored positions gives to a line."""
    extent = float(np.abs(rest[:, counted]).max(initial=0.0))
    if extent == 0.0:
        return RANK_TOLERANCE
    largest = float(np.abs(centre).max()) + extent
    step = float(np.finfo(sequence.vertices.dtype).eps) * largest / extent
    return max(RANK_TOLERANCE, (4 * step) ** 2)


# Floats of displacements held at once.
_BLOCK: Final = 500_000


@dataclass(frozen=True, eq=False)
class DisplacementBlock:
    """Displacements in consecutive frames.

    Parameters
    ----------
    frames : slice
    u : (frames, 3, vertices) float64, in units of the shape's scale
        Rotation removed; of no meaning at vertices in no triangle.
    rotations : Rotations
        Removed, about the centroid.
    drifts : (frames, 3) float64, in units of the shape's scale
        Path of the centroid, which is part of the displacements.
    shape : ReferenceShape
    """

    frames: slice
    u: NDArray[np.float64]
    rotations: Rotations
    drifts: NDArray[np.float64]
    shape: ReferenceShape


@dataclass(frozen=True, eq=False)
class PositionBlock:
    """Positions in consecutive frames.

    Parameters
    ----------
    frames : slice
    positions : (frames, 3, vertices) float64, in units of the shape's scale
        From the reference's centroid; at ignored vertices those of the reference.
    is_still : (frames,) bool
        Whether a frame repeats the reference bit for bit.
    shape : ReferenceShape
    remove_rotation : bool
    """

    frames: slice
    positions: NDArray[np.float64]
    is_still: NDArray[np.bool_]
    shape: ReferenceShape
    remove_rotation: bool

    def alignment(self) -> tuple[Rotations, NDArray[np.float64]]:
        """Rotations from the reference, and drifts of the centroid, in units of the scale."""
        shape = self.shape
        f, _, n = self.positions.shape
        sums = (self.positions.reshape(3 * f, n) @ shape.moments).reshape(f, 3, 4)
        drifts = sums[:, :, 3].copy()
        rotations = Rotations.none(len(sums))
        if self.remove_rotation:
            rotations = kabsch(sums[:, :, :3], shape.tolerance, shape.noise(drifts))
        # A frame that repeats the reference has not moved at all.
        rotations.matrices[self.is_still], drifts[self.is_still] = np.eye(3), 0.0
        return rotations, drifts

    def turned_back(self) -> DisplacementBlock:
        """Displacements, rotation removed. The positions are used up."""
        rotations, drifts = self.alignment()
        # u = R'(x - d) + d - rest
        turned = rotations.matrices.transpose(0, 2, 1)
        shifts = (drifts - (turned @ drifts[:, :, None])[:, :, 0])[:, :, None]
        u = self.positions
        # Frame by frame, while it is in the cache.
        for k, frame in enumerate(u):
            part = turned[k] @ frame
            part += shifts[k]
            np.subtract(part, self.shape.rest, out=frame)
        u[self.is_still] = 0.0
        return DisplacementBlock(self.frames, u, rotations, drifts, self.shape)


@dataclass(frozen=True, eq=False)
class Displacements:
    """Displacements of a sequence from one shape, centred once and worked out block by block.

    Parameters
    ----------
    sequence : MeshSequence
    start : (vertices, 3) float64, length unit
        The shape that displacements are measured from.
    shape : ReferenceShape
        The same, centred.
    remove_rotation : bool
    """

    sequence: MeshSequence
    start: NDArray[np.float64]
    shape: ReferenceShape
    remove_rotation: bool = True

    def blocks(self) -> Iterator[DisplacementBlock]:
        """Displacements of all frames, in blocks of bounded memory."""
        return (block.turned_back() for block in self.positions())

    def positions(self) -> Iterator[PositionBlock]:
        """Positions in all frames, in blocks of bounded memory."""
        n, last = max(1, _BLOCK // (3 * self.sequence.n_vertices)), self.sequence.n_frames
        for k in range(0, last, n):
            frames = slice(k, min(k + n, last))
            vertices = self.sequence.vertices[frames]
            yield PositionBlock(
                frames,
                _centred(vertices, self.shape),
                _is_still(vertices, self.start, self.shape),
                self.shape,
                self.remove_rotation,
            )


def _centred(
    positions: NDArray[np.float32] | NDArray[np.float64], shape: ReferenceShape
) -> NDArray[np.float64]:
    """Positions from the reference's centroid, (frames, 3, vertices), in units of the scale."""
    x = np.empty((len(positions), 3, positions.shape[1]))
    centre = shape.centre[:, None]
    if positions.dtype == np.float64:
        np.subtract(positions.transpose(0, 2, 1), centre, out=x)
    else:
        np.copyto(x, positions.transpose(0, 2, 1))
        x -= centre
    if shape.scale != 1.0:
        x /= shape.scale
    if len(shape.ignored):
        x[:, :, shape.ignored] = shape.rest[:, shape.ignored]
    return x


def _is_still(
    positions: NDArray[np.float32] | NDArray[np.float64],
    start: NDArray[np.float64],
    shape: ReferenceShape,
) -> NDArray[np.bool_]:
    """Frames that repeat the reference bit for bit, at the vertices that are read."""
    # A few vertices rule out nearly all frames that do not.
    probe = slice(None, None, max(1, len(start) // 16))
    if len(shape.ignored):
        there = np.ones(len(start), dtype=np.bool_)
        there[shape.ignored] = False
        positions, start = positions[:, there], start[there]
    likely: NDArray[np.bool_] = (positions[:, probe] == start[probe]).all(axis=(1, 2))
    likely[likely] = [np.array_equal(x, start) for x in positions[likely]]
    return likely
