"""Covariances of few cases with many features, shrunk so that they can be solved with."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# What is constant has no variance, and would make the covariance singular.
_LEAST: float = 1e-9


def shrunk_solution(
    residuals: NDArray[np.float64], right: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Solve S x = right with S = (1 - a) X'X / n + a m I, the shrunk covariance of centred X.

    Parameters
    ----------
    residuals : (cases, features) float64
        X, about the means of the classes.
    right : (features, n) float64

    Returns
    -------
    (features, n) float64
        Of the nearest mean where nothing varies: S = I.

    Notes
    -----
    The share a is that of Ledoit and Wolf, A well-conditioned estimator for large-dimensional
    covariance matrices, J Multivar Anal, 2004. It needs the products of the cases alone, and so
    does the solution (Woodbury): features may be many. Where cases are more, those of the features
    say the same.
    """
    n, d = residuals.shape
    gram = residuals @ residuals.T if d > n else residuals.T @ residuals
    squares = np.einsum("ij,ij->i", residuals, residuals)
    mean = float(squares.sum()) / (n * d)
    if mean == 0.0:
        return right
    # |X'X / n|^2 and the sum over features i, j of the mean of (x_i x_j)^2.
    product = float((gram**2).sum()) / n**2
    fourth = float((squares**2).sum()) / n
    beta = (fourth - product) / n
    delta = product - d * mean**2
    share = 0.0 if beta <= 0.0 else (1.0 if beta >= delta else beta / delta)
    floor = (share + _LEAST) * mean
    scale = (1.0 - share) / n
    if scale == 0.0:
        nearest: NDArray[np.float64] = right / floor
        return nearest
    gram *= scale
    gram[np.diag_indices_from(gram)] += floor
    if d <= n:
        return np.asarray(np.linalg.solve(gram, right), dtype=np.float64)
    # (c X'X + f I)^-1 = (I - c X' (f I + c X X')^-1 X) / f
    inner = np.linalg.solve(gram, residuals @ right)
    solution: NDArray[np.float64] = (right - scale * (residuals.T @ inner)) / floor
    return solution
