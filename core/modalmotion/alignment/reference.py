"""The positions that displacements are measured from: of one frame, or of the mean shape."""

from __future__ import annotations

from collections.abc import Iterator
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from modalmotion.alignment.displacements import aligned, position_blocks
from modalmotion.alignment.mean_shape import mean_shape
from modalmotion.alignment.reference_shape import ReferenceShape
from modalmotion.alignment.rigid import Rotations
from modalmotion.mesh.sequence import MEAN, MeshSequence, Reference

# A mean takes three passes over all frames, and several steps ask for it.
_MEANS: WeakKeyDictionary[MeshSequence, NDArray[np.float64]] = WeakKeyDictionary()


def reference_positions(sequence: MeshSequence, reference: Reference) -> NDArray[np.float64]:
    """Give the positions that displacements are measured from.

    Parameters
    ----------
    sequence : MeshSequence
    reference : int or "mean"
        A frame, or the mean shape: see `modalmotion.alignment.mean_shape`.

    Returns
    -------
    (vertices, 3) float64, in the sequence's unit
    """
    if reference != MEAN:
        positions: NDArray[np.float64] = sequence.vertices[reference].astype(np.float64)
        return positions
    if sequence not in _MEANS:
        _MEANS[sequence] = mean_shape(sequence)
    return _MEANS[sequence]


def displacement_blocks(
    sequence: MeshSequence,
    weights: NDArray[np.float64],
    *,
    reference: Reference,
    remove_rotation: bool,
) -> Iterator[tuple[NDArray[np.float64], Rotations, float]]:
    """Displacements from the reference, rotation removed, a block of frames at a time.

    Yields
    ------
    displacements : (frames, vertices, 3) float64
        In units of `scale`.
    rotations : Rotations
    scale : float, length unit
        A power of two near the size of the surface where its size is extreme, else 1.
    """
    start = reference_positions(sequence, reference)
    shape = ReferenceShape.at(sequence, weights, start)
    for block in position_blocks(sequence, shape, start):
        u, rotations = aligned(block, shape, remove_rotation)
        yield u.transpose(0, 2, 1), rotations, shape.scale
