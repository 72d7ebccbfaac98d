"""Weights of choices, and the pool of their predictions."""

from __future__ import annotations

import numpy as np
import pytest

from modalmotion.classification.estimators.choice_weights import choice_weights
from modalmotion.classification.estimators.scorer import pooled
from modalmotion.classification.estimators.temperature import softmax

EVEN = np.full(3, 1.0 / 3.0)


def losses_of(rng: np.random.Generator, n: int) -> np.ndarray:
    """One good choice, one that differs from it by chance, one that is bad."""
    good = rng.gamma(2.0, 0.2, n)
    return np.stack([good, good + rng.normal(0.0, 0.05, n), good + 1.0])


def test_a_bad_choice_has_no_weight_and_equals_share_theirs(rng: np.random.Generator) -> None:
    weights = choice_weights(losses_of(rng, 60), EVEN, np.arange(60), 0)
    assert weights.sum() == pytest.approx(1.0)
    assert weights[2] < 1e-6
    assert weights[:2].min() > 0.2


def test_where_cases_say_nothing_the_prior_stands() -> None:
    prior = np.array([0.7, 0.2, 0.1])
    weights = choice_weights(np.ones((3, 8)), prior, np.arange(8), 0)
    assert weights == pytest.approx(prior)


def test_cases_of_one_subject_speak_as_one(rng: np.random.Generator) -> None:
    losses = losses_of(rng, 40)
    losses[2] = losses[0] + 0.3
    apart = choice_weights(losses, EVEN, np.arange(40), 0)
    together = choice_weights(losses, EVEN, np.arange(40) % 2, 0)
    # Two subjects may both be odd: the draws differ more, and the better choice is less sure.
    assert together[2] > apart[2]


def test_few_groups_say_less_than_their_number() -> None:
    """The same gain in all: eight groups are believed less than an eighth of sixty-four."""

    def lead(n: int) -> float:
        losses = np.stack([np.full(n, 0.5), np.full(n, 0.5 + 4.0 / n)])
        weights = choice_weights(losses, np.array([0.5, 0.5]), np.arange(n), 0)
        return float(np.log(weights[0] / weights[1]))

    # Losses that differ by 4 in all, at a power of 1/2 from 64 groups on.
    assert lead(64) == pytest.approx(2.0)
    assert lead(640) == pytest.approx(2.0)
    assert lead(16) == pytest.approx(1.0)


def test_the_weights_are_the_same_each_time(rng: np.random.Generator) -> None:
    losses = losses_of(rng, 20)
    first, again = (choice_weights(losses, EVEN, np.arange(20), 5) for _ in range(2))
    assert np.array_equal(first, again)


def test_a_pool_is_the_weighted_geometric_mean() -> None:
    shares = [np.array([[0.5, 0.3, 0.2]]), np.array([[0.1, 0.8, 0.1]])]
    weights = [0.25, 0.75]
    # Constants of the logs play no part.
    logs = [np.log(share) + shift for share, shift in zip(shares, (5.0, -3.0), strict=True)]
    product = shares[0] ** 0.25 * shares[1] ** 0.75
    assert softmax(pooled(logs, weights)) == pytest.approx(product / product.sum())


def test_nobody_has_a_veto() -> None:
    sure = np.array([[0.0, -1e9]])
    unsure = np.log(np.array([[0.01, 0.99]]))
    assert np.isfinite(pooled([sure, unsure], [0.5, 0.5])).all()
    # 1e-12 is the least that a member can say: e-27.6.
    assert softmax(pooled([sure, unsure], [0.1, 0.9]))[0, 1] > 0.5
