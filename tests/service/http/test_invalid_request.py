"""A request that does not fit its description is told what would."""

from __future__ import annotations

from typing import Any

import pytest
from fastapi.testclient import TestClient

from modalmotion_service.http.problems import remedy_of


@pytest.fixture(scope="module")
def here(shared_client: TestClient, beat: bytes) -> str:
    return str(shared_client.post("/v1/sequences", content=beat).headers["location"])


@pytest.mark.parametrize(
    ("wrong", "remedy", "right"),
    [
        ({"rms": "0"}, "Send rms of more than 0.0.", {"rms": "1"}),
        ({"bytes": "many"}, "Send bytes as a whole number.", {"bytes": "100000"}),
        ({"rms": "nan"}, "Send rms as a number that is finite.", {"rms": "1"}),
        (
            {"rms": "1", "surprise": "1"},
            "Leave surprise out; /docs has the names that are read.",
            {"rms": "1"},
        ),
    ],
)
def test_the_remedy_of_a_query_is_followed(
    shared_client: TestClient,
    here: str,
    wrong: dict[str, str],
    remedy: str,
    right: dict[str, str],
) -> None:
    answer = shared_client.get(f"{here}/encoded", params=wrong)
    assert (answer.status_code, answer.json()["remedy"]) == (422, remedy)
    assert shared_client.get(f"{here}/encoded", params=right).status_code == 200


@pytest.mark.parametrize(
    ("wrong", "remedy"),
    [
        ({"modes": 0}, "Send modes of 1 or more."),
        ({"modes": "seven"}, "Send modes as a whole number."),
        ({"weights": "heavy"}, "Send weights as 'area' or 'uniform'."),
        ({"surprise": 1}, "Leave surprise out; /docs has the names that are read."),
    ],
)
def test_the_remedy_of_a_body_names_the_parameter(
    shared_client: TestClient, here: str, wrong: dict[str, Any], remedy: str
) -> None:
    answer = shared_client.post(f"{here}/signatures", json=wrong)
    assert (answer.status_code, answer.json()["remedy"]) == (422, remedy)


@pytest.mark.parametrize(
    ("error", "remedy"),
    [
        ({"type": "missing", "loc": ("body", "name")}, "State name."),
        ({"type": "json_invalid", "loc": ("body", 3)}, "Send a body that is JSON."),
        (
            {"type": "too_long", "loc": ("body", "ids"), "ctx": {"max_length": 9}},
            "Send ids of 9 entries or fewer.",
        ),
        ({"msg": "of another kind"}, "See /docs for the parameters of this call."),
        ({"type": "model_type", "loc": ("body",)}, "Send the body as an object."),
        (
            {"type": "value_error", "loc": ("query", "at")},
            "See /docs for the parameters of this call.",
        ),
        # Without what it should have beside it.
        (
            {"type": "less_than", "loc": ("query", "at")},
            "See /docs for the parameters of this call.",
        ),
    ],
)
def test_remedies_name_the_place_and_the_limit(error: dict[str, Any], remedy: str) -> None:
    assert remedy_of([error]) == remedy


def test_a_value_of_several_kinds_has_the_remedies_of_all() -> None:
    errors: list[dict[str, Any]] = [
        {"type": "int_parsing", "loc": ("query", "frame", "int")},
        {
            "type": "literal_error",
            "loc": ("query", "frame", "literal['mean']"),
            "ctx": {"expected": "'mean'"},
        },
        {"type": "missing", "loc": ("query", "other")},
    ]
    assert remedy_of(errors) == "Send frame as a whole number. Or: Send frame as 'mean'."
    assert remedy_of([]).startswith("See /docs")
