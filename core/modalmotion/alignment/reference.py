"""Displacements from one frame, or from the mean shape."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from modalmotion.alignment.displacements import Displacements
from modalmotion.alignment.mean_shape import mean_onto, mean_shape
from modalmotion.alignment.reference_shape import ReferenceShape
from modalmotion.errors import ParameterError, ShapeError
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
    present: NDArray[np.bool_] | None = None,
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
    present : (frames, vertices) bool, optional
        True for positions present; the others are not read. The reference must be complete.

    Raises
    ------
    ShapeError
        If `present` has another shape.
    ParameterError
        If the reference is incomplete.
    """
    _require_present(sequence, reference, present)
    start = reference_positions(sequence, reference)
    shape = ReferenceShape.at(sequence, weights, start, isolated)
    return Displacements(sequence, start, shape, remove_rotation, present)


def _require_present(
    sequence: MeshSequence, reference: Reference, present: NDArray[np.bool_] | None
) -> None:
    if present is None:
        return
    shape = (sequence.n_frames, sequence.n_vertices)
    if present.shape != shape or present.dtype != np.bool_:
        raise ShapeError(
            f"'present' has the shape {present.shape} and holds {present.dtype}; "
            f"{shape} truth values are needed.",
            remedy="Give one truth value for each vertex of each frame.",
        )
    if reference == MEAN:
        if not present.all():
            raise ParameterError(
                "Vertices are missing, so there is no mean shape to measure from.",
                remedy="Choose a reference frame with all vertices present.",
            )
        return
    if not present[reference].all():
        vertex = int(np.flatnonzero(~present[reference])[0])
        raise ParameterError(
            f"Vertex {vertex} is missing in the reference, frame {reference}, so nothing can be "
            "measured from it.",
            remedy="Choose a reference frame with all vertices present.",
            frame=reference,
            vertex=vertex,
        )
