"""Displacements from the reference, each frame's rotation removed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.alignment.reference_shape import ReferenceShape
from modalmotion.alignment.rigid import Rotations, kabsch
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.numeric.products import product

# Floats of displacements held at once.
_BLOCK: Final = 500_000


@dataclass(frozen=True, eq=False)
class LooseVertices:
    """Vertices in no triangle: apart from the others, for they may lie anywhere.

    Parameters
    ----------
    vertices : (n,) int64
    positions : (frames, n, 3) float64, length unit
        From the reference's centroid.
    rest : (n, 3) float64, length unit
        Those of the reference, from there too.
    """

    vertices: NDArray[np.int64]
    positions: NDArray[np.float64]
    rest: NDArray[np.float64]

    def displacements(
        self, rotations: Rotations, drifts: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Displacements, rotation removed.

        Parameters
        ----------
        rotations : Rotations
        drifts : (frames, 3) float64, length unit

        Returns
        -------
        (frames, n, 3) float64, length unit
        """
        # u = R'(x - d) + d - rest
        d = drifts[:, None, :]
        u: NDArray[np.float64] = (self.positions - d) @ rotations.matrices
        u += d
        u -= self.rest
        return u


@dataclass(frozen=True, eq=False)
class PositionBlock:
    """Positions in consecutive frames.

    Parameters
    ----------
    frames : slice
    positions : (frames, 3, vertices) float64, in units of the shape's scale
        From the reference's centroid, direction by direction, which is how products and sums
        run fast.
    is_still : (frames,) bool
        True for frames that repeat the reference bit for bit.
    shape : ReferenceShape
        The reference.
    remove_rotation : bool
    loose : LooseVertices
        Those in no triangle.
    """

    frames: slice
    positions: NDArray[np.float64]
    is_still: NDArray[np.bool_]
    shape: ReferenceShape
    remove_rotation: bool
    loose: LooseVertices

    def alignment(self, sums: NDArray[np.float64]) -> tuple[Rotations, NDArray[np.float64]]:
        """Rotations and drifts of the centroid from products with the shape's moments.

        Parameters
        ----------
        sums : (frames, 3, 4) float64

        Returns
        -------
        rotations : Rotations
            About the centroid of each frame.
        drifts : (frames, 3) float64, in units of the scale
            Of the centroid.
        """
        shape, drifts = self.shape, sums[:, :, 3].copy()
        if self.remove_rotation:
            rotations = kabsch(sums[:, :, :3], shape.tolerance, shape.noise(drifts))
        else:
            rotations = Rotations.none(len(sums))
        # A frame that repeats the reference has not moved at all.
        rotations.matrices[self.is_still], drifts[self.is_still] = np.eye(3), 0.0
        return rotations, drifts

    def turned_back(self) -> DisplacementBlock:
        """Displacements, rotation removed. The positions are used up."""
        x, shape = self.positions, self.shape
        f, _, n = x.shape
        sums = product(x.reshape(3 * f, n), shape.moments).reshape(f, 3, 4)
        rotations, drifts = self.alignment(sums)
        # u = R'(x - d) + d - rest
        turned = np.ascontiguousarray(rotations.matrices.transpose(0, 2, 1))
        shifts = drifts - (turned @ drifts[:, :, None])[:, :, 0]
        part = np.empty_like(shape.rest)
        # Frame by frame, while it is in the cache.
        for k, frame in enumerate(x):
            product(turned[k], frame, out=part)
            part += shifts[k][:, None]
            np.subtract(part, shape.rest, out=frame)
        x[self.is_still] = 0.0
        loose = self.loose.displacements(rotations, drifts * shape.scale)
        return DisplacementBlock(
            self.frames, x, rotations, drifts, shape, self.loose.vertices, loose
        )


@dataclass(frozen=True, eq=False)
class DisplacementBlock:
    """Displacements in consecutive frames.

    Parameters
    ----------
    frames : slice
    u : (frames, 3, vertices) float64, in units of the shape's scale
        Direction by direction. May be overwritten.
    rotations : Rotations
        Removed from them, about the centroid of each frame.
    drifts : (frames, 3) float64, in units of the scale
        Of the weighted centroid from the reference's, part of the displacements.
    shape : ReferenceShape
        The reference.
    loose : (n,) int64
        Vertices in no triangle, whose `u` means nothing.
    loose_u : (frames, n, 3) float64, length unit
        Their displacements, rotation removed.
    """

    frames: slice
    u: NDArray[np.float64]
    rotations: Rotations
    drifts: NDArray[np.float64]
    shape: ReferenceShape
    loose: NDArray[np.int64]
    loose_u: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Displacements:
    """Displacements of a sequence from one shape, centred once and worked out block by block.

    Parameters
    ----------
    sequence : MeshSequence
    start : (vertices, 3) float64, length unit
        Positions that they are measured from.
    shape : ReferenceShape
        The same, centred.
    remove_rotation : bool
        Whether each frame's best rotation about its centroid is taken out.
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
                self._loose(frames),
            )

    def _loose(self, frames: slice) -> LooseVertices:
        loose, centre = self.shape.ignored, self.shape.centre
        positions = self.sequence.vertices[frames][:, loose].astype(np.float64) - centre
        return LooseVertices(loose, positions, self.start[loose] - centre)


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
