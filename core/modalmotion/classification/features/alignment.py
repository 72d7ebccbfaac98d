"""Pose and start of a motion, by turning it onto a typical one."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

# Starts that are tried, and how often the best is refined among as many around it.
_N_STARTS: Final = 48
_N_FINER: Final = 9
_N_REFINEMENTS: Final = 3

# Times that the mean is formed anew from the motions turned onto it.
_N_ROUNDS: Final = 8

Coefficients = NDArray[np.complex128]


def align(motion: Coefficients, onto: Coefficients, *, is_cycle: bool) -> Coefficients:
    """Turn a motion, and start it, so that it is nearest to another: see `align_all`."""
    turned: Coefficients = align_all(motion[None], onto, is_cycle=is_cycle)[0]
    return turned


def align_all(motions: Coefficients, onto: Coefficients, *, is_cycle: bool) -> Coefficients:
    """Turn motions, and start them, so that each is nearest to another one.

    Parameters
    ----------
    motions : (motions, terms, modes, n) complex128
        Harmonics of a cycle; of a course cosine terms, which are real.
    onto : (terms, modes, n) complex128
    is_cycle : bool
        Whether the start is free, too.

    Returns
    -------
    (motions, terms, modes, n) complex128

    Notes
    -----
    Kabsch, A solution for the best rotation to relate two sets of vectors, Acta Cryst A, 1976;
    a reflection is never used. A start t later multiplies harmonic h by exp(i h t). Offsets have
    one direction, outward, and are not turned.
    """
    n = len(motions)
    terms = np.arange(1, motions.shape[1] + 1)
    starts: NDArray[np.float64] = np.zeros((n, 1))
    if is_cycle:
        step = 2 * np.pi / _N_STARTS
        starts = np.tile(np.arange(_N_STARTS) * step, (n, 1))
    # B_h = onto_h^H motion_h, so each start costs one sum of 3 x 3 matrices.
    B = np.swapaxes(onto.conj(), 1, 2) @ motions
    start, R = _best(B, starts, terms)
    if is_cycle:
        for _ in range(_N_REFINEMENTS):
            finer = start[:, None] + np.linspace(-step, step, _N_FINER)
            start, R = _best(B, finer, terms)
            step *= 2.0 / (_N_FINER - 1)
    phases = np.exp(1j * terms * start[:, None])
    turned: Coefficients = (motions * phases[:, :, None, None]) @ np.swapaxes(R, 1, 2)[:, None]
    return turned


def mean_motion(motions: list[Coefficients], *, is_cycle: bool) -> Coefficients:
    """Typical motion of a cohort: the mean of all, each turned onto it (generalised Procrustes).

    Parameters
    ----------
    motions : list of (terms, modes, 3) complex128
        At least one. Each counts the same, however far it moves.
    is_cycle : bool

    Returns
    -------
    (terms, modes, 3) complex128
        Gower, Generalized Procrustes analysis, Psychometrika, 1975.
    """
    sizes = np.array([np.linalg.norm(m) for m in motions])
    units = np.stack(motions) / np.where(sizes > 0, sizes, 1.0)[:, None, None, None]
    mean: Coefficients = units[int(np.argsort(sizes, kind="stable")[len(sizes) // 2])]
    for _ in range(_N_ROUNDS):
        mean = align_all(units, mean, is_cycle=is_cycle).mean(axis=0)
    return mean


def _best(
    B: Coefficients, starts: NDArray[np.float64], terms: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Start of each motion, among its own, and rotation that give the largest overlap.

    Parameters
    ----------
    B : (motions, terms, n, n) complex128
    starts : (motions, starts) float64
    terms : (terms,) int64

    Returns
    -------
    (motions,) float64, (motions, n, n) float64
    """
    phases = np.exp(1j * starts[:, :, None] * terms)
    n, n_terms, n_directions, _ = B.shape
    flat = (phases @ B.reshape(n, n_terms, -1)).real
    if n_directions == 1:
        best = flat[:, :, 0].argmax(axis=1)
        return starts[np.arange(n), best], np.ones((n, 1, 1))
    C = flat.reshape(n, -1, 3, 3)
    each = np.arange(n)
    if C.shape[1] > _N_FINER:
        # One start of many, to be refined: the rotation of that one alone is needed.
        best = _overlaps(C).argmax(axis=1)
        starts, C = starts[each, best][:, None], C[each, best][:, None]
    # Largest trace of R C' over rotations: s1 + s2 + sign(det) s3.
    U, s, Vt = np.linalg.svd(C)
    sign = np.sign(np.linalg.det(U) * np.linalg.det(Vt))
    sign[sign == 0] = 1.0
    best = (s[..., 0] + s[..., 1] + sign * s[..., 2]).argmax(axis=1)
    U_best = U[each, best]
    U_best[:, :, 2] *= sign[each, best, None]
    R: NDArray[np.float64] = U_best @ Vt[each, best]
    return starts[each, best], R


def _overlaps(C: NDArray[np.float64]) -> NDArray[np.float64]:
    """Largest trace of R C' over rotations R, of matrices (..., 3, 3).

    It is s1 + s2 + sign(det C) s3. The squares of the singular values are the roots of a cubic,
    known in closed form (Smith, Eigenvalues of a symmetric 3 x 3 matrix, Commun ACM, 1961), which
    is far quicker than a decomposition. Near a matrix of one direction it holds to a thousandth.
    """
    S = np.swapaxes(C, -1, -2) @ C
    mean = np.trace(S, axis1=-2, axis2=-1) / 3.0
    deviator = S - mean[..., None, None] * np.eye(3)
    spread = np.sqrt((deviator**2).sum(axis=(-2, -1)) / 6.0)
    safe = np.where(spread > 0, spread, 1.0)
    half = np.clip(np.linalg.det(deviator / safe[..., None, None]) / 2.0, -1.0, 1.0)
    angle = np.arccos(half)[..., None] / 3.0 + 2.0 * np.pi / 3.0 * np.arange(3)
    squares = np.maximum(mean[..., None] + 2.0 * spread[..., None] * np.cos(angle), 0.0)
    s = np.sqrt(squares)
    # The least is the second of the three angles.
    least = np.where(np.linalg.det(C) < 0, 2.0, 0.0) * s[..., 1]
    overlaps: NDArray[np.float64] = s.sum(axis=-1) - least
    return overlaps
