"""Two models on the same cases: paired, by subject, exact."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from classify_samples import curves, curves_model
from scipy.stats import binomtest

from modalmotion.classification import TrainingOptions, compare_models, evaluate, train
from modalmotion.classification.cases import LeftOut
from modalmotion.classification.evaluation import comparison_of
from modalmotion.errors import ParameterError
from modalmotion.representation import plain

QUICK = TrainingOptions(repetitions=1)


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
    assert plain(result)["accuracy"]["p"] == result.accuracy.p
    assert result.only_second > result.only_first


def test_a_case_that_one_model_does_not_know_is_left_out_of_both() -> None:
    cases = curves(5, seed=8)
    other = replace(cases[3], label="other", name="third.npz")
    wider = replace(curves_model(), classes=("back", "tip", "other"))
    pad = np.zeros((len(wider.centre), 1))
    wider = replace(
        wider,
        weights=np.hstack([wider.weights, pad]),
        intercepts=np.append(wider.intercepts, -50.0),
        shares=np.vstack([wider.shares, [-np.inf, np.inf]]),
        strangeness=(*wider.strangeness, np.zeros(0)),
    )
    left_out: list[LeftOut] = []
    result = compare_models(wider, curves_model(), [*cases, other], left_out=left_out)
    assert result.n_cases == len(cases)
    assert ["third.npz" in str(one) for one in left_out] == [True]


def test_differences_are_those_of_the_figures_and_p_of_mcnemar() -> None:
    mixed = [replace(c, label=("tip", "back")[n // 2 % 2]) for n, c in enumerate(curves(12))]
    blind = train(mixed, "blind", QUICK)
    cases = curves(10, seed=8)
    first, second = (evaluate(model, cases) for model in (blind, curves_model()))
    result = comparison_of(first, second)
    pairs = ((result.accuracy, "accuracy"), (result.log_loss, "log_loss"), (result.auc, "auc"))
    for figure, name in pairs:
        assert figure is not None
        expected = getattr(second, name) - getattr(first, name)
        assert figure.difference == pytest.approx(expected)
        assert figure.low <= figure.difference <= figure.high
    # Two recordings of each speaker, who counts once.
    rights = [np.array([c.answer == c.truth for c in one.cases], float) for one in (first, second)]
    gains = (rights[1] - rights[0]).reshape(10, 2).sum(axis=1)
    won, lost = int((gains > 0).sum()), int((gains < 0).sum())
    assert result.accuracy.p == pytest.approx(binomtest(won, won + lost).pvalue)


def test_other_cases_are_refused() -> None:
    first = evaluate(curves_model(), curves(3, seed=8))
    second = evaluate(curves_model(), curves(4, seed=8)[2:])
    with pytest.raises(ParameterError, match="different cases"):
        comparison_of(first, second)


def test_cases_of_the_training_are_named() -> None:
    result = evaluate(curves_model(), [*curves(2, seed=8), curves(12)[0]])
    assert "1 of the 5 cases are in the training set" in result.notes[0]
    table = result.as_csv().splitlines()
    assert table[0].startswith("case,sequence_id,subject,class,answer,")
    assert len(table) == 6


def test_cases_of_the_training_are_known_in_another_unit_too() -> None:
    case = curves(12)[0]
    bare = replace(case, motion=replace(case.motion, unit=None))
    assert "1 of the 1 cases are in the training set" in evaluate(curves_model(), [bare]).notes[0]
