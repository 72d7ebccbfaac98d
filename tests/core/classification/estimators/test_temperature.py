"""Temperatures, beside a search by scipy."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.special import log_softmax
from sklearn.metrics import log_loss

from modalmotion.classification.estimators.temperature import (
    case_losses,
    fit_temperatures,
    log_losses,
    softmax,
)


def searched(
    scores: NDArray[np.float64],
    y: NDArray[np.int64],
    weights: NDArray[np.float64] | None,
    size: float,
) -> float:
    """Temperature near a size, by a search."""
    # One label more than was seen is spread over all classes.
    doubt = 1.0 / (len(y) + 2)

    def loss(t: float) -> float:
        logs = log_softmax(scores / np.exp(t), axis=1)
        losses = (1.0 - doubt) * logs[np.arange(len(y)), y] + doubt * logs.mean(axis=1)
        return -float(np.average(losses, weights=weights))

    result = minimize_scalar(
        loss,
        bounds=(np.log(size) - 6, np.log(size) + 6),
        method="bounded",
        options={"xatol": 1e-9},
    )
    return float(np.exp(result.x))


def test_newton_finds_what_a_search_finds(rng: np.random.Generator) -> None:
    sizes = np.array([1e-3, 0.1, 1.0, 10.0, 1e4])
    y = rng.integers(0, 3, 60)
    scores = rng.normal(size=(5, 60, 3))
    scores[:, np.arange(60), y] += 1.0
    scores *= sizes[:, None, None]
    weights = rng.uniform(0.5, 2.0, 60)
    for w in (None, weights):
        found = fit_temperatures(scores, y, w)
        for k, size in enumerate(sizes):
            assert found[k] == pytest.approx(searched(scores[k], y, w, size), rel=1e-5)


def test_scores_that_say_nothing_or_the_opposite_have_a_temperature() -> None:
    y = np.array([0, 1, 0, 1])
    scores = np.stack([np.zeros((4, 2)), -np.eye(2)[y], np.eye(2)[y]])
    flat, opposite, right = fit_temperatures(scores, y)
    assert np.isfinite([flat, opposite, right]).all()
    # The opposite is as flat as the limit allows.
    assert opposite > 5.0 > right > 0.0


def test_losses_are_those_of_scikit_learn(rng: np.random.Generator) -> None:
    scores, y = 3.0 * rng.normal(size=(4, 30, 3)), rng.integers(0, 3, 30)
    weights = rng.uniform(0.5, 2.0, 30)
    for w in (None, weights):
        expected = [log_loss(y, softmax(one), sample_weight=w) for one in scores]
        assert log_losses(scores, y, w) == pytest.approx(expected)
    assert case_losses(scores[0], y).mean() == pytest.approx(log_losses(scores[:1], y)[0])
