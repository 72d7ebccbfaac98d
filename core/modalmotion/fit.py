"""Weighted least-squares fit of modal amplitudes to displacements.

By QR of the weighted shapes, never by normal equations, whose condition is the square.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from modalmotion.errors import ModeCountError
from modalmotion.modes import ModeSet, shapes_at
from modalmotion.rigid import Rotations, kabsch
from modalmotion.sequence import MeshSequence
from modalmotion.template import Template

# Amplitudes lose this factor of the data's precision; beyond it they are not worth giving.
LARGEST_CONDITION = 1e8

# Floats of displacements held at once.
_BLOCK = 2_000_000


@dataclass(frozen=True, eq=False)
class Basis:
    """Mode shapes on a template, factored once for any number of frames.

    Parameters
    ----------
    modes : ModeSet
    shapes : (vertices, modes) float64
    projector : (modes, vertices) float64
        amplitudes = projector @ displacements: the weighted least-squares solution.
    condition : float
        Of the weighted shapes, 1 for orthogonal ones.
    """

    modes: ModeSet
    shapes: NDArray[np.float64]
    projector: NDArray[np.float64]
    condition: float


def make_basis(template: Template, modes: ModeSet) -> Basis:
    """Evaluate and factor modes on a template.

    Raises
    ------
    ModeCountError
        If the weighted vertices cannot tell that many modes apart.
    """
    shapes = shapes_at(modes, template.coordinates)
    n_weighted = int((template.weights > 0).sum())
    if len(modes) > n_weighted:
        raise ModeCountError(
            f"{len(modes)} modes cannot be told apart on {n_weighted} vertices.",
            remedy=f"Ask for at most {n_weighted} modes.",
            details={"modes": len(modes), "most": n_weighted},
        )
    root = np.sqrt(template.weights)[:, None]
    Q, R = np.linalg.qr(root * shapes)
    condition = float(np.linalg.cond(R))
    if not condition <= LARGEST_CONDITION:
        raise ModeCountError(
            f"{len(modes)} modes have the condition {condition:.1e} on this surface, above "
            f"{LARGEST_CONDITION:.0e}: the amplitudes would be noise.",
            remedy="Ask for fewer modes, or send a finer mesh.",
            details={"modes": len(modes), "condition": condition},
        )
    projector = solve_triangular(R, (root * Q).T)
    return Basis(modes, shapes, projector, condition)


@dataclass(frozen=True, eq=False)
class Fit:
    """Amplitudes of every frame, and what they leave.

    Parameters
    ----------
    amplitudes : (frames, modes, 3) float64, length unit
    rotations : Rotations
        Removed before the fit, about the centroid of each frame.
    rms_errors, p95_errors, max_errors : (frames,) float64, length unit
        Of the distances between vertices and their reconstruction; RMS and 95th percentile
        are over the surface (by weight), the maximum over all vertices.
    motion_rms : (frames,) float64, length unit
        RMS displacement from the reference, rotation removed: the error of no modes at all.
    """

    amplitudes: NDArray[np.float64]
    rotations: Rotations
    rms_errors: NDArray[np.float64]
    p95_errors: NDArray[np.float64]
    max_errors: NDArray[np.float64]
    motion_rms: NDArray[np.float64]


def fit_sequence(
    sequence: MeshSequence,
    template: Template,
    basis: Basis,
    *,
    reference: int = 0,
    remove_rotation: bool = True,
) -> Fit:
    """Fit every frame, in blocks of bounded memory.

    Parameters
    ----------
    sequence : MeshSequence
    template : Template
    basis : Basis
    reference : int
        Frame from which displacements are measured.
    remove_rotation : bool
        Whether to take out each frame's best rotation about its centroid first.

    Returns
    -------
    Fit
    """
    w = template.weights
    parts: list[tuple[NDArray[Any], ...]] = []
    for displacements, rotations, scale in displacement_blocks(
        sequence, w, reference=reference, remove_rotation=remove_rotation
    ):
        a = basis.projector @ displacements
        residual = displacements - basis.shapes @ a
        squares = (residual**2).sum(axis=2)
        p95 = np.sqrt(_weighted_quantile(squares, w, 0.95))
        parts.append(
            (
                a * scale,
                rotations.matrices,
                rotations.is_determined,
                np.sqrt(squares @ w) * scale,
                p95 * scale,
                np.sqrt(squares.max(axis=1)) * scale,
                np.sqrt((displacements**2).sum(axis=2) @ w) * scale,
            )
        )
    a, matrices, determined, rms, p95, largest, motion = (
        np.concatenate(column) for column in zip(*parts, strict=True)
    )
    return Fit(a, Rotations(matrices, determined), rms, p95, largest, motion)


def displacement_blocks(
    sequence: MeshSequence,
    weights: NDArray[np.float64],
    *,
    reference: int,
    remove_rotation: bool,
) -> Iterator[tuple[NDArray[np.float64], Rotations, float]]:
    """Displacements from the reference, rotation removed, a block of frames at a time.

    Yields
    ------
    displacements : (frames, vertices, 3) float64
        In units of `scale`.
    rotations : Rotations
    scale : float, length unit
        A power of two near the size of the surface, so that squares neither overflow nor
        vanish whatever the unit.
    """
    start = sequence.vertices[reference].astype(np.float64)
    centre = weights @ start
    rest = start - centre
    scale = _power_of_two(sequence, centre)
    rest /= scale
    n = max(1, _BLOCK // (3 * sequence.n_vertices))
    for first in range(0, sequence.n_frames, n):
        block = sequence.vertices[first : first + n].astype(np.float64)
        still = (block == start).all(axis=(1, 2))
        block -= centre
        block /= scale
        drift = np.matmul(weights, block)[:, None, :]
        if remove_rotation:
            block -= drift
            # sum w (x - centroid) (x_ref - centroid_ref)', one 3 x 3 matrix a frame
            rotations = kabsch(np.matmul(block.transpose(0, 2, 1), rest * weights[:, None]))
            matrices = rotations.matrices
            matrices[still] = np.eye(3)
            block = np.matmul(block, matrices)
            block += drift
        else:
            identity = np.broadcast_to(np.eye(3), (len(block), 3, 3))
            rotations = Rotations(identity, np.ones(len(block), dtype=np.bool_))
        block -= rest
        # A frame that repeats the reference has moved by exactly nothing.
        block[still] = 0.0
        yield block, rotations, scale


def _weighted_quantile(
    values: NDArray[np.float64], weights: NDArray[np.float64], q: float
) -> NDArray[np.float64]:
    """Smallest value in each row below or at which a share `q` of the weight lies."""
    order = np.argsort(values, axis=1)
    reached = np.cumsum(weights[order], axis=1)
    index = (reached < q * reached[:, -1:]).sum(axis=1)
    ranked = np.take_along_axis(values, order, axis=1)
    result: NDArray[np.float64] = ranked[np.arange(len(values)), index]
    return result


def _power_of_two(sequence: MeshSequence, centre: NDArray[np.float64]) -> float:
    low = sequence.vertices.min(axis=(0, 1)) - centre
    high = sequence.vertices.max(axis=(0, 1)) - centre
    largest = float(max(np.abs(low).max(), np.abs(high).max()))
    return 1.0 if largest == 0.0 else float(2.0 ** np.clip(np.frexp(largest)[1], -1000, 1000))
