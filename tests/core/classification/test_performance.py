"""Figures of answers: the same as elsewhere, and intervals that hold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import softmax
from scipy.stats import binomtest
from sklearn.metrics import brier_score_loss, log_loss, roc_auc_score, roc_curve

from modalmotion.classification.performance import (
    Answers,
    auc,
    auc_interval,
    calibration_curve,
    calibration_error,
    design_effect,
    loss_interval,
    performance,
    share_interval,
)
from modalmotion.classification.performance import roc_curve as our_roc_curve

CLASSES = ("a", "b", "c")


def answers(n: int = 60, seed: int = 1, repetitions: int = 1, per_subject: int = 1) -> Answers:
    rng = np.random.default_rng(seed)
    y = np.arange(n) % 3
    scores = rng.normal(size=(repetitions, n, 3)) + 1.2 * np.eye(3)[y]
    shares = np.stack([np.round(softmax(each, axis=1), 2) for each in scores])
    shares /= shares.sum(axis=2, keepdims=True)
    subjects = [str(i // per_subject) for i in range(n)]
    return Answers(CLASSES, y, subjects, shares, shares.argmax(axis=2))


def test_figures_are_those_of_scikit_learn() -> None:
    given = answers()
    y, shares = given.y, given.probabilities[0]
    result = performance(given)
    assert result.auc == pytest.approx(roc_auc_score(y, shares, multi_class="ovr"))
    assert result.log_loss == pytest.approx(log_loss(y, shares))
    by_class = [brier_score_loss(y == k, shares[:, k]) for k in range(3)]
    assert result.brier == pytest.approx(sum(by_class))
    for k, label in enumerate(CLASSES):
        area = roc_auc_score(y == k, shares[:, k])
        assert result.class_auc[label][0] == pytest.approx(area)
        x, up, _ = roc_curve(y == k, shares[:, k], drop_intermediate=False)
        ours = np.array(our_roc_curve(shares[:, k], y == k))
        np.testing.assert_allclose(ours, np.stack([x, up], axis=1), atol=1e-6)
        hit = given.labels[0] == k
        assert result.sensitivity[label][0] == pytest.approx(hit[y == k].mean())
        assert result.specificity[label][0] == pytest.approx(1 - hit[y != k].mean())
    assert result.balanced_accuracy == pytest.approx(
        np.mean([v for v, _, _ in result.sensitivity.values()])
    )


def test_of_repetitions_the_figures_are_means_and_the_confusion_is_the_sum() -> None:
    given = answers(repetitions=3)
    whole = performance(given)
    alone = [
        performance(replace(given, probabilities=shares[None], labels=labels[None]))
        for shares, labels in zip(given.probabilities, given.labels, strict=True)
    ]
    for name in ("accuracy", "auc", "log_loss", "brier", "calibration_error"):
        figures = [getattr(each, name) for each in alone]
        assert getattr(whole, name) == pytest.approx(np.mean(figures))
    assert sum(map(sum, whole.confusion)) == 3 * len(given.y)
    trace = sum(whole.confusion[k][k] for k in range(3))
    assert whole.accuracy == pytest.approx(trace / (3 * len(given.y)))
    # The same cases again are no further evidence.
    twice = Answers(
        given.classes,
        given.y,
        given.subjects,
        np.repeat(given.probabilities[:1], 2, axis=0),
        np.repeat(given.labels[:1], 2, axis=0),
    )
    once = Answers(
        given.classes, given.y, given.subjects, given.probabilities[:1], given.labels[:1]
    )
    assert performance(twice).accuracy_interval == performance(once).accuracy_interval
    assert performance(twice).auc_interval == pytest.approx(performance(once).auc_interval)


def test_an_abstention_is_wrong_and_no_class() -> None:
    given = answers()
    labels = given.labels.copy()
    labels[0, :6] = -1
    result = performance(
        Answers(CLASSES, given.y, given.subjects, given.probabilities, labels), abstains=True
    )
    assert [row[-1] for row in result.confusion] == [2, 2, 2]
    assert result.accuracy == pytest.approx((labels[0] == given.y).mean())


def test_cases_of_one_subject_widen_every_interval() -> None:
    rng = np.random.default_rng(2)
    y = np.repeat(np.arange(20) % 2, 5)
    of_subject = np.repeat(rng.normal(size=20) + 0.5 * (np.arange(20) % 2), 5)
    shares = 1 / (1 + np.exp(-of_subject + 0.25))
    both = np.stack([1 - shares, shares], axis=1)[None]
    labels = both.argmax(axis=2)

    def of(subjects: list[str]) -> dict[str, float]:
        result = performance(Answers(("a", "b"), y, subjects, both, labels))
        ends = {
            "accuracy": result.accuracy_interval,
            "auc": result.auc_interval,
            "log_loss": result.log_loss_interval,
            "brier": result.brier_interval,
            "sensitivity": result.sensitivity["a"][1:],
        }
        return {name: end[1] - end[0] for name, end in ends.items() if end is not None}

    apart = of([str(i) for i in range(100)])
    together = of([str(i // 5) for i in range(100)])
    assert set(apart) == set(together)
    for name, width in apart.items():
        assert together[name] > 1.3 * width, name


def test_no_interval_of_losses_leaves_their_range() -> None:
    y = np.array([0, 0, 1, 1])
    shares = np.array([[[1.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 0.0]]])
    result = performance(Answers(("a", "b"), y, list("abcd"), shares, shares.argmax(axis=2)))
    assert result.brier == 1.5
    assert result.brier_interval is not None
    assert result.brier_interval[1] == 2.0
    assert result.log_loss_interval is not None
    assert result.log_loss_interval[0] >= 0.0


def test_a_perfect_area_has_a_width_and_one_class_has_no_area() -> None:
    scores = np.arange(20.0).astype(np.float64)
    is_class = np.arange(20) >= 10
    area = auc(scores, is_class)
    assert area is not None
    low, high = auc_interval(area.value, area.influences, [(10, 10)], list("abcdefghijklmnopqrst"))
    assert area.value == high == 1.0
    assert 0.6 < low < 0.95


def test_influences_are_what_each_case_adds() -> None:
    rng = np.random.default_rng(3)
    scores, is_class = rng.integers(0, 6, 30).astype(float), rng.random(30) < 0.4
    area = auc(scores, is_class)
    assert area is not None
    # A slow twin: all pairs.
    a, b = scores[is_class][:, None], scores[~is_class][None]
    wins = (a > b) + 0.5 * (a == b)
    assert area.value == pytest.approx(wins.mean())
    np.testing.assert_allclose(
        area.influences[is_class], (wins.mean(axis=1) - wins.mean()) / len(a)
    )
    np.testing.assert_allclose(
        area.influences[~is_class], (wins.mean(axis=0) - wins.mean()) / b.size
    )


def _covers(draw: int, kind: str) -> bool:
    """Whether the interval of one draw of clustered cases holds the truth."""
    rng = np.random.default_rng([draw, 7])
    of_subject = np.repeat(rng.normal(size=40), 3)
    is_class = np.repeat(np.arange(40) % 2 == 0, 3)
    scores = of_subject + 0.5 * rng.normal(size=120) + 1.5 * is_class
    subjects = [str(i // 3) for i in range(120)]
    if kind == "auc":
        area = auc(scores, is_class)
        assert area is not None
        low, high = auc_interval(area.value, area.influences, [(60, 60)], subjects)
        truth = 0.8286  # Phi(1.5 / sqrt(2 (1 + 0.25)))
    elif kind == "share":
        low, high = share_interval(scores > 0, subjects)
        truth = 0.7051  # Mean of Phi(m / sqrt(1.25)) of m = 0 and 1.5
    else:
        interval = loss_interval(scores**2, subjects)
        assert interval is not None
        low, high = interval
        truth = 1.25 + 1.5**2 / 2
    return low <= truth <= high


@pytest.mark.parametrize("kind", ["auc", "share", "loss"])
def test_intervals_of_clustered_cases_hold_the_truth(kind: str) -> None:
    covered = np.mean([_covers(draw, kind) for draw in range(200)])
    assert 0.88 <= covered <= 1.0


@pytest.mark.parametrize("n_right", [0, 1, 8, 10])
def test_the_interval_of_a_share_is_that_of_scipy(n_right: int) -> None:
    subjects = [str(i) for i in range(10)]
    theirs = binomtest(n_right, 10).proportion_ci(method="wilson")
    ours = share_interval(np.arange(10) < n_right, subjects)
    assert ours == pytest.approx((theirs.low, theirs.high), abs=1e-12)


def test_the_design_effect_is_one_for_independent_cases_and_the_size_for_copies() -> None:
    values = np.random.default_rng(4).normal(size=300)
    assert design_effect(values - values.mean(), [str(i) for i in range(300)]) == 1.0
    copies = np.repeat(values[:100], 3)
    effect = design_effect(copies - copies.mean(), [str(i // 3) for i in range(300)])
    assert effect == pytest.approx(3.0, rel=0.02)


def test_bins_hold_equal_numbers_and_the_error_is_their_distance() -> None:
    rng = np.random.default_rng(5)
    confidence: NDArray[np.float64] = 0.5 + 0.5 * rng.random(1003) ** 0.2
    curve = calibration_curve(confidence, rng.random(1003) < confidence)
    assert {count for _, _, count in curve} == {100, 101}
    assert sum(count for _, _, count in curve) == 1003
    assert calibration_error(curve) < 0.05
    assert calibration_error(calibration_curve(confidence, np.ones(1003, dtype=bool))) == (
        pytest.approx(1 - confidence.mean(), abs=1e-5)
    )
    # Few cases in few bins.
    assert len(calibration_curve(confidence[:12], np.ones(12, dtype=bool))) == 2
