from __future__ import annotations

import math
import pickle
from typing import Any

import numpy as np
import pytest
from facts_samples import FACTS, facts_of
from hypothesis import given

from modalmotion import Facts, ParameterError
from modalmotion.mesh import NAMES, NO_FACTS, WORDS


def test_nothing_is_stated_by_default() -> None:
    facts = Facts()
    assert facts.stated == ()
    assert all(getattr(facts, name) == "unknown" for name in WORDS)
    assert repr(facts) == "Facts(unknown)"


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("value", ["no such word" * 20, math.nan, math.inf, -1.0, 0, [], {}, True])
def test_a_bad_value_is_refused_by_the_name_of_its_fact(name: str, value: Any) -> None:
    if name in ("landmarks", "covariates") and value in ([], {}):
        pytest.skip("nothing is stated")
    with pytest.raises(ParameterError) as caught:
        Facts(**{name: value})
    assert name.removesuffix("s") in str(caught.value)
    assert caught.value.remedy


@pytest.mark.parametrize("coordinates", ["LPS", "RAS"])
def test_anatomical_coordinates_are_not_left_handed(coordinates: Any) -> None:
    with pytest.raises(ParameterError, match=f"'left' contradicts the coordinates '{coordinates}'"):
        Facts(handedness="left", coordinates=coordinates)
    assert Facts(handedness="right", coordinates=coordinates).coordinates == coordinates


@pytest.mark.parametrize(
    "value", [math.nan, math.inf, 10**400, True, None, "", " x", "a\nb", "\ud800", "x" * 201, [1]]
)
def test_a_covariate_is_a_finite_number_or_a_word(value: Any) -> None:
    with pytest.raises(ParameterError, match="covariate 'age'"):
        Facts(covariates={"age": value})


def test_the_value_of_a_covariate_stands_in_no_message() -> None:
    with pytest.raises(ParameterError) as caught:
        Facts(covariates={"diagnosis": "secret\n"})
    assert "secret" not in f"{caught.value} {caught.value.details}"


@pytest.mark.parametrize(
    "value",
    [-1, True, 1.5, "7", (1, 2), (1, 2, 3, 4), (0, 0, math.nan), ("a", 0, 0), [[0, 0, 0]], 10**400],
)
def test_a_landmark_is_a_vertex_or_a_point(value: Any) -> None:
    with pytest.raises(ParameterError, match="landmark 'apex'"):
        Facts(landmarks={"apex": value})
    with pytest.raises(ParameterError, match="landmark 'corners'"):
        facts_of(landmarks={"corners": [0, 1, value, 2]})


def test_places_come_in_many_types_and_are_kept_in_one() -> None:
    one = facts_of(landmarks={"apex": np.int32(7), "base": np.array([1, 2, 3])})
    assert dict(one.landmarks) == {"apex": 7, "base": (1.0, 2.0, 3.0)}
    assert one == facts_of(landmarks={"base": [1.0, 2, 3], "apex": 7})


def test_a_number_has_one_form() -> None:
    assert repr(dict(Facts(covariates={"a": 61.0, "b": -0.0, "c": 0.5}).covariates)) == (
        "{'a': 61, 'b': 0, 'c': 0.5}"
    )


@pytest.mark.parametrize("kind", ["landmarks", "covariates"])
def test_names_are_bounded_and_stated_once(kind: str) -> None:
    for name in ("", " a", "a=b", "a:b", "a,b", "a;b", "x" * 65, "a\tb"):
        with pytest.raises(ParameterError, match="name"):
            facts_of(**{kind: {name: 1}})
    with pytest.raises(ParameterError, match=r"stated twice \(once as 'Age'\)"):
        facts_of(**{kind: {"Age": 1, "age": 2}})
    with pytest.raises(ParameterError, match="more than 100"):
        facts_of(**{kind: {f"n{k}": 1 for k in range(101)}})


def test_a_period_holds_the_times_that_it_is_a_period_of() -> None:
    facts = Facts(period=0.8)
    facts.require_fit(1, 0.8)
    facts.require_fit(1, None)
    with pytest.raises(ParameterError, match=r"period is 0\.8 s, but the times span 0\.96 s"):
        facts.require_fit(1, 0.96)


def test_a_landmark_is_a_vertex_that_there_is() -> None:
    for facts in (Facts(landmarks={"x": 4}), Facts(landmarks={"corners": (0, 1, 2, 4)})):
        facts.require_fit(5, None)
        with pytest.raises(ParameterError, match="vertex 4, but there are 4"):
            facts.require_fit(4, None)


def test_what_is_stated_goes_over_what_was_known() -> None:
    known = Facts(tracking="normal_displacement", period=1.0, covariates={"age": 61, "sex": "f"})
    said = Facts(tracking="material", covariates={"age": 62})
    both = said.over(known)
    assert both == Facts(tracking="material", period=1.0, covariates={"age": 62, "sex": "f"})
    assert both.changed(known) == ("tracking", "covariates")


@given(FACTS)
def test_facts_are_values(facts: Facts) -> None:
    again = pickle.loads(pickle.dumps(facts))  # noqa: S301 (made here)
    assert again == facts

    assert NO_FACTS.over(facts) == facts.over(NO_FACTS) == facts.over(facts) == facts
    assert facts.changed(NO_FACTS) == facts.stated
    assert len(repr(facts)) <= 120
    assert "\n" not in repr(facts)


def test_the_text_of_facts_counts_covariates_and_shows_none() -> None:
    facts = Facts(tracking="material", period=0.8, landmarks={"apex": 1}, covariates={"age": 61})
    assert repr(facts) == "Facts(material, period 0.8 s, 1 landmark, 1 covariate)"
