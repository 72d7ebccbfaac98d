from __future__ import annotations

import json
from typing import Any

import pytest
from facts_samples import FACTS
from hypothesis import given

from modalmotion import Facts, ParameterError
from modalmotion.mesh import NAMES, NO_FACTS, facts_as_json, facts_from_json, facts_patched
from modalmotion.mesh.fact_forms import LONGEST_TEXT, read_object


@given(FACTS)
def test_facts_come_back_from_json(facts: Facts) -> None:
    shown = facts_as_json(facts)
    assert tuple(shown) == NAMES
    assert facts_from_json(json.loads(json.dumps(shown))) == facts


def test_all_facts_are_shown_where_none_is_stated() -> None:
    assert facts_as_json(NO_FACTS) == {
        "tracking": "unknown",
        "handedness": "unknown",
        "coordinates": "unknown",
        "period": None,
        "cavity": "unknown",
        "modality": None,
        "landmarks": {},
        "covariates": {},
    }


@given(FACTS)
def test_a_patch_of_nothing_changes_nothing_and_null_resets(facts: Facts) -> None:
    assert facts_patched(facts, {}) == facts
    assert facts_patched(facts, dict.fromkeys(NAMES)) == NO_FACTS


@given(FACTS, FACTS)
def test_a_patch_leaves_what_it_does_not_name(facts: Facts, other: Facts) -> None:
    change = {name: facts_as_json(other)[name] for name in ("period", "cavity", "modality")}
    changed = facts_patched(facts, change)
    assert set(changed.changed(facts)) <= {"period", "cavity", "modality"}
    assert (changed.period, changed.cavity) == (other.period, other.cavity)


def test_covariates_and_landmarks_are_patched_by_name() -> None:
    facts = Facts(landmarks={"apex": 1}, covariates={"age": 61, "sex": "f"})
    changes = {"landmarks": {"base": [0, 0, 1]}, "covariates": {"age": None, "height": 1.7}}
    assert facts_patched(facts, changes) == Facts(
        landmarks={"apex": 1, "base": (0, 0, 1)}, covariates={"sex": "f", "height": 1.7}
    )


def test_a_patch_that_makes_facts_contradict_each_other_is_refused() -> None:
    with pytest.raises(ParameterError, match="contradicts"):
        facts_patched(Facts(coordinates="RAS"), {"handedness": "left"})


@pytest.mark.parametrize("changes", [[], "material", 3, {"colour": "red"}, {"covariates": [1]}])
def test_what_is_no_fact_is_refused(changes: Any) -> None:
    with pytest.raises(ParameterError) as caught:
        facts_patched(NO_FACTS, changes)
    assert caught.value.remedy


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[1]",
        "NaN",
        '{"age": NaN}',
        '{"age": Infinity}',
        '{"age": 1, "age": 2}',
        "[" * 50_000,
        "1" * 5_000,
        " " * LONGEST_TEXT + "{}",
    ],
)
def test_a_text_that_is_no_object_is_refused(text: str) -> None:
    with pytest.raises(ParameterError, match="covariate"):
        read_object("covariates", text)
