"""Shrunk discriminants: scikit-learn's on features scaled within classes, by far fewer steps."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import softmax
from sklearn.covariance import ledoit_wolf
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.feature_selection import f_classif

from modalmotion.classification.linear import (
    discriminant,
    inner_folds,
    log_losses,
    temperature_of,
)


def drawn(n: int, d: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    y = np.arange(n) % 3
    X = rng.normal(size=(n, d)) @ rng.normal(size=(d, d)) + rng.normal(size=(3, d))[y] + 5.0
    return X, y


@pytest.mark.parametrize(("n", "d"), [(60, 7), (30, 80)])
def test_scores_are_those_of_the_shrunk_covariance_and_shrunk_means(n: int, d: int) -> None:
    X, y = drawn(n, d)
    X[:, 2] = 4.0  # constant
    residuals = X - np.stack([X[y == k].mean(axis=0) for k in range(3)])[y]
    squares = ((n - 3) * residuals.var(axis=0) + 2 * X.var(axis=0)) / (n - 1)
    z = (X - X.mean(axis=0)) / np.where(squares > 1e-9, squares, np.inf) ** 0.5
    means = np.stack([z[y == k].mean(axis=0) for k in range(3)])
    S = ledoit_wolf(z - means[y], assume_centered=True)[0] + 1e-9 * np.eye(d)
    varies = np.arange(d) != 2
    means[:, varies] *= np.maximum(1.0 - 1.0 / f_classif(X[:, varies], y)[0], 0.0)
    solved = np.linalg.solve(S, means.T)
    shares = np.log(np.bincount(y) / n) - 0.5 * np.einsum("kd,dk->k", means, solved)
    expected = z @ solved + shares
    found = discriminant(X, y, 3).scores(X)
    assert softmax(found, axis=1) == pytest.approx(softmax(expected, axis=1), abs=1e-5)


def test_few_cases_are_told_apart_by_one_feature_among_many_that_mean_nothing() -> None:
    rng, right = np.random.default_rng(7), []
    for _ in range(20):
        X, y = rng.normal(size=(56, 40)), np.arange(56) % 2
        X[:, 11] += 8.0 * y
        scores = discriminant(X[:16], y[:16], 2).scores(X[16:])
        right.append((scores.argmax(axis=1) == y[16:]).mean())
    assert np.mean(right) > 0.98


def test_labels_by_chance_give_scores_nearer_to_the_shares_of_the_classes() -> None:
    rng = np.random.default_rng(8)
    X, y = rng.normal(size=(400, 30)), np.arange(400) % 4 % 3
    scores = discriminant(X, y, 3).scores(X)
    theirs = LinearDiscriminantAnalysis(solver="lsqr").fit(X, y).predict_log_proba(X)
    spread, of_theirs = (
        np.ptp(s - s.mean(axis=1, keepdims=True), axis=0) for s in (scores, theirs)
    )
    assert (spread < 0.75 * of_theirs).all()
    # A class is as probable as it is frequent.
    assert softmax(scores, axis=1).mean(axis=0) == pytest.approx(np.bincount(y) / 400, abs=0.02)


def test_a_feature_that_never_varies_within_a_class_still_counts() -> None:
    X, y = drawn(30, 5)
    X[:, 1] = y
    assert (discriminant(X, y, 3).scores(X).argmax(axis=1) == y).all()


def test_where_nothing_need_be_shrunk_it_is_that_of_scikit_learn() -> None:
    X, y = drawn(3000, 4)
    theirs = LinearDiscriminantAnalysis(solver="lsqr").fit(X, y).predict_proba(X)
    assert softmax(discriminant(X, y, 3).scores(X), axis=1) == pytest.approx(theirs, abs=0.05)


def test_a_temperature_makes_labels_most_likely_and_few_cases_give_no_certainty() -> None:
    rng = np.random.default_rng(4)
    scores = rng.normal(size=(4000, 3))
    y = np.array([rng.choice(3, p=share) for share in softmax(scores, axis=1)])
    assert temperature_of(5.0 * scores, y) == pytest.approx(5.0, rel=0.1)
    separable = np.eye(2)[np.arange(8) % 2]
    T = temperature_of(separable, np.arange(8) % 2)
    assert 0.8 < softmax(separable / T, axis=1).max() < 0.99


def test_groups_stay_together_and_a_class_of_one_group_is_parted() -> None:
    y, groups = np.repeat([0, 1, 2], 8), np.repeat(np.arange(12), 2)
    for train, test in inner_folds(y, groups):
        assert not set(groups[train]) & set(groups[test])
    groups[y == 2] = 50
    for train, _ in inner_folds(y, groups):
        assert set(y[train]) == {0, 1, 2}


def test_losses_are_those_of_the_shares() -> None:
    X, y = drawn(30, 5)
    scores = discriminant(X, y, 3).scores(X)
    assert log_losses(scores, y) == pytest.approx(
        -np.log(softmax(scores, axis=1)[np.arange(30), y])
    )
