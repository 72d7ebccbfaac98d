"""Covariates that a model knows, does not know, and misses."""

from __future__ import annotations

import numpy as np
from classify_samples import cohort, small_model

from modalmotion.classification import TrainingCase, TrainingOptions, classify, train
from modalmotion.classification.covariates import covariate_notes


def test_unknown_and_missing_covariates_are_named() -> None:
    assert covariate_notes(["sex", "age"], {"age": 61, "sex": "f", "site": "A"}) == ()
    assert covariate_notes(["sex", "age"], {"agee": 61}) == (
        "The model knows no covariate 'agee'; it reads age, sex.",
        "The model reads age, sex; not stated of this case: age, sex.",
    )
    many = {f"c{k}": 1.0 for k in range(9)}
    assert covariate_notes([], many) == (
        "The model knows no covariate 'c0', 'c1', 'c2', 'c3', 'c4' and 4 more; it reads none.",
    )


def test_answers_say_so() -> None:
    case = cohort(3)[0]
    notes = classify(case.motion, small_model(), covariates={"agee": 61}).notes
    assert "The model knows no covariate 'agee'; it reads none." in notes
    rng = np.random.default_rng(0)
    aged = [
        TrainingCase(
            one.motion,
            one.label,
            one.subject,
            covariates={"age": 20.0 + 50 * (one.label == "normal") + rng.normal()},
        )
        for one in cohort(6)
    ]
    model = train(aged, "aged", TrainingOptions(estimator="linear", repetitions=1, card="quick"))
    assert any(member.reader.covariates for member in model.members)
    assert (
        "The model reads age; not stated of this case: age." in classify(case.motion, model).notes
    )
    stated = classify(case.motion, model, covariates={"age": 61}).notes
    assert not any("covariate" in note or "age" in note.split() for note in stated)
