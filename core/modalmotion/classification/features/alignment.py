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
    """Turn a motion, and start it, so that it is nearest to another.

    Parameters
    ----------
    motion, onto : (terms, modes, 3) complex128
        Harmonics of a cycle; of a course cosine terms, which are real.
    is_cycle : bool
        Whether the start is free, too.

    Returns
    -------
    (terms, modes, 3) complex128

    Notes
    -----
    Kabsch, A solution for the best rotation to relate two sets of vectors, Acta Cryst A, 1976;
    a reflection is never used. A start t later multiplies harmonic h by exp(i h t).
    """
    starts: NDArray[np.float64] = np.zeros(1)
    if is_cycle:
        step = 2 * np.pi / _N_STARTS
        starts = np.asarray(np.arange(_N_STARTS) * step)
    terms = np.arange(1, len(motion) + 1)
    # B_h = onto_h^H motion_h, so each start costs one sum of 3 x 3 matrices.
    B = np.einsum("hmi,hmj->hij", onto.conj(), motion)
    start, R = _best(B, starts, terms)
    if is_cycle:
        for _ in range(_N_REFINEMENTS):
            finer = start + np.linspace(-step, step, _N_FINER)
            start, R = _best(B, finer, terms)
            step *= 2.0 / (_N_FINER - 1)
    turned: Coefficients = (motion * np.exp(1j * terms * start)[:, None, None]) @ R.T
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
    units = [m / s if s > 0 else m for m, s in zip(motions, sizes, strict=True)]
    mean = units[int(np.argsort(sizes, kind="stable")[len(sizes) // 2])]
    for _ in range(_N_ROUNDS):
        mean = np.mean([align(unit, mean, is_cycle=is_cycle) for unit in units], axis=0)
    return mean


def _best(
    B: Coefficients, starts: NDArray[np.float64], terms: NDArray[np.int64]
) -> tuple[float, NDArray[np.float64]]:
    """Start, among `starts`, and rotation that give the largest overlap."""
    phases = np.exp(1j * starts[:, None] * terms)
    C = np.einsum("th,hij->tij", phases, B).real
    # Largest trace of R C' over rotations: s1 + s2 + sign(det) s3.
    U, s, Vt = np.linalg.svd(C)
    sign = np.sign(np.linalg.det(U) * np.linalg.det(Vt))
    sign[sign == 0] = 1.0
    overlap = s[:, 0] + s[:, 1] + sign * s[:, 2]
    best = int(overlap.argmax())
    U_best = U[best].copy()
    U_best[:, 2] *= sign[best]
    R: NDArray[np.float64] = U_best @ Vt[best]
    return float(starts[best]), R
