"""Scorers side by side answer as each by itself."""

from __future__ import annotations

import numpy as np
import pytest

from modalmotion.classification.estimators import pool
from modalmotion.classification.estimators.pool import pool_of
from modalmotion.classification.estimators.scorer import Blend, Scorer, log_sums, pooled
from modalmotion.classification.estimators.temperature import softmax

N_CLASSES = 3
WEIGHTS = (0.5, 0.3, 0.2)

# Features by name: the same name has the same values in each blend.
NAMES = (tuple("abcdef"), tuple("cabdg"), ("x", "y"))


def blend_of(
    names: tuple[str, ...],
    kinds: str,
    rng: np.random.Generator,
    columns: dict[str, np.ndarray],
) -> Blend:
    d = len(names)
    scorers = []
    for kind in kinds:
        anchors = np.stack([columns[name] for name in names], axis=1) if kind == "k" else None
        n = d if anchors is None else len(anchors)
        scorers.append(
            Scorer(
                np.zeros((0, d)) if anchors is None else anchors,
                0.0 if anchors is None else float(rng.uniform(0.1, 1.0)) / d,
                rng.normal(size=(n, N_CLASSES)),
                rng.normal(size=N_CLASSES),
                float(rng.uniform(0.5, 2.0)),
            )
        )
    # Standards are those of the feature, whoever reads it.
    centre = np.array([len(name) + ord(name[0]) / 100.0 for name in names])
    return Blend(centre, 1.0 + centre / 10.0, tuple(scorers), float(rng.uniform(0.5, 2.0)))


def from_sum(logs: np.ndarray) -> np.ndarray:
    """Logarithms are known up to a constant."""
    return logs - log_sums(logs)


def features_of(values: dict[str, np.ndarray]) -> np.ndarray:
    return np.stack([values[name] for names in NAMES for name in names], axis=1)


@pytest.mark.parametrize("kinds", [("lk", "lk", "lk"), ("k", "l", "lk"), ("l", "k", "k")])
@pytest.mark.parametrize("same_anchors", [True, False])
def test_they_answer_as_the_pool_of_each_by_itself(
    kinds: tuple[str, ...],
    same_anchors: bool,
    rng: np.random.Generator,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    names = {name for own in NAMES for name in own}
    shared = {name: rng.normal(size=8) for name in names}
    blends = [
        blend_of(
            own,
            kind,
            rng,
            shared if same_anchors else {name: rng.normal(size=8) for name in names},
        )
        for own, kind in zip(NAMES, kinds, strict=True)
    ]
    side_by_side = pool_of(blends, WEIGHTS, NAMES)
    # Two blends have most of their features in common.
    n_kernels = sum("k" in kind for kind in kinds[:2])
    assert len(side_by_side.families) == (2 if same_anchors or n_kernels < 2 else 3)
    values = {name: rng.normal(size=12) for name in names}
    X = features_of(values)
    ends = np.cumsum([len(own) for own in NAMES])[:-1]
    parts = np.split(X, ends, axis=1)
    expected = from_sum(
        pooled([blend.log_shares(part) for blend, part in zip(blends, parts, strict=True)], WEIGHTS)
    )
    found = side_by_side.log_shares(X)
    # What a blend rules out differs by the rounding of a probability.
    assert softmax(found) == pytest.approx(softmax(expected), abs=1e-9)
    assert from_sum(found) == pytest.approx(expected, rel=1e-4)
    for k in range(len(X)):
        assert side_by_side.log_shares(X[k : k + 1])[0] == pytest.approx(found[k], rel=1e-9)
    monkeypatch.setattr(pool, "_MOST_VALUES", 1)
    assert side_by_side.log_shares(X) == pytest.approx(found, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("temperature", [0.2, 0.9, 1.0, 1.04, 3.0])
def test_what_one_rules_out_others_may_hold_possible(
    temperature: float, rng: np.random.Generator
) -> None:
    columns = {name: rng.normal(size=8) for name in "ab"}
    sure, other = (blend_of(tuple("ab"), "l", rng, columns) for _ in range(2))
    sure = Blend(sure.centre, sure.scale, sure.scorers, temperature)
    X = np.repeat(300.0 * rng.normal(size=(40, 2)), 2, axis=0).reshape(40, 4)
    X[:, 2:] = X[:, :2] / 300.0
    weights = [0.4, 0.6]
    expected = pooled([sure.log_shares(X[:, :2]), other.log_shares(X[:, 2:])], weights)
    found = pool_of([sure, other], weights, [tuple("ab"), tuple("cd")]).log_shares(X)
    assert softmax(found) == pytest.approx(softmax(expected), abs=1e-4)
    assert np.ptp(found, axis=1).max() < 40.0


def test_one_blend_alone_is_itself(rng: np.random.Generator) -> None:
    columns = {name: rng.normal(size=8) for name in "abc"}
    blend = blend_of(tuple("abc"), "lk", rng, columns)
    X = rng.normal(size=(5, 3))
    found = pool_of([blend], [1.0], [tuple("abc")]).log_shares(X)
    assert found == pytest.approx(blend.log_shares(X), rel=1e-9, abs=1e-12)


def test_features_of_other_standards_are_other_features(rng: np.random.Generator) -> None:
    columns = {name: rng.normal(size=8) for name in "ab"}
    one, other = (blend_of(tuple("ab"), "l", rng, columns) for _ in range(2))
    moved = Blend(other.centre + 1.0, other.scale, other.scorers, other.temperature)
    X = np.repeat(rng.normal(size=(5, 2)), 2, axis=0).reshape(5, 4)
    X[:, 2:] = X[:, :2]
    for second, n_families in ((other, 1), (moved, 2)):
        pair = pool_of([one, second], [0.5, 0.5], [tuple("ab")] * 2)
        assert len(pair.families) == n_families
        expected = pooled([one.log_shares(X[:, :2]), second.log_shares(X[:, 2:])], [0.5, 0.5])
        assert from_sum(pair.log_shares(X)) == pytest.approx(
            from_sum(expected), rel=1e-9, abs=1e-12
        )


def test_a_kernel_without_width_is_one_everywhere(rng: np.random.Generator) -> None:
    scorer = Scorer(rng.normal(size=(4, 2)), 0.0, rng.normal(size=(4, 3)), rng.normal(size=3), 1.0)
    blend = Blend(np.zeros(2), np.ones(2), (scorer,), 1.0)
    X = rng.normal(size=(5, 2))
    found = pool_of([blend], [1.0], [("a", "b")]).log_shares(X)
    assert found == pytest.approx(blend.log_shares(X), rel=1e-12)
