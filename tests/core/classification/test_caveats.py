"""Confounds: found where they are, not where they are not, whole subjects exchanged."""

from __future__ import annotations

import numpy as np

from modalmotion.classification.caveats import _in_words, confound_notes, confounds


def test_a_site_of_one_class_is_reported_and_chance_is_not() -> None:
    rng = np.random.default_rng(1)
    y = np.arange(80) % 2
    conditions = [
        {
            "site": "north" if label else rng.choice(["north", "south"]),
            "frames": int(rng.integers(15, 40)),
            "age": float(rng.normal(60 + 20 * label, 5)),
            "device": "one",
        }
        for label in y
    ]
    tests = {test["name"]: test for test in confounds(conditions, y, np.arange(80), 0)}
    assert set(tests) == {"site", "frames", "age"}
    assert tests["age"]["p_holm"] < 0.01
    assert tests["site"]["p_holm"] < 0.01
    assert tests["frames"]["p_holm"] > 0.05
    assert tests["age"]["share"] > 0.8 > tests["age"]["chance"]
    notes = confound_notes(tuple(tests.values()))
    assert len(notes) == 2
    assert all("Possible confound" in note and "Holm" in note for note in notes)


def test_what_is_unknown_of_one_class_is_a_confound_too() -> None:
    y = np.arange(60) % 2
    conditions: list[dict[str, float | str]] = [{"age": 60.0} if k else {} for k in y]
    (test,) = confounds(conditions, y, np.arange(60), 0)
    assert test["p_holm"] < 0.01
    assert test["n_known"] == 30


def test_many_cases_of_few_subjects_prove_little() -> None:
    # Of six subjects, three a class, any number can tell them apart.
    y = np.repeat([0, 0, 0, 1, 1, 1], 20)
    groups = np.repeat(np.arange(6), 20)
    conditions = [{"height": float(170 + 5 * g)} for g in groups]
    (test,) = confounds(conditions, y, groups, 0)
    assert test["share"] == 1.0
    assert test["p"] > 0.05
    (alone,) = confounds(conditions, y, np.arange(120), 0)
    assert alone["p"] < 0.01


def test_where_subjects_have_all_classes_they_are_exchanged_within() -> None:
    rng = np.random.default_rng(2)
    groups, y = np.repeat(np.arange(10), 6), np.tile([0, 1, 0, 1, 0, 1], 10)
    conditions = [{"person": f"{g}", "session": f"{k}"} for g, k in zip(groups, y, strict=True)]
    tests = {test["name"]: test for test in confounds(conditions, y, groups, 0)}
    assert tests["session"]["p_holm"] < 0.01
    assert tests["person"]["p"] > 0.5
    order = rng.permutation(60)
    again = confounds([conditions[i] for i in order], y[order], groups[order], 0)
    assert {test["name"]: test["share"] for test in again} == {
        name: test["share"] for name, test in tests.items()
    }


def test_chance_is_reported_as_often_as_stated() -> None:
    rng = np.random.default_rng(3)
    y = np.arange(40) % 2
    n_sure = 0
    for _ in range(25):
        conditions = [{"a": float(v), "b": float(w)} for v, w in rng.normal(size=(40, 2))]
        n_sure += min(t["p_holm"] for t in confounds(conditions, y, np.arange(40), 0)) < 0.05
    assert n_sure <= 5


def test_a_small_difference_from_chance_is_still_read_from_the_text() -> None:
    rng = np.random.default_rng(4)
    y = np.arange(1000) % 5
    # One case in fifty is named by its class: the share is above chance in the third digit.
    named = [str(k) if rng.random() < 0.02 else "usual" for k in y]
    (test,) = confounds([{"site": site} for site in named], y, np.arange(1000), 0)
    gain = 100 * (test["share"] - test["chance"])
    assert 0.0 < gain < 5.0
    assert f"{100 * test['share']:.1f}%, {gain:.2g} points more than by chance" in test["text"]
    less = {**test, "share": test["chance"] - 0.0012}
    assert "0.12 points less than by chance" in _in_words(less)
