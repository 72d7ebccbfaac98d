"""Folds: what a fit says of cases that took no part in it."""

from __future__ import annotations

import numpy as np
import pytest
from classify_samples import TWO, curves

from modalmotion.classification import TrainingCase, TrainingOptions
from modalmotion.classification.model.domain import CHECKS
from modalmotion.classification.training.collection import collect
from modalmotion.classification.training.fold_fit import fit_rows, predict_fold
from modalmotion.signature.making import modal_signature
from modalmotion.simulate import simulate_cohort


def test_a_fold_predicts_its_outer_cases_and_says_what_it_chose() -> None:
    options = TrainingOptions(estimator="linear")
    table = collect(curves(4), options)
    inner, outer = np.arange(6), np.arange(6, 8)
    held_out = predict_fold(table, inner, outer, options)
    assert held_out.probabilities.shape == (2, 2)
    np.testing.assert_allclose(held_out.probabilities.sum(axis=1), 1.0)
    assert held_out.judgement.scores.shape == (2, len(CHECKS))
    known = {text.split(" of ")[0].split(",")[0] for text, _ in held_out.choices}
    assert known <= {"a few numbers", "modes", "modes and their terms", "pieces"}
    np.testing.assert_allclose(sum(weight for _, weight in held_out.choices), 1.0)


@pytest.mark.thorough
def test_the_volume_alone_leads_few_cases_and_is_read_linearly() -> None:
    options = TrainingOptions(modes=7)
    for seed in range(2):
        cohort = simulate_cohort(4, rng=np.random.default_rng(seed), classes=TWO)
        parameters = options.signature_parameters
        cases = [
            TrainingCase(modal_signature(case.sequence, parameters), str(case.label), str(k))
            for k, case in enumerate(cohort)
        ]
        fit = fit_rows(collect(cases, options), np.arange(len(cases)), options)
        (volume,) = [member for member in fit.members if not member.reader.reads_motion]
        assert volume is fit.members[0]
        assert volume.estimator.kind_ == "linear"
