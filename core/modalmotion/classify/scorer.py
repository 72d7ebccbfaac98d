"""Probabilities of classes from features, as plain arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modalmotion.classify.temperature import softmax

# Below this a probability is rounding.
_LEAST: float = 1e-12


@dataclass(frozen=True, eq=False)
class Scorer:
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
            z = kernel(z, self.anchors, self.gamma)
        return softmax((z @ self.weights + self.intercepts) / self.temperature)


@dataclass(frozen=True, eq=False)
class Blend:
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
        """Log probabilities but for a constant, (cases, classes), of features (cases, features)."""
        z = self.standardised(features)
        return blended([scorer.probabilities(z) for scorer in self.scorers]) / self.temperature


def blended(shares: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Log of the mean of probabilities."""
    logs: NDArray[np.float64] = np.log(np.maximum(np.mean(shares, axis=0), _LEAST))
    return logs


def kernel(
    z: NDArray[np.float64], anchors: NDArray[np.float64], gamma: float
) -> NDArray[np.float64]:
    """exp(-gamma |z - a|^2), (cases, anchors) float64."""
    squares = (z**2).sum(axis=1)[:, None] + (anchors**2).sum(axis=1)
    squares -= 2.0 * z @ anchors.T
    values: NDArray[np.float64] = np.exp(-gamma * np.maximum(squares, 0.0))
    return values
