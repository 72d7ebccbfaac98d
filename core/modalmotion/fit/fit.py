"""Weighted least-squares fit of modal amplitudes to displacements.

Modal superposition (2) u = Phi a of Nastar (1994), inverted: a = argmin |u - Phi a|_W. By
QR of the weighted shapes, never by normal equations, whose condition is the square.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modalmotion.alignment.displacements import PositionBlock, aligned, position_blocks
from modalmotion.alignment.reference import displacement_blocks, reference_positions
from modalmotion.alignment.reference_shape import ReferenceShape
from modalmotion.alignment.rigid import Rotations
from modalmotion.errors import ModeCountError, ParameterError, ShapeError
from modalmotion.fit.basis import LARGEST_CONDITION, Basis, factored, make_basis
from modalmotion.fit.block_fit import BlockFit, PositionFit, fit_displacements
from modalmotion.mesh.sequence import MEAN, MeshSequence, Reference
from modalmotion.numeric.products import product
from modalmotion.representation import shown
from modalmotion.template import Template
from modalmotion.template.body_frame import Components, local_frames, to_local

__all__ = [
    "LARGEST_CONDITION",
    "Basis",
    "Fit",
    "displacement_blocks",
    "fit_sequence",
    "make_basis",
    "project",
]


@shown()
@dataclass(frozen=True, eq=False)
class Fit:
    """Amplitudes of every frame, and what they leave.

    Parameters
    ----------
    amplitudes : (frames, modes, 3) float64, length unit
        Of x, y, z, or of the radial, tangential and axial displacement.
    rotations : Rotations
        Removed before the fit, about the centroid of each frame.
    translations : (frames, 3) float64, length unit
        Path of the weighted centroid from the reference's.
    rms_errors, p95_errors, max_errors : (frames,) float64, length unit
        Of the distances between vertices and their reconstruction; RMS and 95th percentile
        are over the surface (by weight), the maximum over all vertices of it.
    motion_rms : (frames,) float64, length unit
        RMS displacement from the reference, rotation removed: the error of no modes at all.
    conditions : (frames,) float64
        Of the weighted shapes; all the same unless vertices are missing.
    coverages : (frames,) float64
        Share of the surface that is there, 1 unless vertices are missing.
    """

    amplitudes: NDArray[np.float64]
    rotations: Rotations
    translations: NDArray[np.float64]
    rms_errors: NDArray[np.float64]
    p95_errors: NDArray[np.float64]
    max_errors: NDArray[np.float64]
    motion_rms: NDArray[np.float64]
    conditions: NDArray[np.float64]
    coverages: NDArray[np.float64]


def fit_sequence(
    sequence: MeshSequence,
    template: Template,
    basis: Basis,
    *,
    reference: Reference = 0,
    remove_rotation: bool = True,
    components: Components = Components.CARTESIAN,
    present: NDArray[np.bool_] | None = None,
) -> Fit:
    """Fit every frame, in blocks of bounded memory.

    Parameters
    ----------
    sequence : MeshSequence
    template : Template
    basis : Basis
    reference : int or "mean"
        Frame from which displacements are measured, or the mean shape.
    remove_rotation : bool
        Whether to take out each frame's best rotation about its centroid first.
    components : Components
        What the three amplitudes of a mode stand for.
    present : (frames, vertices) bool, optional
        Which positions are there. A frame is fitted to what it has; positions that are not
        there are not read. The reference must be complete.

    Returns
    -------
    Fit

    Raises
    ------
    ShapeError
        If `present` has another shape.
    ParameterError
        If the reference is incomplete, a frame is empty, or the surface has no axis to split
        components by.
    ModeCountError
        Naming the first frame in which too little is there to tell the modes apart.
    """
    _require_present(sequence, reference, present)
    frames = None if components == Components.CARTESIAN else local_frames(template)
    start = reference_positions(sequence, reference)
    shape = ReferenceShape.at(sequence, template.weights, start, template.isolated)
    in_one = PositionFit.of(basis, shape)
    fit = _empty(sequence.n_frames, len(basis.modes), basis.condition)
    for block in position_blocks(sequence, shape, start, present):
        if frames is None and block.present is None:
            _store(fit, block.first, in_one.fit(block, remove_rotation), shape.scale)
            continue
        u, rotations = aligned(block, shape, remove_rotation)
        drifts = _drifts(u, block, shape.weights)
        if frames is not None:
            u = to_local(u, frames)
        if block.present is None:
            part = fit_displacements(u, rotations, drifts, basis, shape.weights, shape.ignored)
            _store(fit, block.first, part, shape.scale)
        else:
            _fit_partly(fit, block, u, rotations, drifts, basis, shape)
    return fit


def project(basis: Basis, displacements: NDArray[np.float64]) -> NDArray[np.float64]:
    """Amplitudes of displacements: their weighted least-squares fit.

    Parameters
    ----------
    basis : Basis
    displacements : (frames, vertices, 3) float64, length unit
        Fastest as a view on memory that runs along the vertices, as `displacement_blocks`
        gives them.

    Returns
    -------
    (frames, modes, 3) float64, length unit
    """
    rows = np.ascontiguousarray(displacements.transpose(0, 2, 1))
    f, _, n = rows.shape
    a = product(rows.reshape(3 * f, n), basis.columns)[:, : len(basis.modes)]
    return a.reshape(f, 3, -1).transpose(0, 2, 1)


def _drifts(
    u: NDArray[np.float64], block: PositionBlock, weights: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Mean displacement of each frame, over what it has: turning about the centroid adds none."""
    # einsum adds in one order whatever the number of threads.
    if block.present is None:
        whole: NDArray[np.float64] = np.einsum("fcn,n->fc", u, weights)
        return whole
    shares = np.where(block.present, weights, 0.0)
    shares /= shares.sum(axis=1)[:, None]
    part: NDArray[np.float64] = np.einsum("fcn,fn->fc", u, shares)
    return part


