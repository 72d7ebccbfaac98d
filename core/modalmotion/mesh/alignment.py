"""Displacements from a reference, one frame or the mean shape, without the rotation of each frame.

Kabsch, A solution for the best rotation to relate two sets of vectors, Acta Crystallographica A,
1976; Umeyama, Least-squares estimation of transformation parameters between two point patterns,
IEEE PAMI, 1991.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final
from weakref import WeakKeyDictionary

import numpy as np

from modalmotion.mesh.sequence import MEAN, MeshSequence, Reference
from modalmotion.mesh.triangles import curve_weights, vertex_areas
from modalmotion.numeric.scales import power_of_two
from modalmotion.representation import Bools, Floats, Ints, Singles, shown

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

    matrices: Floats
    is_determined: Bools

    @staticmethod
    def none(n_frames: int) -> "Rotations":
        """Rotations of frames that are not turned."""
        return Rotations(np.tile(np.eye(3), (n_frames, 1, 1)), np.ones(n_frames, dtype=np.bool_))


def kabsch(
    covariances: Floats, tolerance: float = RANK_TOLERANCE, noise: Floats | None = None
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


def _nearest_rotations(matrices: Floats) -> tuple[Floats, Floats, Floats]:
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

    centre: Floats
    rest: Floats
    weights: Floats
    scale: float
    tolerance: float
    ignored: Ints

    @cached_property
    def spread(self) -> float:
        """Root mean square distance from the centroid, in units of the scale."""
        return float(np.sqrt((self.weights * (self.rest**2).sum(axis=0)).sum()))

    def noise(self, drift: Floats) -> Floats:
        """Bound the rounding of covariances of frames that drifted so far, (frames,)."""
        far: Floats = np.sqrt((drift**2).sum(axis=1))
        return _ROUNDING * self.spread * far

    @cached_property
    def moments(self) -> Floats:
        """Columns that sum positions x to sum w x x_ref' and to sum w x, (vertices, 4)."""
        return np.concatenate([self.rest * self.weights, self.weights[None]]).T

    @staticmethod
    def at(
        sequence: MeshSequence, weights: Floats, start: Floats, ignored: Ints | None = None
    ) -> "ReferenceShape":
        """Centre positions (vertices, 3) that a sequence is measured from."""
        ignored = np.zeros(0, dtype=np.int64) if ignored is None else ignored
        counted = weights > 0
        centre = weights @ start
        rest = np.ascontiguousarray(start.T - centre[:, None])
        tolerance = _rank_tolerance(sequence, counted, centre, rest)
        scale = _scale(sequence, counted, centre)
        rest[:, ignored] = 0.0
        return ReferenceShape(centre, rest / scale, weights, scale, tolerance, ignored)


def _scale(sequence: MeshSequence, counted: Bools, centre: Floats) -> float:
    """Power of two that brings every counted offset from the centre to 1 or below, or 1."""
    positions = sequence.vertices if counted.all() else sequence.vertices[:, counted]
    low, high = float(positions.min()), float(positions.max())
    largest = max(high - float(centre.min()), float(centre.max()) - low)
    if largest == 0.0 or _SMALLEST < largest < _LARGEST:
        return 1.0
    return power_of_two(largest)


def _rank_tolerance(sequence: MeshSequence, counted: Bools, centre: Floats, rest: Floats) -> float:
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
    u: Floats
    rotations: Rotations
    drifts: Floats
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
    positions: Floats
    is_still: Bools
    shape: ReferenceShape
    remove_rotation: bool

    def alignment(self) -> tuple[Rotations, Floats]:
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
    start: Floats
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


def _centred(positions: Singles | Floats, shape: ReferenceShape) -> Floats:
    """Positions from the reference's centroid, (frames, 3, vertices), in units of the scale."""
    x = np.empty((len(positions), 3, positions.shape[1]))
    np.subtract(positions.transpose(0, 2, 1), shape.centre[:, None], out=x)
    if shape.scale != 1.0:
        x /= shape.scale
    if len(shape.ignored):
        x[:, :, shape.ignored] = shape.rest[:, shape.ignored]
    return x


