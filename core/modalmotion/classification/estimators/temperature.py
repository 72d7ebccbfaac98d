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
    shares: NDArray[np.float64] = np.exp(scores - np.maximum.reduce(scores, axis=-1, keepdims=True))
    shares /= np.add.reduce(shares, axis=-1, keepdims=True)
    return shares


def log_losses(
    scores: NDArray[np.float64],
    y: NDArray[np.int64],
    weights: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Mean of -log p(y) under `softmax` of each set of scores, (sets,) float64, in nats.

    Parameters
    ----------
    scores : (sets, cases, classes) float64
    y : (cases,) int64
    weights : (cases,) float64, optional
    """
    # One class after another: sums over few neighbours cost numpy several times as much.
    z = np.ascontiguousarray(np.moveaxis(scores, -1, 0))
    z = z - z.max(axis=0)
    right = np.take_along_axis(z, y[None, None], axis=0)[0]
    losses = np.log(np.exp(z).sum(axis=0)) - right
    means: NDArray[np.float64] = losses @ _shares(len(y), weights)
    return means


def case_losses(scores: NDArray[np.float64], y: NDArray[np.int64]) -> NDArray[np.float64]:
    """Loss of each case, (cases,) float64, of scores (cases, classes): see `log_losses`."""
    shifted = scores - scores.max(axis=1, keepdims=True)
    losses: NDArray[np.float64] = np.log(np.exp(shifted).sum(axis=1))
    losses -= shifted[np.arange(len(y)), y]
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
    n_sets, n, n_classes = scores.shape
    doubt = 1.0 / (n + 2)
    shares = _shares(n, weights)
    # One class after another: see `log_losses`.
    z = np.ascontiguousarray(np.moveaxis(scores, -1, 0))
    z = z - z.mean(axis=0)
    spread = np.abs(z).sum(axis=(0, 2)) / (n * n_classes)
    spread[spread == 0.0] = 1.0
    z /= spread[:, None]
    # Mean of what the labels ask for: the mean score of a case is 0.
    wanted = (1.0 - doubt) * (np.take_along_axis(z, y[None, None], axis=0)[0] @ shares)
    largest = z.max(axis=0)
    z -= largest
    wanted -= largest @ shares

    low, high = (np.full(n_sets, limit) for limit in _LIMITS)
    # Where the loss falls up to a limit, or from one on, its least is there.
    low = np.where(_slopes(z, high, shares)[0] <= wanted, high, low)
    high = np.where(_slopes(z, low, shares)[0] >= wanted, low, high)
    b = np.clip(1.0, low, high)
    rest = np.flatnonzero(low < high)
    for _ in range(_MOST_STEPS):
        if not len(rest):
            break
        at = b[rest]
        mean, curvature = _slopes(z[:, rest], at, shares)
        slope = mean - wanted[rest]
        low[rest] = np.where(slope < 0, at, low[rest])
        high[rest] = np.where(slope < 0, high[rest], at)
        with np.errstate(divide="ignore", invalid="ignore"):
            newton = at - slope / curvature
        inside = (low[rest] < newton) & (newton < high[rest])
        b[rest] = np.where(inside, newton, np.sqrt(low[rest] * high[rest]))
        rest = rest[np.abs(b[rest] - at) > _PRECISION * at]
    temperatures: NDArray[np.float64] = spread / b
    return temperatures


def _slopes(
    z: NDArray[np.float64], b: NDArray[np.float64], shares: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean over the cases of the expected score of softmax(b z), and its derivative by b.

    Parameters
    ----------
    z : (classes, sets, cases) float64
        At most 0.
    b : (sets,) float64
    shares : (cases,) float64

    Returns
    -------
    (sets,) float64, (sets,) float64
    """
    p = np.exp(b[:, None] * z)
    total = p.sum(axis=0)
    p *= z
    mean = p.sum(axis=0) / total
    p *= z
    return mean @ shares, (p.sum(axis=0) / total - mean**2) @ shares


def _shares(n: int, weights: NDArray[np.float64] | None) -> NDArray[np.float64]:
    """Weights of n cases, which add up to 1."""
    return np.full(n, 1.0 / n) if weights is None else weights / weights.sum()
