"""Probabilities of classes from features, as plain arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.estimators.temperature import softmax
from modalmotion.numeric.frozen_arrays import FrozenArrays
from modalmotion.representation import shown

LEAST: Final = 1e-12
"""Below this a probability is rounding."""


@shown()
@dataclass(frozen=True, eq=False)
class Scorer(FrozenArrays):
    """A linear or Gaussian-kernel score of each class.

    Parameters
    ----------
    anchors : (anchors, features) float64
        Standardised; none for a linear score.
    gamma : float
        k(z, a) = exp(-gamma |z - a|^2).
    weights : (features or anchors, classes) float64
        Of z, or of the kernels at the anchors.
    intercepts : (classes,) float64
    temperature : float
        The scorer's probabilities are softmax(scores / temperature).
    """

    anchors: NDArray[np.float64]
    gamma: float
    weights: NDArray[np.float64]
    intercepts: NDArray[np.float64]
    temperature: float

    def __post_init__(self) -> None:
        for array in (self.anchors, self.weights, self.intercepts):
            array.setflags(write=False)

    def probabilities(self, z: NDArray[np.float64]) -> NDArray[np.float64]:
        """Probabilities, (cases, classes) float64, of standardised features."""
        if len(self.anchors):
            z = _gaussian(z, self.anchors, self.anchor_squares, self.gamma)
        return softmax((z @ self.weights + self.intercepts) / self.temperature)

    @cached_property
    def anchor_squares(self) -> NDArray[np.float64]:
        """Of the anchors' lengths, (anchors,) float64."""
        return _squares(self.anchors)


@shown()
@dataclass(frozen=True, eq=False)
class Blend(FrozenArrays):
    """Mean of the probabilities of scorers, made reliable.

    Parameters
    ----------
    centre, scale : (features,) float64
        Standardisation: z = (x - centre) / scale; the scale of a constant feature is infinite.
    scorers : tuple of Scorer
    temperature : float
        Probabilities are softmax(log(mean) / temperature).
    """

    centre: NDArray[np.float64]
    scale: NDArray[np.float64]
    scorers: tuple[Scorer, ...]
    temperature: float

    def __post_init__(self) -> None:
        for array in (self.centre, self.scale):
            array.setflags(write=False)

    def standardised(self, features: NDArray[np.float64]) -> NDArray[np.float64]:
        """Features in standard deviations from the training cases' mean."""
        z: NDArray[np.float64] = (features - self.centre) / self.scale
        return z

    def log_shares(self, features: NDArray[np.float64]) -> NDArray[np.float64]:
        """Log probabilities up to a constant, (cases, classes), of features (cases, features)."""
        z = self.standardised(features)
        return blended([scorer.probabilities(z) for scorer in self.scorers]) / self.temperature


def blended(shares: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Log of the mean of probabilities."""
    mean = sum(shares[1:], shares[0]) / len(shares)
    logs: NDArray[np.float64] = np.log(np.maximum(mean, LEAST))
    return logs


def pooled(logs: Sequence[NDArray[np.float64]], weights: Sequence[float]) -> NDArray[np.float64]:
    """Weighted mean of log probabilities, up to a constant: a logarithmic opinion pool.

    Genest and Zidek, Combining probability distributions: a critique and an annotated
    bibliography, Statistical Science, 1986. What one rules out others may still hold possible:
    none is below the rounding of a probability.

    Parameters
    ----------
    logs : sequence of (cases, classes) float64
        Each up to a constant.
    weights : sequence of float
        They add up to 1.
    """
    total = np.zeros_like(logs[0])
    for log, weight in zip(logs, weights, strict=True):
        total += weight * np.maximum(log - log_sums(log), np.log(LEAST))
    return total


def log_sums(logs: NDArray[np.float64]) -> NDArray[np.float64]:
    """Log of the sum of exponentials along the last axis, which stays, without overflow."""
    largest = np.maximum.reduce(logs, axis=-1, keepdims=True)
    sums: NDArray[np.float64] = np.log(
        np.add.reduce(np.exp(logs - largest), axis=-1, keepdims=True)
    )
    sums += largest
    return sums


def kernel(
    z: NDArray[np.float64], anchors: NDArray[np.float64], gamma: float
) -> NDArray[np.float64]:
    """exp(-gamma |z - a|^2), (cases, anchors) float64."""
    return _gaussian(z, anchors, _squares(anchors), gamma)


def _gaussian(
    z: NDArray[np.float64],
    anchors: NDArray[np.float64],
    anchor_squares: NDArray[np.float64],
    gamma: float,
) -> NDArray[np.float64]:
    # |z - a|^2 = |z|^2 + |a|^2 - 2 z.a
    squares = z @ anchors.T
    squares *= -2.0
    squares += anchor_squares
    squares += _squares(z)[:, None]
    np.maximum(squares, 0.0, out=squares)
    squares *= -gamma
    values: NDArray[np.float64] = np.exp(squares, out=squares)
    return values


def _squares(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    squares: NDArray[np.float64] = np.einsum("ij,ij->i", rows, rows)
    return squares
