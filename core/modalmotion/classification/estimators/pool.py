"""Scorers of several blends side by side: what they share is worked out once.

Blends of one model often read the same features, and their kernels have the same anchors: such
scorers are one family, whose kernels take one product and not one each.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.estimators.scorer import LEAST, Blend, Scorer, log_sums
from modalmotion.classification.estimators.temperature import softmax

Array = NDArray[np.float64]

_LOG_LEAST: Final = float(np.log(LEAST))

# Share of its features that a scorer must have in common with a family: others are multiplied
# by zeros there.
_LEAST_IN_COMMON: Final = 0.5

# Features and kernels held at once: 32 MB.
_MOST_VALUES: Final = 2**22


class _Family(NamedTuple):
    """Scorers of features that they have in common.

    Parameters
    ----------
    features : slice
        Theirs, among those that are read.
    linear : (features, scorers * classes) float64
        Weights of the linear ones; zero for features that one does not have.
    of_linear : slice
        Their places among the scores.
    anchors : (features, anchors) float64
    masks : (kernels, features) float64
        2 gamma for the features that each kernel has, 0 for others.
    widths : (kernels,) float64
        1 / (4 gamma) of each.
    kernels : slice
        Of all kernels, one after another, after the features.
    weights : (kernels, anchors, classes) float64
    of_kernels : slice
        Their places among the scores.
    """

    features: slice
    linear: Array
    of_linear: slice
    anchors: Array
    masks: Array
    widths: Array
    kernels: slice
    weights: Array
    of_kernels: slice


@dataclass(frozen=True, eq=False)
class Pool:
    """Blends with features of their own, weighed: the arrays of all of them.

    Parameters
    ----------
    places : (read,) int64
        Features that are read, among those of all blends: of what several have, the first.
    centre, scale : (read,) float64
    families : tuple of _Family
    anchor_squares : (kernels * anchors,) float64
        Of all families: gamma |a|^2.
    intercepts : (scorers, classes) float64
        They and all weights are over the scorers' temperatures.
    means : (blends, scorers) float64
        Shares of the scorers in each blend.
    blend_temperatures, weights : (blends, 1) float64
    """

    places: NDArray[np.int64]
    centre: Array
    scale: Array
    families: tuple[_Family, ...]
    anchor_squares: Array
    intercepts: Array
    means: Array
    blend_temperatures: Array
    weights: Array

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
        step = max(1, _MOST_VALUES // (len(self.places) + len(self.anchor_squares)))
        if len(features) <= step:
            return self._log_shares(features)
        return np.concatenate(
            [self._log_shares(features[k : k + step]) for k in range(0, len(features), step)]
        )

    def _log_shares(self, features: Array) -> Array:
        n, d = len(features), len(self.places)
        # Standardised features, and after them the kernels.
        read = np.empty((n, d + len(self.anchor_squares)))
        z = read[:, :d]
        np.subtract(features.take(self.places, axis=1), self.centre, out=z)
        z /= self.scale
        self._fill_kernels(z, read[:, d:])
        n_scorers, n_classes = self.intercepts.shape
        scores = np.empty((n, n_scorers * n_classes))
        for family in self.families:
            if family.linear.shape[1]:
                np.matmul(z[:, family.features], family.linear, out=scores[:, family.of_linear])
            if len(family.weights):
                k, m, _ = family.weights.shape
                kernels = read[:, family.kernels].reshape(n, k, 1, m)
                own = scores[:, family.of_kernels].reshape(n, k, 1, n_classes)
                np.matmul(kernels, family.weights, out=own)
        shares = scores.reshape(n, n_scorers, n_classes)
        shares += self.intercepts
        logs = self.means @ softmax(shares)
        np.log(np.maximum(logs, LEAST, out=logs), out=logs)
        logs /= self.blend_temperatures
        if len(self.weights) == 1:
            return np.asarray(logs[:, 0])
        logs -= log_sums(logs)
        np.maximum(logs, _LOG_LEAST, out=logs)
        logs *= self.weights
        return np.asarray(np.add.reduce(logs, axis=1))

    def _fill_kernels(self, z: Array, kernels: Array) -> None:
        """Fill the kernels of all families, (cases, kernels * anchors): see `scorer.kernel`."""
        if not len(self.anchor_squares):
            return
        first = 0
        # -g |z - a|^2 = 2 g z.a - g |z|^2 - g |a|^2, in place: new memory costs more than sums.
        for family in self.families:
            k, m, _ = family.weights.shape
            if k:
                own = z[:, None, family.features] * family.masks
                exponents = kernels[:, first : first + k * m].reshape(len(z), k, m)
                np.matmul(own, family.anchors, out=exponents)
                exponents -= (np.einsum("ijk,ijk->ij", own, own) * family.widths)[..., None]
                first += k * m
        kernels -= self.anchor_squares
        np.exp(kernels, out=kernels)


def pool_of(
    blends: Sequence[Blend], weights: Sequence[float], features: Sequence[Sequence[Hashable]]
) -> Pool:
    """Lay blends side by side.

    Parameters
    ----------
    blends : sequence of Blend
    weights : sequence of float
        They add up to 1.
    features : sequence of sequence of hashable
        What each feature of each blend is: equal ones have equal values in every case.
    """
    firsts = np.cumsum([0, *(len(blend.centre) for blend in blends)]).tolist()
    scorers = [
        _Placed(scorer, number, _features_of(blend, own, first))
        for number, (blend, own, first) in enumerate(
            zip(blends, features, firsts[:-1], strict=True)
        )
        for scorer in blend.scorers
    ]
    # Kernels first: they are what costs, and their blends' linear scorers fit into their families.
    scorers.sort(key=lambda placed: not len(placed.scorer.anchors))
    groups: list[_Group] = []
    for placed in scorers:
        fitting = (group for group in groups if group.fits(placed))
        group = next(fitting, None)
        if group is None:
            group = _Group()
            groups.append(group)
        group.add(placed)
    n_classes = len(scorers[0].scorer.intercepts)
    families, d, first, score = [], 0, 0, 0
    n_read = sum(len(group.places) for group in groups)
    for group in groups:
        family = group.family(n_classes, d, n_read + first, score)
        families.append(family)
        d = family.features.stop
        first = family.kernels.stop - n_read
        score = family.of_kernels.stop
    ordered = [placed for group in groups for placed in (*group.linear, *group.kernels)]
    kernels = [placed.scorer for group in groups for placed in group.kernels]
    means = np.zeros((len(blends), len(ordered)))
    for k, placed in enumerate(ordered):
        means[placed.blend, k] = 1.0 / len(blends[placed.blend].scorers)
    places = np.array([place for group in groups for place in group.places.values()])
    nothing = [np.zeros(0)]
    return Pool(
        places=places,
        centre=np.concatenate([blend.centre for blend in blends])[places],
        scale=np.concatenate([blend.scale for blend in blends])[places],
        families=tuple(families),
        anchor_squares=np.concatenate(nothing + [s.gamma * s.anchor_squares for s in kernels]),
        intercepts=np.array([p.scorer.intercepts / p.scorer.temperature for p in ordered]),
        means=means,
        blend_temperatures=np.array([[blend.temperature] for blend in blends]),
        weights=np.array(weights)[:, None],
    )


class _Placed(NamedTuple):
    """A scorer, the number of its blend, and its features with their place among all."""

    scorer: Scorer
    blend: int
    features: dict[Hashable, int]

    @property
    def weights(self) -> Array:
        """Its weights over its temperature."""
        return np.asarray(self.scorer.weights / self.scorer.temperature)


def _features_of(blend: Blend, own: Sequence[Hashable], first: int) -> dict[Hashable, int]:
    """Features of a blend with their places: what they are, and how they are standardised."""
    features: dict[Hashable, int] = {}
    standards = zip(blend.centre.tolist(), blend.scale.tolist(), strict=True)
    for k, (what, standard) in enumerate(zip(own, standards, strict=True)):
        features[what, standard, k if (what, standard, None) in features else None] = first + k
    return features


@dataclass(eq=False)
class _Group:
    """Scorers on their way to a family.

    Parameters
    ----------
    places : dict of hashable to int
        Features, and their places among those of all blends.
    anchors : dict of hashable to (anchors,) float64
        Of the features that kernels have.
    linear, kernels : list of _Placed
    """

    places: dict[Hashable, int] = field(default_factory=dict)
    anchors: dict[Hashable, Array] = field(default_factory=dict)
    linear: list[_Placed] = field(default_factory=list)
    kernels: list[_Placed] = field(default_factory=list)

    def fits(self, placed: _Placed) -> bool:
        """Whether a scorer has enough in common with these, and the same anchors."""
        anchors, own = placed.scorer.anchors, list(placed.features)
        common = [k for k, feature in enumerate(own) if feature in self.places]
        if len(common) < max(1.0, _LEAST_IN_COMMON * len(own)):
            return False
        if not len(anchors) or not self.kernels:
            return True
        return len(anchors) == len(self.kernels[0].scorer.anchors) and all(
            np.array_equal(anchors[:, k], self.anchors[own[k]])
            for k in common
            if own[k] in self.anchors
        )

    def add(self, placed: _Placed) -> None:
        """Take a scorer in."""
        for feature, place in placed.features.items():
            self.places.setdefault(feature, place)
        if not len(placed.scorer.anchors):
            self.linear.append(placed)
            return
        self.kernels.append(placed)
        for feature, column in zip(placed.features, placed.scorer.anchors.T, strict=True):
            self.anchors.setdefault(feature, column)

    def family(self, n_classes: int, feature: int, kernel: int, score: int) -> _Family:
        """Lay the scorers side by side, from a feature, a kernel and a score on."""
        number = {what: k for k, what in enumerate(self.places)}
        n_linear, n_kernels = len(self.linear), len(self.kernels)
        linear = np.zeros((len(number), n_linear, n_classes))
        for k, placed in enumerate(self.linear):
            linear[[number[what] for what in placed.features], k] = placed.weights
        n_anchors = len(self.kernels[0].scorer.anchors) if n_kernels else 0
        anchors = np.zeros((len(number), n_anchors))
        for what, column in self.anchors.items():
            anchors[number[what]] = column
        masks = np.zeros((n_kernels, len(number)))
        for k, placed in enumerate(self.kernels):
            masks[k, [number[what] for what in placed.features]] = 2.0 * placed.scorer.gamma
        weights = np.zeros((n_kernels, n_anchors, n_classes))
        for k, placed in enumerate(self.kernels):
            weights[k] = placed.weights
        between = score + n_linear * n_classes
        return _Family(
            features=slice(feature, feature + len(number)),
            linear=linear.reshape(len(number), -1),
            of_linear=slice(score, between),
            anchors=anchors,
            masks=masks,
            # A kernel of no width at all is 1 everywhere.
            widths=np.array([0.25 / g if (g := p.scorer.gamma) else 0.0 for p in self.kernels]),
            kernels=slice(kernel, kernel + n_kernels * n_anchors),
            weights=weights,
            of_kernels=slice(between, between + n_kernels * n_classes),
        )
