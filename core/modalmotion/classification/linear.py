"""Discriminant analysis with a shrunk covariance, and probabilities that are reliable."""

from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np
import scipy

from modalmotion.representation import Floats, Ints

# Cases are left out in as many parts, with their group, to fit temperatures and weights.
_N_FOLDS: Final = 10
# Limits of 1 / T in units of the scores' spread: beyond them probabilities are rounding.
_LIMITS: Final = (0.05, 400.0)
# What is constant has no variance, and would make the covariance singular.
_LEAST: Final = 1e-9


class Linear(NamedTuple):
    """A linear score of each class.

    Parameters
    ----------
    weights : (features, classes) float64
    intercepts : (classes,) float64
    """

    weights: Floats
    intercepts: Floats

    def scores(self, X: Floats) -> Floats:
        """Scores, (cases, classes)."""
        return np.asarray(X @ self.weights + self.intercepts)

    def times(self, factor: float) -> "Linear":
        """Multiply the scores."""
        return Linear(self.weights * factor, self.intercepts * factor)


def discriminant(X: Floats, y: Ints, n_classes: int) -> Linear:
    """Log p(k | x) up to a constant, by classes of one shrunk covariance.

    z' S^-1 m_k - m_k' S^-1 m_k / 2 + log prior_k, of scaled features z and class means m_k.

    Parameters
    ----------
    X : (cases, features) float64
    y : (cases,) int64
    n_classes : int
        A class without cases is as good as excluded.

    Notes
    -----
    S = (1 - a) R'R / n + a m I of the residuals R about the class means, with the share a of
    Ledoit and Wolf, A well-conditioned estimator for large-dimensional covariance matrices, J
    Multivar Anal, 2004. Where features are more than cases, S^-1 is solved among the cases
    (Woodbury): scikit-learn's, which solves among features, takes a hundred times as long here.

    Features are scaled by their deviation within the classes. Scaled by that of all cases, one that
    separates the classes would vary little about their means, and shrinkage, which makes variances
    alike, would take most of its weight. The degrees of freedom that the means of K classes take
    from n cases are taken to vary as all cases do: scale^2 = ((n - K) within^2 + (K - 1) overall^2)
    / (n - 1).

    Class means are drawn to their common mean by 1 - 1 / F of each feature, never beyond it, where
    F is that of an analysis of variance: about 1 / F of how far they are apart is chance (James
    and Stein, Estimation with quadratic loss, Proc Fourth Berkeley Symp, 1961, positive part).
    """
    counts = np.bincount(y, minlength=n_classes)
    centre, variances = X.mean(axis=0), X.var(axis=0)
    within = (X - class_means(X, y, n_classes)[y]).var(axis=0)
    n, n_known = len(y), (counts > 0).sum()
    share, by_chance = (n_known - 1) / (n - 1), (n_known - 1) / max(n - n_known, 1) * within
    constant = variances <= (1e-12 * np.abs(X).max(axis=0)) ** 2
    scale = np.where(constant, np.inf, np.sqrt(within + share * (variances - within)))
    z = (X - centre) / scale
    means = class_means(z, y, n_classes)
    residuals, between = z - means[y], np.maximum(variances - within, by_chance)
    means *= 1.0 - by_chance / np.where(between > 0.0, between, np.inf)
    W = _solved(residuals, means.T)
    prior = np.maximum(counts, 1e-3)
    intercepts = np.log(prior / prior.sum()) - 0.5 * np.einsum("kd,dk->k", means, W)
    weights = W / scale[:, None]
    return Linear(weights, intercepts - centre @ weights)


def class_means(z: Floats, y: Ints, n_classes: int) -> Floats:
    """Mean of the cases of each class, (classes, features); 0 of a class without any."""
    is_member = (y == np.arange(n_classes)[:, None]).astype(np.float64)
    return np.asarray(is_member @ z / np.maximum(is_member.sum(axis=1), 1.0)[:, None])


