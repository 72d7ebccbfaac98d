"""Folds: what a fit says of cases that took no part in it."""

from __future__ import annotations

import numpy as np
from classify_samples import curves

from modalmotion.classification import TrainingOptions
from modalmotion.classification.model.domain import CHECKS
from modalmotion.classification.training.fold_fit import predict_fold
from modalmotion.classification.training.table import collect


def test_a_fold_predicts_its_outer_cases_and_says_what_it_chose() -> None:
    options = TrainingOptions(estimator="linear")
    table = collect(curves(4), options)
    inner, outer = np.arange(6), np.arange(6, 8)
    held_out = predict_fold(table, inner, outer, options)
    assert held_out.probabilities.shape == (2, 2)
    np.testing.assert_allclose(held_out.probabilities.sum(axis=1), 1.0)
    assert held_out.judgement.scores.shape == (2, len(CHECKS))
    known = {text.split(" of ")[0].split(",")[0] for text, _ in held_out.choices}
    assert known <= {"a few numbers", "modes", "modes and their terms"}
    np.testing.assert_allclose(sum(weight for _, weight in held_out.choices), 1.0)
