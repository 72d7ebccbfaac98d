"""In which of its readings each training case is taken."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.estimators.standards import class_means

# Times that the readings are chosen anew from the classes they gave.
_N_ROUNDS: Final = 5

# Shrinkage towards independent features where there are many cases.
_LEAST_SHRINKAGE: Final = 1e-2


def best_readings(
    values: NDArray[np.float64],
    y: NDArray[np.int64],
    n_classes: int,
    allowed: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """Features in the allowed reading that is nearest to the case's own class, found by turns.

    Parameters
    ----------
    values : (cases, readings, features) float64
        Of one reading where there is nothing to choose.
    y : (cases,) int64
    n_classes : int
    allowed : (cases, readings) bool
        See `readings_of`.

    Returns
    -------
    (cases, features) float64
    """
    if values.shape[1] == 1:
        return np.asarray(values[:, 0])
    every = np.arange(len(values))
    X = values[every, allowed.argmax(axis=1)]
    for _ in range(_N_ROUNDS):
        centre, scale = X.mean(axis=0), np.where(X.std(axis=0) > 0, X.std(axis=0), np.inf)
        means, whitening = class_shape((X - centre) / scale, y, n_classes)
        apart = ((values - centre) / scale - means[y][:, None]) @ whitening
        squares = np.where(allowed, (apart**2).sum(axis=2), np.inf)
        X = values[every, squares.argmin(axis=1)]
    return np.asarray(X)


def class_shape(
    z: NDArray[np.float64], y: NDArray[np.int64], n_classes: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Class means, and the whitening of the shrunk covariance within classes."""
    n, d = z.shape
    means = class_means(z, y, n_classes)
    apart = z - means[y]
    S = apart.T @ apart / n
    variances = np.diag(S)
    known = np.where(variances > 0, variances, 1.0)
    # With fewer cases than features nothing is known of most directions.
    share = max(_LEAST_SHRINKAGE, d / (n + d))
    S = (1.0 - share) * S + share * np.diag(known)
    L = np.linalg.cholesky(S)
    whitening: NDArray[np.float64] = np.linalg.inv(L).T / np.sqrt(d)
    return means, whitening
