"""Limits that a share of new cases stays within."""

from __future__ import annotations

import numpy as np
import pytest
from classify_samples import curves_model

from modalmotion.classification.model.domain import CHECKS, OF_CLASS
from modalmotion.classification.training.domain_fit import with_limits
from modalmotion.classification.training.domain_limits import domain_limit, joint_limits


@pytest.mark.every(3)
@pytest.mark.parametrize("n", [8, 40, 1000])
@pytest.mark.parametrize("kind", ["normal", "exponential"])
def test_a_new_case_is_beyond_its_limit_as_rarely_as_requested(n: int, kind: str) -> None:
    rng = np.random.default_rng(n)
    draw = {"normal": rng.standard_normal, "exponential": rng.standard_exponential}[kind]
    sets = np.asarray(draw((3000, n + 1)), dtype=np.float64)
    beyond = np.mean([row[0] > domain_limit(row[1:], 0.98) for row in sets])
    # Two standard errors; few cases have to guess, and thin tails are beyond less often.
    assert beyond <= 0.02 + 2 * np.sqrt(0.02 / 3000) + (0.03 if n == 8 else 0.0)


def test_with_enough_cases_the_limit_is_one_of_them() -> None:
    scores = np.arange(1.0, 200.0, dtype=np.float64)
    assert domain_limit(scores, 0.995) == 199.0
    assert domain_limit(scores, 0.9) == 180.0
    assert domain_limit(scores[:100], 0.995) > 100.0


def test_all_checks_together_hold_the_share() -> None:
    rng = np.random.default_rng(5)
    own = rng.standard_normal((2000, 8))
    limits = joint_limits(own, 0.99, np.arange(2000))
    new = rng.standard_normal((20000, 8))
    assert (new > limits).any(axis=1).mean() == pytest.approx(0.01, abs=0.005)


def test_what_never_varies_is_not_checked_and_of_a_subject_one_case_counts() -> None:
    rng = np.random.default_rng(6)
    own = rng.standard_normal((300, 2))
    own[:, 1] = 7.0
    assert np.isinf(joint_limits(own, 0.99, np.arange(300))[1])
    again = np.concatenate([own, own, own])
    groups = np.tile(np.arange(300), 3)
    once = joint_limits(own, 0.99, np.arange(300))
    assert joint_limits(again, 0.99, groups) == pytest.approx(once)


def test_the_distance_from_the_class_has_a_limit_of_its_own() -> None:
    rng = np.random.default_rng(7)
    scores, groups = rng.standard_normal((2000, len(CHECKS))), np.arange(2000)
    found = with_limits(curves_model().domain, scores, np.zeros(2000), groups, 0.99).limits
    others = np.isfinite(found[:OF_CLASS])
    expected = joint_limits(scores[:, :OF_CLASS], 0.99, groups)
    assert found[:OF_CLASS][others] == pytest.approx(expected[others])
    assert others[:2].all()
    # A fifth of the cases that any limit takes: it counts only where the set is empty, too.
    assert found[OF_CLASS] == pytest.approx(domain_limit(scores[:, OF_CLASS], 0.998))
