"""Probabilities from scores, by one number that makes them reliable."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

# Between these 1 / T no probability is more than rounding away from equal, or from 0 and 1.
_LIMITS: Final = (0.05, 400.0)

_MOST_STEPS: Final = 60
_PRECISION: Final = 1e-6


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
    """Temperature of one set of scores, (cases, classes): see `fit_temperatures`."""
    return float(fit_temperatures(scores[None], y, weights)[0])


def fit_temperatures(
    scores: NDArray[np.float64], y: NDArray[np.int64], weights: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    """Temperatures T for which softmax(scores / T) makes the held-out labels most likely.

    Guo, Pleiss, Sun and Weinberger, On calibration of modern neural networks, ICML, 2017. Of n
    labels one more than was seen is taken to be wrong, so that a few cases that happen to be
    separable give no certainty (Platt, Probabilistic outputs for support vector machines, 1999).

    Parameters
    ----------
    scores : (sets, cases, classes) float64
        Of cases that the scores were not fitted to.
    y : (cases,) int64
    weights : (cases,) float64, optional

    Returns
    -------
    (sets,) float64
        By Newton's method, for the loss is convex in 1 / T; between limits in units of the mean
        distance of scores from their mean.
    """
    n_sets, n, _ = scores.shape
    doubt = 1.0 / (n + 2)
    shares = np.full(n, 1.0 / n) if weights is None else weights / weights.sum()
    centred = scores - scores.mean(axis=2, keepdims=True)
    spread = np.abs(centred).mean(axis=(1, 2))
    spread[spread == 0.0] = 1.0
    z = centred / spread[:, None, None]
    # Mean of what the labels ask for: the mean score of a case is 0.
    wanted = (1.0 - doubt) * (z[:, np.arange(n), y] @ shares)
    low, high = (np.full(n_sets, limit) for limit in _LIMITS)
    b = np.ones(n_sets)
    for _ in range(_MOST_STEPS):
        p = softmax(b[:, None, None] * z)
        mean = (p * z).sum(axis=2)
        slope = mean @ shares - wanted
        curvature = ((p * z**2).sum(axis=2) - mean**2) @ shares
        low, high = np.where(slope < 0, b, low), np.where(slope < 0, high, b)
        with np.errstate(divide="ignore", invalid="ignore"):
            newton = b - slope / curvature
        inside = (low < newton) & (newton < high)
        following = np.where(inside, newton, np.sqrt(low * high))
        moved = np.abs(following - b) > _PRECISION * b
        b = following
        if not moved.any():
            break
    temperatures: NDArray[np.float64] = spread / b
    return temperatures
