"""Displacements from one frame, or from the mean shape."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from modalmotion.alignment.displacements import Displacements
from modalmotion.alignment.mean_shape import mean_onto, mean_shape
from modalmotion.alignment.reference_shape import ReferenceShape
from modalmotion.mesh.sequence import MEAN, MeshSequence, Reference

# A mean takes up to three passes over all frames, and several steps ask for it.
_MEANS: WeakKeyDictionary[MeshSequence, dict[Reference, NDArray[np.float64]]] = WeakKeyDictionary()


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
    return middle_positions(sequence, reference)


def middle_positions(sequence: MeshSequence, reference: Reference) -> NDArray[np.float64]:
    """Mean of all frames where the reference lies: each turned and moved onto it.

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
    weights: NDArray[np.float64],
    isolated: NDArray[np.int64] | None = None,
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
