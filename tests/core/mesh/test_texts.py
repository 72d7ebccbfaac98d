from __future__ import annotations

import json

import pytest
from facts_samples import FACTS
from hypothesis import given

from modalmotion import Facts, ParameterError
from modalmotion.mesh import NO_FACTS, facts_as_json, facts_from_texts, is_fact


@given(FACTS)
def test_facts_come_back_from_texts(facts: Facts) -> None:
    shown = facts_as_json(facts)
    texts = {
        name: json.dumps(value) if isinstance(value, dict) else value
        for name, value in shown.items()
    }
    assert facts_from_texts(texts) == facts


def test_columns_of_a_table_are_read() -> None:
    columns = {
        "tracking": "Material",
        "coordinates": "lps",
        "period": " 0.8 ",
        "cavity": "LV",
        "modality": "MR",
        "landmark:apex": "0, 0,-40",
        "landmark:corners": "0;1;2;3.5,0,1",
        "landmark:RV insertion": "17",
        "covariate:age": "61",
        "covariate:Sex": "f",
        "covariate:weight": "",
    }
    assert all(map(is_fact, columns))
    assert facts_from_texts(columns) == Facts(
        tracking="material",
        coordinates="LPS",
        period=0.8,
        cavity="lv",
        modality="MR",
        landmarks={
            "apex": (0, 0, -40),
            "corners": (0, 1, 2, (3.5, 0, 1)),
            "RV insertion": 17,
        },
        covariates={"age": 61, "Sex": "f"},
    )


def test_what_is_empty_states_nothing() -> None:
    assert facts_from_texts({"tracking": "", "period": None, "covariates": " "}) == NO_FACTS
    assert not any(map(is_fact, ["path", "label", "landmark", "marker:a", "vertices"]))


@pytest.mark.parametrize("text", ["nan", "NaN", "inf", "-Infinity"])
def test_a_missing_number_is_not_taken_for_a_word(text: str) -> None:
    with pytest.raises(ParameterError, match="not a finite number"):
        facts_from_texts({"covariate:age": text})


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        ({"covariate:age": "1", "covariates": '{"age": 2}'}, "'age' is stated twice"),
        ({"covariate:age": "1", "covariate: age": "2"}, "'age' is stated twice"),
        ({"covariate:age": "1", "covariate:AGE": "2"}, "stated twice"),
        ({"covariate:": "1"}, "name '' of a covariate"),
        ({"landmark:apex": "1,2"}, "landmark 'apex'"),
        ({"landmark:apex": "1,2,nan"}, "landmark 'apex'"),
        ({"landmark:apex": "1,2,1e999"}, "landmark 'apex'"),
        ({"landmark:corners": "1;2;3"}, "3 places, not four"),
        ({"period": "0.8 s"}, "period is '0.8 s'"),
        ({"period": "nan"}, "period is 'nan'"),
        ({"period": "1e999"}, "period is 'inf'"),
        ({"tracking": "tissue"}, "fact 'tracking' is 'tissue'"),
    ],
)
def test_what_cannot_be_read_is_refused_by_name(texts: dict[str, str], message: str) -> None:
    with pytest.raises(ParameterError, match=message) as caught:
        facts_from_texts(texts)
    assert caught.value.remedy
