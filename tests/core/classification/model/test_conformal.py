"""Class sets hold the true class as often as asked for; probabilities are shares."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from sklearn.utils.estimator_checks import parametrize_with_checks

from modalmotion.classification.estimators.estimator import MotionClassifier
from modalmotion.classification.estimators.ridge import kernel_ridge, ridge, targets
from modalmotion.classification.estimators.temperature import fit_temperature, softmax
from modalmotion.classification.measures.intervals import share_interval
from modalmotion.classification.measures.reliability import calibration_curve, calibration_error
from modalmotion.classification.model.conformal import Calibration, calibrate


@pytest.mark.every(4)
@parametrize_with_checks([MotionClassifier()])  # type: ignore[untyped-decorator]
def test_the_estimator_is_scikit_learns(estimator: MotionClassifier, check: object) -> None:
    check(estimator)  # type: ignore[operator]


@pytest.mark.parametrize(
    ("n", "coverage", "always"),
    [
        (8, 0.9, True),
        (9, 0.9, False),
        (18, 0.95, True),
        (19, 0.95, False),
        (98, 0.99, True),
        (99, 0.99, False),
        (0, 0.5, True),
    ],
)
def test_too_few_cases_hold_a_class_always(n: int, coverage: float, always: bool) -> None:
    calibration = Calibration((np.zeros(n), np.zeros(1000)))
    kept = calibration.holds(np.array([[0.0, 1.0]]), coverage)
    assert kept[0, 0] == always
    assert (0 in calibration.too_few(coverage)) == always


def draw(rng: np.random.Generator, n: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    y = rng.integers(0, 3, n)
    shares = softmax(rng.standard_normal((n, 3)) + 1.5 * np.eye(3)[y])
    return shares, y


@pytest.mark.parametrize("coverage", [0.8, 0.9, 0.95])
def test_sets_hold_each_class_as_often_as_asked(coverage: float) -> None:
    rng = np.random.default_rng(1)
    p, y = draw(rng, 6000)
    q, z = draw(rng, 6000)
    kept = calibrate(p, y, 3).holds(q, coverage)
    for k in range(3):
        share = kept[z == k, k].mean()
        assert share == pytest.approx(coverage, abs=4 * np.sqrt(0.25 / 2000) * 1.5)


@pytest.mark.filterwarnings("ignore:WARNING. your conformalization:UserWarning")
def test_sets_are_those_of_mapie() -> None:
    from mapie.classification import SplitConformalClassifier

    rng = np.random.default_rng(2)
    p, y = draw(rng, 400)
    q, _ = draw(rng, 300)

    class Given(MotionClassifier):
        def predict_proba(self, X: NDArray[np.float64]) -> NDArray[np.float64]:
            return X

        def predict(self, X: NDArray[np.float64]) -> NDArray[np.int64]:
            return np.asarray(X.argmax(axis=1))

    known = Given().fit(p, y)
    for k in range(3):
        # Class by class: calibrated on the cases of one class, asked for that class only.
        oracle = SplitConformalClassifier(
            known, confidence_level=0.9, conformity_score="lac", prefit=True
        )
        oracle.conformalize(p[y == k], y[y == k])
        expected = oracle.predict_set(q)[1][:, k, 0]
        assert np.array_equal(calibrate(p, y, 3).holds(q, 0.9)[:, k], expected)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n_groups=st.integers(3, 12))
def test_leaving_a_group_out_is_fitting_without_it(seed: int, n_groups: int) -> None:
    rng = np.random.default_rng(seed)
    X, y = rng.standard_normal((24, 4)), rng.integers(0, 2, 24)
    weights, groups = rng.uniform(0.5, 2.0, 24), np.arange(24) % n_groups
    fast = ridge(X, targets(y, 2, weights, groups)).held_out(np.array([0.7]))[0]
    for g in range(n_groups):
        out = groups == g
        others = targets(y[~out], 2, weights[~out], np.arange((~out).sum()))
        W = ridge(X[~out], others).weights(0.7)
        slow = np.c_[X[out], np.full(out.sum(), 10.0)] @ W
        assert fast[out] == pytest.approx(slow, abs=1e-8)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n_groups=st.integers(3, 24))
def test_a_regression_on_kernels_is_one_on_their_features(seed: int, n_groups: int) -> None:
    rng = np.random.default_rng(seed)
    X, y = rng.standard_normal((24, 4)), rng.integers(0, 3, 24)
    weights, groups = rng.uniform(0.5, 2.0, 24), np.arange(24) % n_groups
    new = rng.standard_normal((5, 4))
    wanted = targets(y, 3, weights, groups)
    slow, fast = ridge(X, wanted), kernel_ridge(X @ X.T, wanted)
    penalties = np.array([0.7, 7.0])
    together = fast.held_out(penalties)
    assert together == pytest.approx(slow.held_out(penalties), abs=1e-8)
    one_by_one = np.concatenate([fast.held_out(penalties[k : k + 1]) for k in range(2)])
    assert together == pytest.approx(one_by_one, abs=1e-12)
    V, W = fast.weights(0.7), slow.weights(0.7)
    # Features and kernels of new cases, the constant beside both.
    expected = np.c_[new, np.full(5, 10.0)] @ W
    assert np.c_[new @ X.T, np.full(5, 10.0)] @ V == pytest.approx(expected, abs=1e-8)


def test_a_temperature_makes_scores_reliable() -> None:
    rng = np.random.default_rng(4)
    y = rng.integers(0, 2, 20_000)
    true = softmax(np.stack([np.zeros(len(y)), rng.standard_normal(len(y)) * 2], axis=1))
    y = (rng.uniform(size=len(y)) < true[:, 1]).astype(np.int64)
    scores = 7.0 * np.log(true)
    assert fit_temperature(scores, y) == pytest.approx(7.0, rel=0.05)
    shares = softmax(scores / 7.0)
    curve = calibration_curve(shares.max(axis=1), shares.argmax(axis=1) == y)
    assert calibration_error(curve) < 0.02
    sure = calibration_curve(softmax(scores).max(axis=1), shares.argmax(axis=1) == y)
    assert calibration_error(sure) > 0.1


def test_few_cases_that_are_told_apart_give_no_certainty() -> None:
    y = np.array([0, 1] * 5)
    scores = np.eye(2)[y]
    shares = softmax(scores / fit_temperature(scores, y))
    assert 0.85 < shares.max() < 0.99


def test_cases_of_one_subject_count_as_fewer() -> None:
    right = np.repeat([True, True, True, False], 10)
    alone = share_interval(right, [str(i) for i in range(40)])
    together = share_interval(right, [str(i // 10) for i in range(40)])
    assert alone == pytest.approx((0.5981, 0.8581), abs=1e-3)  # Wilson, 30 of 40
    assert together[1] - together[0] > 2 * (alone[1] - alone[0])


def test_constant_features_say_nothing() -> None:
    rng = np.random.default_rng(5)
    y = np.arange(40) % 2
    X = np.c_[rng.standard_normal(40) + 2 * y, np.full(40, 7.0)]
    model = MotionClassifier().fit(X, y)
    moved = X + np.array([0.0, 1e6])
    assert np.array_equal(model.predict_proba(X), model.predict_proba(moved))
