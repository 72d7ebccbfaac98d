"""Scorers of several blends side by side: one call for each step, and not one for each scorer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.estimators.scorer import LEAST, Blend, log_sums
from modalmotion.classification.estimators.temperature import softmax

Array = NDArray[np.float64]

_LOG_LEAST: Final = float(np.log(LEAST))


# Features and kernels held at once: 32 MB.
_MOST_VALUES: Final = 2**22


@dataclass(frozen=True, eq=False)
class Pool:
    """Blends with features of their own, weighed: the arrays of all of them.

    Parameters
    ----------
    centre, scale : (features,) float64
        Of all blends, one after another.
    firsts : (blends,) int64
        First scorer of each blend.
    kernels : tuple of (slice, (features, anchors) float64)
        Features and anchors of each scorer with a kernel.
    anchor_squares, factors : (anchors,) float64
        Of the anchors of all kernels, one after another: their squares, and -gamma.
    scores : tuple of (slice, (n, classes) float64)
        Weights of each scorer, of its features or, after all features, of its kernels.
    intercepts : (scorers, classes) float64
    temperatures : (scorers, 1) float64
    counts, blend_temperatures, weights : (blends, 1) float64
        Numbers of scorers, and temperature and weight of each blend.
    """

    centre: Array
    scale: Array
    firsts: NDArray[np.int64]
    kernels: tuple[tuple[slice, Array], ...]
    anchor_squares: Array
    factors: Array
    scores: tuple[tuple[slice, Array], ...]
    intercepts: Array
    temperatures: Array
    counts: Array
    blend_temperatures: Array
    weights: Array

    @classmethod
    def of(cls, blends: Sequence[Blend], weights: Sequence[float]) -> Pool:
        """Lay blends side by side."""
        counts = np.array([len(blend.scorers) for blend in blends])
        kernels, scores = [], []
        squares, factors = [np.zeros(0)], [np.zeros(0)]
        first, place = 0, sum(len(blend.centre) for blend in blends)
        for blend in blends:
            own = slice(first, first + len(blend.centre))
            first = own.stop
            for scorer in blend.scorers:
                n = len(scorer.anchors)
                scores.append((slice(place, place + n) if n else own, scorer.weights))
                if n:
                    place += n
                    kernels.append((own, scorer.anchors.T))
                    squares.append(scorer.anchor_squares)
                    factors.append(np.full(n, -scorer.gamma))
        scorers = [scorer for blend in blends for scorer in blend.scorers]
        return cls(
            centre=np.concatenate([blend.centre for blend in blends]),
            scale=np.concatenate([blend.scale for blend in blends]),
            firsts=np.cumsum(counts) - counts,
            kernels=tuple(kernels),
            anchor_squares=np.concatenate(squares),
            factors=np.concatenate(factors),
            scores=tuple(scores),
            intercepts=np.array([scorer.intercepts for scorer in scorers]),
            temperatures=np.array([[scorer.temperature] for scorer in scorers]),
            counts=counts[:, None].astype(np.float64),
            blend_temperatures=np.array([[blend.temperature] for blend in blends]),
            weights=np.array(weights)[:, None],
        )

    def log_shares(self, features: Array) -> Array:
        """Weighted mean of the log probabilities of all blends: see `pooled`.

        Parameters
        ----------
        features : (cases, features) float64
            Of all blends, one after another.

        Returns
        -------
        (cases, classes) float64
            Up to a constant.
        """
        step = max(1, _MOST_VALUES // (len(self.centre) + len(self.factors)))
        if len(features) <= step:
            return self._log_shares(features)
        return np.concatenate(
            [self._log_shares(features[k : k + step]) for k in range(0, len(features), step)]
        )

    def _log_shares(self, features: Array) -> Array:
        n, d = features.shape
        # Standardised features, and after them the kernels.
        read = np.empty((n, d + len(self.factors)))
        z = read[:, :d]
        np.subtract(features, self.centre, out=z)
        z /= self.scale
        if self.kernels:
            self._gaussian(z, read[:, d:])
        shares = np.empty((n, *self.intercepts.shape))
        for k, (places, weights) in enumerate(self.scores):
            np.matmul(read[:, places], weights, out=shares[:, k])
        shares += self.intercepts
        shares /= self.temperatures
        logs = np.add.reduceat(softmax(shares), self.firsts, axis=1)
        logs /= self.counts
        np.log(np.maximum(logs, LEAST, out=logs), out=logs)
        logs /= self.blend_temperatures
        if len(self.weights) == 1:
            return logs[:, 0]
        logs -= log_sums(logs)
        np.maximum(logs, _LOG_LEAST, out=logs)
        logs *= self.weights
        return np.asarray(np.add.reduce(logs, axis=1))

    def _gaussian(self, z: Array, kernels: Array) -> None:
        """Fill kernels, (cases, anchors): see `scorer.kernel`."""
        first = 0
        # |z - a|^2 = |z|^2 + |a|^2 - 2 z.a, in place: new memory costs more than the sums.
        for places, anchors in self.kernels:
            last = first + anchors.shape[1]
            own, squares = z[:, places], kernels[:, first:last]
            np.matmul(own, anchors, out=squares)
            squares *= -2.0
            squares += np.einsum("ij,ij->i", own, own)[:, None]
            first = last
        kernels += self.anchor_squares
        np.maximum(kernels, 0.0, out=kernels)
        kernels *= self.factors
        np.exp(kernels, out=kernels)
