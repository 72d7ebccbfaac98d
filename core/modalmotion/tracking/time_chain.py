"""Time as one more chain: frames joined by springs, closed over a cycle or open.

Frames differ from the one that the shape is taken from by a motion whose harmonic h of the cycle is
as stiff as (1 + (h / h0)^2)^2 - 1, as of a bent rod that nothing holds in its place; what this one
itself is off the shape, as far as the modes show it, all frames have in common. On frames at any
times the chain has springs of unequal length, and h^2 becomes its stiffness matrix. All frames are
estimated together; the chain joins neighbours only, so the work grows as their number.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.numeric.cholesky import gram, inverse_of_cholesky
from modalmotion.numeric.products import product

# Harmonics that are tried.
_STIFFEST: Final = 0.25
_N_TRIED: Final = 24

# Frames from which on there is something to try, and the harmonic of fewer.
_FEW: Final = 4
_USUAL: Final = 2.0


def chain_precision(
    phases: NDArray[np.float64],
    h0: float,
    anchor: int,
    offset: float = 1.0,
    *,
    is_closed: bool,
) -> NDArray[np.float64]:
    """Precision of a chain of frames.

    Parameters
    ----------
    phases : (frames,) float64
        In cycles, increasing, from 0 to less than 1; of an open chain in lengths of it.
    h0 : float
        Harmonic from which on amplitudes are held down more.
    anchor : int
        Frame that the shape is of. By how much others differ from it has a mean variance of 1.
    offset : float
        Variance of this frame, which all others have in common.
    is_closed : bool

    Returns
    -------
    (frames, frames) float64
        Each frame joined to the two before and after it.
    """
    n = len(phases)
    if n == 1:
        return np.eye(1) / offset
    start = np.arange(n if is_closed and n > 2 else n - 1)
    end = (start + 1) % n
    gaps = np.diff(phases, append=phases[0] + 1.0)[: len(start)]
    share, L = np.zeros(n), np.zeros((n, n))
    np.add.at(share, start, gaps / 2)
    np.add.at(share, end, gaps / 2)
    # L of springs 1 / gap between masses M of a frame's share of time.
    np.add.at(L, (start, start), 1.0 / gaps)
    np.add.at(L, (end, end), 1.0 / gaps)
    np.add.at(L, (start, end), -1.0 / gaps)
    np.add.at(L, (end, start), -1.0 / gaps)
    L /= (2.0 * np.pi * h0) ** 2
    # (M + L) M^-1 (M + L) - M.
    Q = 2.0 * L + product(L / share, L)
    Q = (Q + Q.T) / 2
    others = np.delete(np.arange(n), anchor)
    inverse = inverse_of_cholesky(Q[np.ix_(others, others)])
    Q *= float((inverse**2).sum()) / (n - 1)
    Q[anchor, anchor] += 1.0 / offset
    return Q


def most_likely_h0(
    trajectories: NDArray[np.float64],
    shares: NDArray[np.float64],
    phases: NDArray[np.float64],
    anchor: int,
    *,
    is_closed: bool,
) -> tuple[float, float]:
    """Harmonic h0, and variance of trajectories, under which these are the most likely.

    Parameters
    ----------
    trajectories : (frames, n) float64
        Amplitudes over the standard deviations that the prior gives them.
    shares : (n,) float64
        How far the data have set each.
    phases : (frames,) float64
    anchor : int
        Row of the frame that the shape is of.

    Returns
    -------
    h0 : float
    variance : float
        By which the others differ from it, instead of 1.
    """
    n = len(phases)
    free = np.delete(np.arange(n), anchor)
    x, total = trajectories[free] - trajectories[anchor], float(shares.sum())
    if not len(free) or not total > 0:
        return _USUAL, 1.0
    best, variance, least = _USUAL, 1.0, np.inf
    # Few frames do not tell.
    for h0 in np.geomspace(_STIFFEST, n / 4.0, _N_TRIED) if n >= _FEW else [_USUAL]:
        Q = chain_precision(phases, float(h0), anchor, is_closed=is_closed)[np.ix_(free, free)]
        logarithm = -2.0 * float(np.log(np.diag(inverse_of_cholesky(Q))).sum())
        energy = float((shares * (x * product(Q, x)).sum(axis=0)).sum()) / total / len(free)
        unlikely = len(free) * np.log(max(energy, 1e-300)) - logarithm
        if unlikely < least:
            best, variance, least = float(h0), energy, unlikely
    return best, variance


def joined(
    matrices: NDArray[np.float64],
    vectors: NDArray[np.float64],
    stiffness: NDArray[np.float64],
    Q: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Estimate all frames together: (Q (x) K + A) a = b.

    Parameters
    ----------
    matrices : (frames, n, n) float64
        A, what the data of each frame say.
    vectors : (frames, n) float64
        b.
    stiffness : (n,) float64
        Diagonal of K.
    Q : (frames, frames) float64
        As `chain_precision` returns it.

    Returns
    -------
    amplitudes : (frames, n) float64
    covariances : (frames, n, n) float64
        Of each frame.

    Notes
    -----
    Folded at its middle, a closed chain joins frames at most four places apart, so blocks of
    four frames form a tridiagonal system: S_i = D_i - E_i S_(i-1)^-1 E_i' forward, and
    C_i = S_i^-1 + G C_(i+1) G', G = S_i^-1 E_(i+1)', backward.
    """
    n_frames, n = vectors.shape
    order = _folded(n_frames)
    blocks = [order[i : i + 4] for i in range(0, n_frames, 4)]
    amplitudes, covariances = np.empty((n_frames, n)), np.empty((n_frames, n, n))
    inverses: list[NDArray[np.float64]] = []
    sums: list[NDArray[np.float64]] = []
    for i, block in enumerate(blocks):
        D = _kron(Q[np.ix_(block, block)], stiffness)
        for k, frame in enumerate(block):
            D[k * n : (k + 1) * n, k * n : (k + 1) * n] += matrices[frame]
        b = vectors[block].ravel()
        if i:
            E = Q[np.ix_(block, blocks[i - 1])]
            D -= _framed(inverses[-1], E, stiffness)
            b = b - _times(E, stiffness, product(inverses[-1], sums[-1][:, None])[:, 0])
        inverses.append(gram(inverse_of_cholesky(D)))
        sums.append(b)
    a, C = np.zeros(0), np.zeros((0, 0))
    for i in range(len(blocks) - 1, -1, -1):
        block, inverse, b = blocks[i], inverses[i], sums[i]
        if i == len(blocks) - 1:
            C = inverse
        else:
            E = Q[np.ix_(block, blocks[i + 1])]
            b = b - _times(E, stiffness, a)
            C = inverse + _between(inverse, E, stiffness, C)
        a = product(inverse, b[:, None])[:, 0]
        for k, frame in enumerate(block):
            rows = slice(k * n, (k + 1) * n)
            amplitudes[frame], covariances[frame] = a[rows], C[rows, rows]
    return amplitudes, covariances