def left_out_scores(X: Floats, y: Ints, n_classes: int, groups: Ints) -> Floats:
    """Scores of each case by fits without its group, (cases, classes)."""
    scores = np.zeros((len(y), n_classes))
    for train, test in inner_folds(y, groups):
        scores[test] = discriminant(X[train], y[train], n_classes).scores(X[test])
    return scores


def inner_folds(y: Ints, groups: Ints) -> Iterator[tuple[Ints, Ints]]:
    """Split into parts by group, classes spread evenly, without randomness.

    Leaving a group out does not test a class that is in no other: the cases of such a class are
    groups of their own.
    """
    groups = groups.copy()
    for k in np.unique(y):
        mine = np.flatnonzero(y == k)
        if len(np.unique(groups[mine])) == 1:
            groups[mine] = groups.max() + 1 + mine
    _, first, place = np.unique(groups, return_index=True, return_inverse=True)
    # Groups in the order of their class take turns.
    turn = np.empty(len(first), dtype=np.int64)
    turn[np.lexsort((first, y[first]))] = np.arange(len(first))
    fold = turn[place] % min(_N_FOLDS, len(first))
    for k in range(int(fold.max()) + 1):
        if (fold != k).sum() > 1:
            yield np.flatnonzero(fold != k), np.flatnonzero(fold == k)


def log_losses(scores: Floats, y: Ints) -> Floats:
    """-log p(y) of each case, (cases,), nats."""
    return np.asarray(-scipy.special.log_softmax(scores, axis=1)[np.arange(len(y)), y])


def temperature_of(scores: Floats, y: Ints) -> float:
    """Temperature T for which softmax(scores / T) makes left-out labels most likely.

    Guo, Pleiss, Sun and Weinberger, On calibration of modern neural networks, ICML, 2017. Of n
    labels one more than was seen is taken to be wrong, so that a few cases that happen to be
    separable give no certainty (Platt, Probabilistic outputs for support vector machines, 1999).
    """
    z = scores - scores.mean(axis=1, keepdims=True)
    spread = float(np.abs(z).mean()) or 1.0
    doubt, every = 1.0 / (len(y) + 2), np.arange(len(y))

    def loss(log_sharpness: float) -> float:
        logs = scipy.special.log_softmax(z * (np.exp(log_sharpness) / spread), axis=1)
        return -float((1.0 - doubt) * logs[every, y].mean() + doubt * logs.mean())

    found = scipy.optimize.minimize_scalar(
        loss, bounds=np.log(_LIMITS), method="bounded", options={"xatol": 1e-6}
    )
    return float(spread / np.exp(found.x))


def _solved(residuals: Floats, right: Floats) -> Floats:
    """Solve S x = right with the shrunk covariance S of residuals: see `discriminant`."""
    n, d = residuals.shape
    gram = residuals @ residuals.T if d > n else residuals.T @ residuals
    squares = np.einsum("ij,ij->i", residuals, residuals)
    mean = float(squares.sum()) / (n * d)
    if mean == 0.0:
        return right
    # |R'R / n|^2 and the sum over features i, j of the mean of (r_i r_j)^2.
    product = float((gram**2).sum()) / n**2
    beta = (float((squares**2).sum()) / n - product) / n
    delta = product - d * mean**2
    share = 0.0 if beta <= 0.0 else (1.0 if beta >= delta else beta / delta)
    floor, scale = (share + _LEAST) * mean, (1.0 - share) / n
    if scale == 0.0:
        return np.asarray(right / floor)
    gram = gram * scale
    gram[np.diag_indices_from(gram)] += floor
    if d <= n:
        return np.asarray(np.linalg.solve(gram, right))
    # (c R'R + f I)^-1 = (I - c R' (f I + c R R')^-1 R) / f
    inner = np.linalg.solve(gram, residuals @ right)
    return np.asarray((right - scale * (residuals.T @ inner)) / floor)
