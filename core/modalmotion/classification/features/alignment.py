"""Pose and start of a motion, by turning it onto a typical one."""

from __future__ import annotations

from functools import lru_cache
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
    n_terms, _, n_directions = onto.shape
    if not is_cycle:
        if n_directions == 1:
            return motions
        flat = motions.real.reshape(len(motions), -1, n_directions)
        R = _rotations(onto.real.reshape(-1, n_directions).T @ flat)
        return np.asarray(motions @ np.swapaxes(R, 1, 2)[:, None])
    # B_h = onto_h^H motion_h, so each start costs one sum of 3 x 3 matrices.
    B = np.swapaxes(onto.conj(), 1, 2) @ motions
    start = _first_start(B)
    for offsets, phases in _finer(n_terms):
        start = start + offsets[_best(_from(B, start), phases)]
    begun = _from(motions, start)
    if n_directions == 1:
        return begun
    R = _rotations(np.add.reduce(_from(B, start), axis=1).real)
    return np.asarray(begun @ np.swapaxes(R, 1, 2)[:, None])


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


def _from(motions: Coefficients, starts: NDArray[np.float64]) -> Coefficients:
    """Motions (motions, terms, ...) that start later, each by its own phase."""
    terms = np.arange(1, motions.shape[1] + 1)
    phases = np.exp(1j * terms * starts[:, None])
    begun: Coefficients = motions * phases[:, :, None, None]
    return begun


@lru_cache(maxsize=16)
def _starts(n_terms: int) -> Coefficients:
    """Phases of all starts that are tried, (starts, terms)."""
    starts = np.arange(_N_STARTS) * (2 * np.pi / _N_STARTS)
    return np.asarray(np.exp(1j * starts[:, None] * np.arange(1, n_terms + 1)))


@lru_cache(maxsize=16)
def _finer(n_terms: int) -> tuple[tuple[NDArray[np.float64], Coefficients], ...]:
    """Give starts around the best one, and their phases, finer and finer."""
    step, found = 2 * np.pi / _N_STARTS, []
    for _ in range(_N_REFINEMENTS):
        offsets = np.linspace(-step, step, _N_FINER)
        found.append((offsets, np.exp(1j * offsets[:, None] * np.arange(1, n_terms + 1))))
        step *= 2.0 / (_N_FINER - 1)
    return tuple(found)


def _sums(B: Coefficients, phases: Coefficients) -> NDArray[np.float64]:
    """Overlaps before a rotation, (motions, starts, n * n)."""
    n, n_terms = B.shape[:2]
    return np.asarray((phases @ B.reshape(n, n_terms, -1)).real)


def _first_start(B: Coefficients) -> NDArray[np.float64]:
    """Give the start of each motion, among some, that overlaps most."""
    flat = _sums(B, _starts(B.shape[1]))
    if flat.shape[2] == 1:
        best = flat[:, :, 0].argmax(axis=1)
    else:
        best = _overlaps(flat.reshape(len(B), -1, 3, 3)).argmax(axis=1)
    return np.asarray(best * (2 * np.pi / _N_STARTS))


def _best(B: Coefficients, phases: Coefficients) -> NDArray[np.int64]:
    """Which start of each motion overlaps most after the best rotation, (motions,)."""
    flat = _sums(B, phases)
    if flat.shape[2] == 1:
        return np.asarray(flat[:, :, 0].argmax(axis=1))
    C = flat.reshape(len(B), -1, 3, 3)
    # Largest trace of R C' over rotations: s1 + s2 + sign(det) s3.
    s = np.linalg.svd(C, compute_uv=False)
    overlaps = s[..., 0] + s[..., 1] + np.where(np.linalg.det(C) < 0, -1.0, 1.0) * s[..., 2]
    return np.asarray(overlaps.argmax(axis=1))


def _rotations(C: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotations R with the largest trace of R C', (motions, 3, 3)."""
    U, _, Vt = np.linalg.svd(C)
    R: NDArray[np.float64] = U @ Vt
    mirrors = np.linalg.det(R) < 0
    if mirrors.any():
        U[mirrors, :, 2] *= -1.0
        R = U @ Vt
    return R


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
