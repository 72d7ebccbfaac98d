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

from modalmotion.classification.estimators.scorer import LEAST, Blend, Scorer

Array = NDArray[np.float64]

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
    masks : (kernels, features + kernels + 1) float64
        2 gamma for the features that each kernel has, 0 for others; then 1 in its own place, and
        room for -gamma |z|^2.
    anchors : (features + kernels + 1, anchors) float64
        After the features -gamma |a|^2 of each kernel, and 1.
    squares : (features, kernels) float64
        -gamma for the features that each kernel has.
    kernels : slice
        Of all kernels, one after another, after the features.
    weights : (kernels, anchors, classes) float64
    of_kernels : slice
        Their places among the scores.
    """

    features: slice
    linear: Array
    of_linear: slice
    masks: Array
    anchors: Array
    squares: Array
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
    n_kernels : int
        Of all families, times their anchors.
    intercepts : (classes, 1, scorers) float64
        They and all weights are over the scorers' temperatures.
    means : (scorers, blends) float64
        Shares of the scorers in each blend.
    blend_temperatures, weights : (blends,) float64
    least : (blends,) float64
        Probabilities that are no more than rounding, before the temperature makes them less.
    """

    places: NDArray[np.int64]
    centre: Array
    scale: Array
    families: tuple[_Family, ...]
    n_kernels: int
    intercepts: Array
    means: Array
    blend_temperatures: Array
    weights: Array
    least: Array

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
        step = max(1, _MOST_VALUES // (len(self.places) + self.n_kernels))
        if len(features) <= step:
            return self._log_shares(features)
        return np.concatenate(
            [self._log_shares(features[k : k + step]) for k in range(0, len(features), step)]
        )

    def _log_shares(self, features: Array) -> Array:
        n, d = len(features), len(self.places)
        # Standardised features, and after them the kernels.
        read = np.empty((n, d + self.n_kernels))
        z = read[:, :d]
        np.subtract(features.take(self.places, axis=1), self.centre, out=z)
        z /= self.scale
        n_classes, _, n_scorers = self.intercepts.shape
        scores = np.empty((n, n_scorers * n_classes))
        for family in self.families:
            if family.linear.shape[1]:
                np.matmul(z[:, family.features], family.linear, out=scores[:, family.of_linear])
            if len(family.weights):
                k, m, _ = family.weights.shape
                kernels = read[:, family.kernels].reshape(n, k, m)
                _fill_kernels(z[:, family.features], family, kernels)
                own = scores[:, family.of_kernels].reshape(n, k, 1, n_classes)
                np.matmul(kernels[:, :, None], family.weights, out=own)
        # Classes first: sums over few neighbours cost numpy several times as much.
        shares = np.empty((n_classes, n, n_scorers))
        by_class = scores.reshape(n, n_scorers, n_classes).transpose(2, 0, 1)
        np.add(by_class, self.intercepts, out=shares)
        shares -= np.maximum.reduce(shares)
        np.exp(shares, out=shares)
        shares /= np.add.reduce(shares)
        logs = shares @ self.means
        # What they add up to is the same for all classes.
        np.log(np.maximum(logs, self.least, out=logs), out=logs)
        logs /= self.blend_temperatures
        return np.asarray((logs @ self.weights).T)


def _fill_kernels(z: Array, family: _Family, kernels: Array) -> None:
    """Fill a family's kernels, (cases, kernels, anchors), in place: see `scorer.kernel`.

    -g |z - a|^2 = 2 g z.a - g |z|^2 - g |a|^2 in one product.
    """
    d = len(family.squares)
    own = np.empty((len(z), *family.masks.shape))
    np.multiply(z[:, None], family.masks[:, :d], out=own[..., :d])
    own[..., d:-1] = family.masks[:, d:-1]
    own[..., -1] = (z * z) @ family.squares
    np.matmul(own, family.anchors, out=kernels)
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
    means = np.zeros((len(ordered), len(blends)))
    for k, placed in enumerate(ordered):
        means[k, placed.blend] = 1.0 / len(blends[placed.blend].scorers)
    places = np.array([place for group in groups for place in group.places.values()])
    temperatures = np.array([blend.temperature for blend in blends])
    intercepts = np.array([p.scorer.intercepts / p.scorer.temperature for p in ordered])
    return Pool(
        places=places,
        centre=np.concatenate([blend.centre for blend in blends])[places],
        scale=np.concatenate([blend.scale for blend in blends])[places],
        families=tuple(families),
        n_kernels=first,
        intercepts=intercepts.T[:, None].copy(),
        means=means,
        blend_temperatures=temperatures,
        weights=np.array(weights),
        least=LEAST ** np.minimum(temperatures, 1.0),
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
        d = len(number)
        anchors = np.ones((d + n_kernels + 1, n_anchors))
        anchors[:d] = 0.0
        for what, column in self.anchors.items():
            anchors[number[what]] = column
        masks = np.zeros((n_kernels, d))
        for k, placed in enumerate(self.kernels):
            masks[k, [number[what] for what in placed.features]] = placed.scorer.gamma
            anchors[d + k] = -placed.scorer.gamma * placed.scorer.anchor_squares
        weights = np.zeros((n_kernels, n_anchors, n_classes))
        for k, placed in enumerate(self.kernels):
            weights[k] = placed.weights
        between = score + n_linear * n_classes
        return _Family(
            features=slice(feature, feature + len(number)),
            linear=linear.reshape(len(number), -1),
            of_linear=slice(score, between),
            masks=np.concatenate([2.0 * masks, np.eye(n_kernels, n_kernels + 1)], axis=1),
            anchors=anchors,
            squares=-masks.T.copy(),
            kernels=slice(kernel, kernel + n_kernels * n_anchors),
            weights=weights,
            of_kernels=slice(between, between + n_kernels * n_classes),
        )
