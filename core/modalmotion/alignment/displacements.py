"""Displacements from the reference, each frame's rotation removed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modalmotion.alignment.reference_shape import ReferenceShape
from modalmotion.alignment.rigid import Rotations, kabsch
from modalmotion.errors import ParameterError
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.numeric.products import product, weighted_sum

# Floats of displacements held at once.
_BLOCK = 500_000

# Vertices turned at once: they stay in the cache, and one thread does it.
_COLUMNS = 1000


@dataclass(frozen=True, eq=False)
class PositionBlock:
    """Positions in some frames, from the reference's centroid.

    Parameters
    ----------
    first : int
        Index of the first frame.
    positions : (frames, 3, vertices) float64, in units of the scale
        Direction by direction, which is how products and sums run fast.
    is_still : (frames,) bool
        Which frames repeat the reference bit for bit.
    present : (frames, vertices) bool or None
        Which positions are there; None if all are.
    """

    first: int
    positions: NDArray[np.float64]
    is_still: NDArray[np.bool_]
    present: NDArray[np.bool_] | None

    def __len__(self) -> int:
        return len(self.positions)


def position_blocks(
    sequence: MeshSequence,
    shape: ReferenceShape,
    start: NDArray[np.float64],
    present: NDArray[np.bool_] | None = None,
) -> Iterator[PositionBlock]:
    """Positions of all frames, a block of bounded memory at a time.

    Parameters
    ----------
    sequence : MeshSequence
    shape : ReferenceShape
        Of the positions `start`.
    start : (vertices, 3) float64, length unit
    present : (frames, vertices) bool, optional
        Which positions are there; the others are not read.
    """
    n = max(1, _BLOCK // (3 * sequence.n_vertices))
    for first in range(0, sequence.n_frames, n):
        taken = sequence.vertices[first : first + n]
        there = None if present is None else present[first : first + n]
        if there is not None and there.all():
            there = None
        x = _centred(taken, shape, there)
        yield PositionBlock(first, x, _is_still(taken, start, there), there)


def aligned(
    block: PositionBlock, shape: ReferenceShape, remove_rotation: bool
) -> tuple[NDArray[np.float64], Rotations]:
    """Turn each frame back onto the reference and subtract it. The block is used up.

    Parameters
    ----------
    block : PositionBlock
    shape : ReferenceShape
    remove_rotation : bool

    Returns
    -------
    displacements : (frames, 3, vertices) float64, in units of the scale
        Zero where positions are missing.
    rotations : Rotations
        About the centroid of each frame. Where positions are missing the rotation comes from
        those that are there, and the centroid is that of the whole reference carried along.

    Raises
    ------
    ParameterError
        Naming the first frame in which no weighted vertex is there.
    """
    if block.present is None:
        u, rotations = _aligned(block.positions, shape, remove_rotation)
    else:
        u, rotations = _aligned_partly(block, block.present, shape, remove_rotation)
    # A frame that repeats the reference has moved by exactly nothing.
    u[block.is_still] = 0.0
    rotations.matrices[block.is_still] = np.eye(3)
    return u, rotations


def _centred(
    taken: NDArray[np.float32] | NDArray[np.float64],
    shape: ReferenceShape,
    there: NDArray[np.bool_] | None,
) -> NDArray[np.float64]:
    """Positions from the reference's centroid, (frames, 3, vertices), in units of the scale."""
    x = np.empty((len(taken), 3, taken.shape[1]))
    centre = shape.centre[:, None]
    if taken.dtype == np.float64:
        np.subtract(taken.transpose(0, 2, 1), centre, out=x)
    else:
        np.copyto(x, taken.transpose(0, 2, 1))
        x -= centre
    if shape.scale != 1.0:
        x /= shape.scale
    if there is not None:
        np.copyto(x, shape.rest, where=~there[:, None, :])
    if len(shape.ignored):
        x[:, :, shape.ignored] = 0.0
    return x


def _aligned(
    x: NDArray[np.float64], shape: ReferenceShape, remove_rotation: bool
) -> tuple[NDArray[np.float64], Rotations]:
    f, _, n = x.shape
    if not remove_rotation:
        x -= shape.rest
        return x, no_rotations(f)
    # The sum of w x x_ref' needs no centred x, for the reference's offsets add up to zero.
    sums = product(x.reshape(3 * f, n), shape.moments).reshape(f, 3, 4)
    drift = sums[:, :, 3]
    rotations = kabsch(sums[:, :, :3], shape.tolerance, shape.noise(drift))
    # u = R'(x - drift) + drift - rest
    turned = np.ascontiguousarray(rotations.matrices.transpose(0, 2, 1))
    shift = drift - (turned @ drift[:, :, None])[:, :, 0]
    for j in range(0, n, _COLUMNS):
        columns = slice(j, j + _COLUMNS)
        part = np.matmul(turned, x[:, :, columns])
        part += shift[:, :, None]
        np.subtract(part, shape.rest[:, columns], out=x[:, :, columns])
    return x, rotations


def _aligned_partly(
    block: PositionBlock,
    present: NDArray[np.bool_],
    shape: ReferenceShape,
    remove_rotation: bool,
) -> tuple[NDArray[np.float64], Rotations]:
    x, rotations = block.positions, no_rotations(len(block))
    for k, kept in enumerate(present):
        share = np.where(kept, shape.weights, 0.0)
        total = float(share.sum())
        if not total > 0:
            raise ParameterError(
                f"No vertex of the surface is there in frame {block.first + k}.",
                remedy="Leave the frame out.",
                frame=block.first + k,
            )
        share /= total
        if remove_rotation:
            here, before = weighted_sum(share, x[k].T), weighted_sum(share, shape.rest.T)
            offsets = shape.rest - before[:, None]
            covariance = product(x[k] - here[:, None], np.ascontiguousarray((offsets * share).T))
            found = kabsch(covariance[None], shape.tolerance, shape.noise(here[None]))
            R = found.matrices[0]
            # The whole reference's centroid, carried along with the part that is there.
            drift = here - R @ before
            x[k] = product(np.ascontiguousarray(R.T), x[k] - drift[:, None]) + drift[:, None]
            rotations.matrices[k], rotations.is_determined[k] = R, found.is_determined[0]
        x[k] -= shape.rest
        x[k][:, ~kept] = 0.0
    return x, rotations


def no_rotations(n: int) -> Rotations:
    """Rotations of frames that are not turned."""
    return Rotations(np.tile(np.eye(3), (n, 1, 1)), np.ones(n, dtype=np.bool_))


def _is_still(
    taken: NDArray[np.float32] | NDArray[np.float64],
    start: NDArray[np.float32] | NDArray[np.float64],
    there: NDArray[np.bool_] | None,
) -> NDArray[np.bool_]:
    """Which frames repeat the reference bit for bit."""
    if there is not None:
        return np.array(
            [np.array_equal(x[kept], start[kept]) for x, kept in zip(taken, there, strict=True)]
        )
    # A few vertices tell nearly all frames that do not.
    probe = slice(None, None, max(1, len(start) // 16))
    likely: NDArray[np.bool_] = (taken[:, probe] == start[probe]).all(axis=(1, 2))
    likely[likely] = [np.array_equal(x, start) for x in taken[likely]]
    return likely
