"""The reference of displacements: one frame, or the mean shape."""

from __future__ import annotations

from dataclasses import replace
from typing import Final
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from modalmotion.mesh.alignment import Displacements, ReferenceShape, kabsch
from modalmotion.mesh.sequence import MEAN, MeshSequence, Reference
from modalmotion.mesh.standard_surfaces import lattice_faces
from modalmotion.mesh.triangles import curve_weights, vertex_areas

# Each brings the means from two starts a hundred times nearer.
_N_ROUNDS: Final = 3

# Rotations whose sum is smaller than this share in one direction turn all the way round.
_UNDECIDED: Final = 1e-6


def mean_shape(sequence: MeshSequence) -> NDArray[np.float64]:
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
    mean: NDArray[np.float64] = sequence.vertices[0].astype(np.float64)
    for _ in range(_N_ROUNDS):
        shape = ReferenceShape.at(sequence, _shares(sequence, mean), mean)
        step = np.zeros_like(mean.T)
        for block in Displacements(sequence, mean, shape).blocks():
            step += block.u.sum(axis=0)
        if not step.any():
            break
        mean = mean + step.T * (shape.scale / sequence.n_frames)
    return _turned_to_the_middle(sequence, mean)


def mean_onto(sequence: MeshSequence, reference: int) -> NDArray[np.float64]:
    """Mean of all frames, each turned and moved onto one of them, (vertices, 3) float64.

    Vertices without a share of the surface stay where they are.
    """
    start: NDArray[np.float64] = sequence.vertices[reference].astype(np.float64)
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
    """Leave out a last frame that repeats the first."""
    if not _ends_as_it_began(sequence):
        return sequence
    times = None if sequence.times is None else sequence.times[:-1]
    return replace(sequence, vertices=sequence.vertices[:-1], times=times)


def _turned_to_the_middle(sequence: MeshSequence, mean: NDArray[np.float64]) -> NDArray[np.float64]:
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
    turned: NDArray[np.float64] = (mean - shape.centre) @ middle.matrices[0].T
    return turned + shape.centre


def _ends_as_it_began(sequence: MeshSequence) -> bool:
    """Whether the last frame repeats the first, and not because nothing moves then."""
    x = sequence.vertices
    return (
        sequence.n_frames > 3
        and np.array_equal(x[0], x[-1])
        and not np.array_equal(x[0], x[1])
        and not np.array_equal(x[-2], x[-1])
    )


def _shares(sequence: MeshSequence, positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Share of each vertex in the surface, or in the curve; equal shares without either."""
    topology, faces, grid = sequence.topology, sequence.faces, sequence.grid
    sizes = np.ones(len(positions))
    # Near size 1 no square is lost, in any unit.
    used = np.full(len(positions), not len(faces))
    used[faces.ravel()] = True
    extent = float(np.ptp(positions[used], axis=0).max(initial=0.0))
    scaled = (positions - positions[np.argmax(used)]) / extent if extent > 0 else positions
    if topology is not None and topology.n_axes == 1:
        sizes = curve_weights(scaled, topology)
    elif not len(faces) and grid is not None and topology is not None and topology.n_axes == 2:
        faces = lattice_faces(topology, grid) if min(grid) > 1 else faces
    if len(faces):
        sizes = vertex_areas(scaled, faces)
    total = float(sizes.sum())
    if not total > 0:
        return np.full(len(sizes), 1.0 / len(sizes))
    shares: NDArray[np.float64] = sizes / total
    return shares


# A mean takes up to three passes over all frames, and several steps ask for it.
_MEANS: WeakKeyDictionary[MeshSequence, dict[Reference, NDArray[np.float64]]] = WeakKeyDictionary()


def reference_positions(sequence: MeshSequence, reference: Reference) -> NDArray[np.float64]:
    """Give the positions that displacements are measured from.

    Parameters
    ----------
    sequence : MeshSequence
    reference : int or "mean"
        A frame, or the mean shape: see `modalmotion.mesh.reference`.

    Returns
    -------
    (vertices, 3) float64, in the sequence's unit
    """
    if reference != MEAN:
        positions: NDArray[np.float64] = sequence.vertices[reference].astype(np.float64)
        return positions
    return middle_positions(sequence, reference)


def middle_positions(sequence: MeshSequence, reference: Reference) -> NDArray[np.float64]:
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
