"""Mode shapes on a template, factored once for any number of frames."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ModeCountError
from modalmotion.mesh.spring_modes import SpringModes, SpringSpectrum, spring_modes
from modalmotion.modes import ModeSet, shapes_at
from modalmotion.numeric.products import product
from modalmotion.template import Template

# Amplitudes lose this factor of the data's precision; beyond it they are not worth giving.
LARGEST_CONDITION: Final = 1e8

# Rows factored at once. Small enough for one thread, so that the bits are always the same.
_ROWS: Final = 1024

# Rows of a triangle that are eliminated one by one.
_TRIANGLE: Final = 64


@dataclass(frozen=True, eq=False)
class Basis:
    """Mode shapes on a template, factored once for any number of frames.

    Parameters
    ----------
    modes : ModeSet or SpringModes
    shapes : (vertices, modes) float64
    projector : (modes, vertices) float64
        amplitudes = projector @ displacements: the weighted least-squares solution.
    triangle : (modes, modes) float64
        R of the weighted shapes: |R a| is the RMS of the superposed displacement.
    condition : float
        Of the weighted shapes, 1 for orthogonal ones.
    """

    modes: ModeSet | SpringModes
    shapes: NDArray[np.float64]
    projector: NDArray[np.float64]
    triangle: NDArray[np.float64]
    condition: float

    @cached_property
    def rows(self) -> NDArray[np.float64]:
        """Shapes with vertices along the memory, (modes, vertices)."""
        return np.ascontiguousarray(self.shapes.T)

    @cached_property
    def columns(self) -> NDArray[np.float64]:
        """Projector with modes along the memory, filled with zeros to a multiple of eight."""
        m, n = self.projector.shape
        columns = np.zeros((n, -(-m // 8) * 8))
        columns[:, :m] = self.projector.T
        return columns


def make_basis(template: Template, modes: ModeSet | SpringModes) -> Basis:
    """Evaluate and factor modes on a template.

    Raises
    ------
    ModeCountError
        If the weighted vertices cannot tell that many modes apart.
    """
    if isinstance(modes, SpringModes):
        shapes = modes.shapes
    else:
        shapes = shapes_at(modes, template.coordinates)
    return factored(modes, shapes, template.weights)


def basis_of(modes: ModeSet | SpringSpectrum, template: Template) -> Basis:
    """Factor the modes that a signature names, on its template.

    Parameters
    ----------
    modes : ModeSet or SpringSpectrum
    template : Template
    """
    if isinstance(modes, SpringSpectrum):
        own = spring_modes(template.faces, template.n_vertices, len(modes))
        return make_basis(template, own)
    return make_basis(template, modes)


def factored(
    modes: ModeSet | SpringModes, shapes: NDArray[np.float64], weights: NDArray[np.float64]
) -> Basis:
    """Factor shapes under given weights.

    Raises
    ------
    ModeCountError
        If there are fewer weighted vertices than modes, or they cannot tell them apart.
    """
    n_weighted = int((weights > 0).sum())
    if len(modes) > n_weighted:
        raise ModeCountError(
            f"{len(modes)} modes cannot be told apart on {n_weighted} vertices.",
            remedy=f"Ask for at most {n_weighted} modes.",
            details={"modes": len(modes), "most": n_weighted},
        )
    root = np.sqrt(weights)[:, None]
    Q, R = tall_qr(root * shapes)
    condition = float(np.linalg.cond(R))
    if not condition <= LARGEST_CONDITION:
        raise ModeCountError(
            f"{len(modes)} modes have the condition {condition:.1e} on this surface, above "
            f"{LARGEST_CONDITION:.0e}: the amplitudes would be noise.",
            remedy="Ask for fewer modes, or send a finer mesh.",
            details={"modes": len(modes), "condition": condition},
        )
    projector = product(inverse_of_triangle(R), np.ascontiguousarray((root * Q).T))
    return Basis(modes, shapes, projector, R, condition)


def tall_qr(A: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """QR of a matrix with many more rows than columns, block by block.

    Each block of rows is factored by itself, then their triangles together (Demmel, Grigori,
    Hoemmen and Langou, Communication-optimal parallel and sequential QR and LU factorizations,
    SIAM Journal on Scientific Computing, 2012). As stable as one factorisation, faster for it
    stays in the cache, and its bits do not depend on the number of threads.

    Parameters
    ----------
    A : (rows, columns) float64

    Returns
    -------
    Q : (rows, columns) float64
    R : (columns, columns) float64
        Its diagonal is not negative.
    """
    n, m = A.shape
    step = max(_ROWS, 2 * m)
    starts = list(range(0, max(n - step, 0) + 1, step))
    ends = [*starts[1:], n]
    factors = [np.linalg.qr(A[i:j]) for i, j in zip(starts, ends, strict=True)]
    Q = np.empty((n, m))
    if len(factors) == 1:
        Q[...], R = factors[0]
    else:
        joint, R = tall_qr(np.concatenate([triangle for _, triangle in factors]))
        for k, (i, j) in enumerate(zip(starts, ends, strict=True)):
            product(factors[k][0], joint[k * m : (k + 1) * m], out=Q[i:j])
    sign = np.where(np.diag(R) < 0, -1.0, 1.0)
    return Q * sign, R * sign[:, None]


def inverse_of_triangle(R: NDArray[np.float64]) -> NDArray[np.float64]:
    """Invert an upper triangle by substitution, with the same bits on any number of threads.

    Parameters
    ----------
    R : (n, n) float64
        Upper triangular, without a zero on its diagonal.

    Returns
    -------
    (n, n) float64
    """
    n = len(R)
    inverse = np.zeros((n, n))
    for start in range((n - 1) // _TRIANGLE * _TRIANGLE, -1, -_TRIANGLE):
        rows = slice(start, start + _TRIANGLE)
        stop = min(start + _TRIANGLE, n)
        right = np.zeros((stop - start, n))
        right[:, start:stop] = np.eye(stop - start)
        right[:, stop:] -= product(R[rows, stop:], inverse[stop:, stop:])
        for i in range(stop - 1, start - 1, -1):
            known = product(R[i : i + 1, i + 1 : stop], inverse[i + 1 : stop])
            inverse[i] = (right[i - start] - known[0]) / R[i, i]
    return inverse
