"""Two models on the same cases: paired, by subject, exact."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from classify_samples import curves, curves_model
from scipy.stats import binomtest
from sklearn.metrics import roc_auc_score

from modalmotion.classification import TrainingOptions, compare_models, evaluate, train
from modalmotion.classification.evaluation.comparison import (
    _exchange_p,
    _resamples,
    _weighted_areas,
    comparison_of,
)
from modalmotion.errors import ParameterError

QUICK = TrainingOptions(estimator="linear", repetitions=1, card="quick")


@pytest.mark.thorough
def test_a_model_does_not_differ_from_itself() -> None:
    result = compare_models(curves_model(), curves_model(), curves(5, seed=8))
    for figure in (result.accuracy, result.auc, result.log_loss, result.brier):
        assert figure is not None
        assert figure.difference == figure.low == figure.high == 0.0
        assert figure.p == 1.0
    assert result.only_first == result.only_second == 0


def test_a_model_of_shuffled_labels_is_worse() -> None:
    # Half of each class under the other's name.
    mixed = [replace(c, label=("tip", "back")[n // 2 % 2]) for n, c in enumerate(curves(12))]
    blind = train(mixed, "blind", QUICK)
    result = compare_models(blind, curves_model(), curves(20, seed=8))
    assert result.accuracy.difference > 0.2
    assert result.accuracy.p < 0.01
    assert result.auc is not None
    assert result.auc.low > 0.0
    assert result.log_loss.high < 0.0
    assert result.as_json()["accuracy"]["p"] == result.accuracy.p
    assert result.only_second > result.only_first


def test_the_exact_p_is_that_of_mcnemar_and_counts_subjects_once() -> None:
    rng = np.random.default_rng(2)
    for n in (1, 7, 40):
        gains = rng.integers(-1, 2, n).astype(float)
        won, lost = int((gains > 0).sum()), int((gains < 0).sum())
        expected = binomtest(won, won + lost).pvalue if won + lost else 1.0
        assert _exchange_p(gains, [str(i) for i in range(n)]) == pytest.approx(expected)
    # Eight cases of one subject are one observation.
    assert _exchange_p(np.ones(8), ["one"] * 8) == 1.0
    # A slow twin: all signs of the subjects' sums.
    gains, subjects = np.array([1.0, 1, 1, -1, 1, 1, 0]), ["a", "a", "b", "b", "c", "d", "d"]
    sums = np.array([2.0, 0.0, 1.0, 1.0])
    signs = np.array(np.meshgrid(*[[-1, 1]] * 4)).reshape(4, -1)
    expected = np.mean(np.abs(sums @ signs) >= abs(gains.sum()))
    assert _exchange_p(gains, subjects) == pytest.approx(float(expected))


def test_resampled_areas_are_those_of_repeated_cases() -> None:
    rng = np.random.default_rng(3)
    scores, is_class = rng.integers(0, 5, 20).astype(float), np.arange(20) % 3 == 0
    weights = _resamples([str(i // 2) for i in range(20)])[:6]
    areas = _weighted_areas(scores, is_class, weights)
    for row, area in zip(weights.astype(int), areas, strict=True):
        drawn = np.repeat(np.arange(20), row)
        assert area == pytest.approx(roc_auc_score(is_class[drawn], scores[drawn]))


def test_other_cases_are_refused() -> None:
    first = evaluate(curves_model(), curves(3, seed=8))
    second = evaluate(curves_model(), curves(4, seed=8)[2:])
    with pytest.raises(ParameterError, match="different cases"):
        comparison_of(first, second)


def test_cases_of_the_training_are_named() -> None:
    result = evaluate(curves_model(), [*curves(2, seed=8), curves(12)[0]])
    assert "1 of the 5 cases were trained on" in result.notes[0]
    table = result.as_csv().splitlines()
    assert table[0].startswith("case,sequence_id,subject,class,answer,")
    assert len(table) == 6
