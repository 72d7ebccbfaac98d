"""Probabilities from scores, by one number that makes them reliable."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

# Between these no probability is more than rounding away from 0 and 1, or from equal.
_LOG_LIMITS: Final = (-6.0, 3.0)


def softmax(scores: NDArray[np.float64]) -> NDArray[np.float64]:
    """Shares exp(s) / sum exp(s) along the last axis, without overflow."""
    shares: NDArray[np.float64] = np.exp(scores - scores.max(axis=-1, keepdims=True))
    shares /= shares.sum(axis=-1, keepdims=True)
    return shares


def log_loss(
    scores: NDArray[np.float64],
    y: NDArray[np.int64],
    weights: NDArray[np.float64] | None = None,
    doubt: float = 0.0,
) -> float:
    """Mean of -log p(y) under `softmax` of the scores, in nats.

    `doubt` is the share of each case that is spread over all classes evenly.
    """
    losses = case_losses(scores, y, doubt)
    if weights is None:
        return float(losses.mean())
    return float((losses * weights).sum() / weights.sum())


def case_losses(
    scores: NDArray[np.float64], y: NDArray[np.int64], doubt: float = 0.0
) -> NDArray[np.float64]:
    """Loss of each case, (cases,) float64; `log_loss` is their mean."""
    shifted = scores - scores.max(axis=1, keepdims=True)
    right = (1.0 - doubt) * shifted[np.arange(len(y)), y] + doubt * shifted.mean(axis=1)
    losses: NDArray[np.float64] = np.log(np.exp(shifted).sum(axis=1)) - right
    return losses


def fit_temperature(
    scores: NDArray[np.float64], y: NDArray[np.int64], weights: NDArray[np.float64] | None = None
) -> float:
    """Temperature T for which softmax(scores / T) makes the held-out labels most likely.

    Guo, Pleiss, Sun and Weinberger, On calibration of modern neural networks, ICML, 2017. Of n
    labels one more than was seen is taken to be wrong, so that a few cases that happen to be
    separable give no certainty (Platt, Probabilistic outputs for support vector machines, 1999).

    Parameters
    ----------
    scores : (cases, classes) float64
        Of cases that the scores were not fitted to.
    y : (cases,) int64
    weights : (cases,) float64, optional

    Returns
    -------
    float
    """
    doubt = 1.0 / (len(y) + 2)
    spread = float(np.abs(scores - scores.mean(axis=1, keepdims=True)).mean()) or 1.0
    result = minimize_scalar(
        lambda log_t: log_loss(scores / (spread * np.exp(log_t)), y, weights, doubt),
        bounds=_LOG_LIMITS,
        method="bounded",
        options={"xatol": 1e-3},
    )
    return spread * float(np.exp(result.x))