def _fit_partly(
    fit: Fit,
    block: PositionBlock,
    u: NDArray[np.float64],
    rotations: Rotations,
    drifts: NDArray[np.float64],
    basis: Basis,
    shape: ReferenceShape,
) -> None:
    """Fit each frame of a block to the vertices it has."""
    if block.present is None:
        return
    for k, kept in enumerate(block.present):
        frame = block.first + k
        share = np.where(kept, shape.weights, 0.0)
        coverage = float(share.sum())
        try:
            part = basis if kept.all() else factored(basis.modes, basis.shapes, share / coverage)
        except ModeCountError as error:
            raise ModeCountError(
                f"Frame {frame}: {error.message}",
                remedy="Ask for fewer modes, or leave the frame out.",
                frame=frame,
                details=error.details,
            ) from error
        ignored = np.union1d(np.flatnonzero(~kept), shape.ignored)
        turned = Rotations(rotations.matrices[k : k + 1], rotations.is_determined[k : k + 1])
        here = slice(k, k + 1)
        found = fit_displacements(u[here], turned, drifts[here], part, share / coverage, ignored)
        _store(fit, frame, found, shape.scale)
        fit.conditions[frame], fit.coverages[frame] = part.condition, coverage


def _empty(n_frames: int, n_modes: int, condition: float) -> Fit:
    return Fit(
        amplitudes=np.empty((n_frames, n_modes, 3)),
        rotations=Rotations(np.empty((n_frames, 3, 3)), np.empty(n_frames, dtype=np.bool_)),
        translations=np.empty((n_frames, 3)),
        rms_errors=np.empty(n_frames),
        p95_errors=np.empty(n_frames),
        max_errors=np.empty(n_frames),
        motion_rms=np.empty(n_frames),
        conditions=np.full(n_frames, condition),
        coverages=np.ones(n_frames),
    )


def _store(fit: Fit, first: int, part: BlockFit, scale: float) -> None:
    at = slice(first, first + len(part.amplitudes))
    fit.amplitudes[at] = part.amplitudes.transpose(0, 2, 1) * scale
    fit.rotations.matrices[at] = part.rotations.matrices
    fit.rotations.is_determined[at] = part.rotations.is_determined
    fit.translations[at] = part.drifts * scale
    fit.rms_errors[at] = np.sqrt(part.mean_squares) * scale
    fit.p95_errors[at] = np.sqrt(part.p95_squares) * scale
    fit.max_errors[at] = np.sqrt(part.max_squares) * scale
    fit.motion_rms[at] = np.sqrt(part.motion_squares) * scale


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
                remedy="Choose a reference frame in which all vertices are there.",
            )
        return
    if not present[reference].all():
        vertex = int(np.flatnonzero(~present[reference])[0])
        raise ParameterError(
            f"Vertex {vertex} is missing in the reference, frame {reference}, so nothing can be "
            "measured from it.",
            remedy="Choose a reference frame in which all vertices are there.",
            frame=reference,
            vertex=vertex,
        )