def _folded(n: int) -> list[int]:
    """Frames both ways round from the first: 0, 1, n - 1, 2, n - 2, ..."""
    return [0, *(k for i in range(1, n // 2 + 1) for k in dict.fromkeys((i, n - i)))]


def _kron(Q: NDArray[np.float64], stiffness: NDArray[np.float64]) -> NDArray[np.float64]:
    n, k = len(stiffness), len(Q)
    full = np.zeros((k, n, k, n))
    rows = np.arange(n)
    full[:, rows, :, rows] = Q[None] * stiffness[:, None, None]
    return full.reshape(k * n, k * n)


def _times(
    E: NDArray[np.float64], stiffness: NDArray[np.float64], a: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(E (x) K) a."""
    n = len(stiffness)
    return ((E @ a.reshape(-1, n)) * stiffness).ravel()


def _framed(
    inverse: NDArray[np.float64], E: NDArray[np.float64], stiffness: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(E (x) K) S^-1 (E (x) K)'."""
    n, (rows, columns) = len(stiffness), E.shape
    S = inverse.reshape(columns, n, columns, n)
    framed = np.einsum("aidj,bd->aibj", np.einsum("ac,cidj->aidj", E, S), E)
    framed *= stiffness[None, :, None, None] * stiffness
    return np.asarray(framed.reshape(rows * n, rows * n), dtype=np.float64)


def _between(
    inverse: NDArray[np.float64],
    E: NDArray[np.float64],
    stiffness: NDArray[np.float64],
    C: NDArray[np.float64],
) -> NDArray[np.float64]:
    """S^-1 (E (x) K) C (E (x) K)' S^-1."""
    middle = _framed(C, E, stiffness)
    half = product(inverse, middle)
    full = product(half, inverse)
    return (full + full.T) / 2
