"""Further columns of tables are covariates."""

from __future__ import annotations

from typing import Any

import pytest

from modalmotion import Facts
from modalmotion.errors import ParameterError
from modalmotion.mesh import facts_in, states_fact


def test_further_columns_are_covariates_beside_the_facts() -> None:
    row = {
        "path": "a.npz",
        "label": "rest",
        "subject": "P 1",
        "tracking": "Normal_Displacement",
        "covariate:Pulse": "61",
        "age": " 61.5 ",
        "sex": "f",
        "bsa (m^2)": "1.9",
    }
    covariates: dict[str, float | str] = {"Pulse": 61, "age": 61.5, "sex": "f", "bsa (m^2)": 1.9}
    assert facts_in(row) == Facts(tracking="normal_displacement", covariates=covariates)


@pytest.mark.parametrize("text", ["", "  ", "NA", "nan", "n/a", "NULL", ".", None, float("nan")])
def test_what_is_missing_states_nothing(text: Any) -> None:
    assert facts_in({"age": text}) == Facts()


def test_values_of_json_are_taken_as_they_are() -> None:
    row = {"age": 61, "smoker": True, "scans": [1, 2], "remark": {"a": 1}}
    assert facts_in(row).covariates == {"age": 61, "smoker": "yes"}


@pytest.mark.parametrize(("text", "value"), [("61,5", 61.5), ("-0,5", -0.5), ("a,b", "a,b")])
def test_a_decimal_comma_is_read_where_commas_do_not_part_columns(
    text: str, value: float | str
) -> None:
    assert facts_in({"age": text}, decimal_comma=True).covariates == {"age": value}
    assert facts_in({"age": text}).covariates == {"age": text}


def test_what_cannot_be_a_covariate_is_passed_over() -> None:
    row = {"remark": "x" * 201, "lines": "a\nb", "": "beside the table", None: ["more"]}
    assert facts_in(row) == Facts()
    # A heading may be too long for a name, or hold what a name must not.
    (name,) = facts_in({"rate: at rest, " + "x" * 100: "5"}).covariates
    assert name.startswith("rate at rest x")
    assert len(name) == 64


def test_results_and_names_are_not_covariates() -> None:
    row = {"path": "a", "subject": "P", "label": "rest", "rms_error": "0.2", "sequence_id": "12"}
    assert facts_in(row) == Facts()
    assert not any(map(states_fact, row))
    assert states_fact("period")
    assert states_fact("age")


def test_one_that_is_stated_twice_is_refused() -> None:
    with pytest.raises(ParameterError, match="'age' is stated twice"):
        facts_in({"age": "61", "covariate:age": "62"})
    assert facts_in({"age": "61", "covariate:age": ""}).covariates == {"age": 61}