def _is_still(positions: Singles | Floats, start: Floats, shape: ReferenceShape) -> Bools:
    """Frames that repeat the reference bit for bit, at the vertices that are read."""
    # A few vertices rule out nearly all frames that do not.
    probe = slice(None, None, max(1, len(start) // 16))
    if len(shape.ignored):
        there = np.ones(len(start), dtype=np.bool_)
        there[shape.ignored] = False
        positions, start = positions[:, there], start[there]
    likely: Bools = (positions[:, probe] == start[probe]).all(axis=(1, 2))
    likely[likely] = [np.array_equal(x, start) for x in positions[likely]]
    return likely


# Each brings the means from two starts a hundred times nearer.
_N_ROUNDS: Final = 3


# Rotations whose sum is smaller than this share in one direction turn all the way round.
_UNDECIDED: Final = 1e-6


def mean_shape(sequence: MeshSequence) -> Floats:
    """Mean of all frames, each turned and not moved onto it.

    Parameters
    ----------
    sequence : MeshSequence

    Returns
    -------
    (vertices, 3) float64, in the sequence's unit
        Turned as the frames are on the mean: by the rotation nearest to the sum of those that
        carry it onto them, so that no frame is the first. Where the frames turn all the way round
        this sum points nowhere, and it is turned as frame 0 is. Its centroid is the mean of the
        frames'. A sequence in which nothing moves has frame 0 itself, to the last bit.

    Notes
    -----
    Gower, Generalized Procrustes analysis, Psychometrika, 1975, without reflection and without
    scaling; vertices count by their area on the mean shape.
    """
    sequence = _counted_once(sequence)
    mean: Floats = sequence.vertices[0].astype(np.float64)
    for _ in range(_N_ROUNDS):
        shape = ReferenceShape.at(sequence, _shares(sequence, mean), mean)
        step = np.zeros_like(mean.T)
        for block in Displacements(sequence, mean, shape).blocks():
            step += block.u.sum(axis=0)
        if not step.any():
            break
        mean = mean + step.T * (shape.scale / sequence.n_frames)
    return _turned_to_the_middle(sequence, mean)


def mean_onto(sequence: MeshSequence, reference: int) -> Floats:
    """Mean of all frames, each turned and moved onto one of them, (vertices, 3) float64.

    Vertices without a share of the surface stay where they are.
    """
    start: Floats = sequence.vertices[reference].astype(np.float64)
    counted = _counted_once(sequence)
    first = sequence.representatives
    shares = np.zeros(len(first))
    np.add.at(shares, first, _shares(counted, start))
    shape = ReferenceShape.at(counted, shares, start, np.flatnonzero(shares == 0))
    step = np.zeros_like(start.T)
    for block in Displacements(counted, start, shape).blocks():
        step += (block.u - block.drifts[:, :, None]).sum(axis=0)
    return (start + step.T * (shape.scale / counted.n_frames))[first]


def _counted_once(sequence: MeshSequence) -> MeshSequence:
    """Leave out a last frame that repeats the first, and not because nothing moves then."""
    x, same = sequence.vertices, np.array_equal
    if len(x) <= 3 or not same(x[0], x[-1]) or same(x[0], x[1]) or same(x[-2], x[-1]):
        return sequence
    times = None if sequence.times is None else sequence.times[:-1]
    return replace(sequence, vertices=sequence.vertices[:-1], times=times)


def _turned_to_the_middle(sequence: MeshSequence, mean: Floats) -> Floats:
    """Turn a shape, about its centroid, to where the frames are turned on the mean."""
    shape = ReferenceShape.at(sequence, _shares(sequence, mean), mean)
    total = np.zeros((3, 3))
    for block in Displacements(sequence, mean, shape).blocks():
        total += block.rotations.matrices.sum(axis=0)
    if np.array_equal(total, sequence.n_frames * np.eye(3)):
        return mean
    middle = kabsch(total[None], _UNDECIDED)
    if not middle.is_determined[0]:
        return mean
    turned: Floats = (mean - shape.centre) @ middle.matrices[0].T
    return turned + shape.centre


def _shares(sequence: MeshSequence, positions: Floats) -> Floats:
    """Share of each vertex in the surface, or in the curve; equal shares without either."""
    topology, faces = sequence.topology, sequence.joined
    sizes = np.ones(len(positions))
    # Near size 1 no square is lost, in any unit.
    used = np.full(len(positions), not len(sequence.faces))
    used[sequence.faces.ravel()] = True
    extent = float(np.ptp(positions[used], axis=0).max(initial=0.0))
    scaled = (positions - positions[np.argmax(used)]) / extent if extent > 0 else positions
    if topology is not None and topology.n_axes == 1:
        sizes = curve_weights(scaled, topology)
    elif len(faces):
        sizes = vertex_areas(scaled, faces)
    total = float(sizes.sum())
    if not total > 0:
        return np.full(len(sizes), 1.0 / len(sizes))
    return np.asarray(sizes / total)


# A mean takes up to three passes over all frames, and several steps ask for it.
_MEANS: WeakKeyDictionary[MeshSequence, dict[Reference, Floats]] = WeakKeyDictionary()


def reference_positions(sequence: MeshSequence, reference: Reference) -> Floats:
    """Give the positions that displacements are measured from.

    Parameters
    ----------
    sequence : MeshSequence
    reference : int or "mean"
        A frame, or the mean shape: see `mean_shape`.

    Returns
    -------
    (vertices, 3) float64, in the sequence's unit
    """
    if reference != MEAN:
        return np.asarray(sequence.vertices[reference].astype(np.float64))
    return middle_positions(sequence, reference)


def middle_positions(sequence: MeshSequence, reference: Reference) -> Floats:
    """Mean of all frames where the reference is: each turned and moved onto it.

    Its noise is that of a frame over the root of their number.

    Parameters
    ----------
    sequence : MeshSequence
    reference : int or "mean"

    Returns
    -------
    (vertices, 3) float64, in the sequence's unit
        The reference itself, to the last bit, where nothing moves or it is the mean.
    """
    means = _MEANS.setdefault(sequence, {})
    if reference not in means:
        means[reference] = (
            mean_shape(sequence) if reference == MEAN else mean_onto(sequence, reference)
        )
    return means[reference]


def displacements_from(
    reference: Reference,
    sequence: MeshSequence,
    weights: Floats,
    isolated: Ints | None = None,
    *,
    remove_rotation: bool = True,
) -> Displacements:
    """Measure a sequence from a reference.

    Parameters
    ----------
    reference : int or "mean"
        Frame from which displacements are measured, or the mean shape.
    sequence : MeshSequence
    weights : (vertices,) float64
        Shares of the surface.
    isolated : (n,) int64, optional
        Vertices in no triangle, which neither rotation nor fit reads.
    remove_rotation : bool
        Whether to take out each frame's best rotation about its centroid first.
    """
    start = reference_positions(sequence, reference)
    shape = ReferenceShape.at(sequence, weights, start, isolated)
    return Displacements(sequence, start, shape, remove_rotation)
