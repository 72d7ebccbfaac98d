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
    ("wrong", "said"),
    [
        ({"rms": "0"}, "query.rms: Input should be greater than 0."),
        ({"rms": "nan"}, "query.rms: Input should be a finite number."),
        ({"rms": "1", "surprise": "1"}, "query.surprise: Extra inputs are not permitted."),
    ],
)
def test_a_query_that_does_not_fit_is_told_where_and_what(
    shared_client: TestClient, here: str, wrong: dict[str, str], said: str
) -> None:
    answer = shared_client.get(f"{here}/encoded", params=wrong)
    assert (answer.status_code, answer.json()["detail"]) == (422, said)
    assert answer.json()["remedy"].startswith(f"Correct {[*wrong][-1]}; ")
    assert shared_client.get(f"{here}/encoded", params={"rms": "1"}).status_code == 200


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"modes": 0}, "greater than or equal to 1"),
        ({"modes": "seven"}, "a valid integer"),
        ({"components": "heavy"}, "'cartesian' or 'cylindrical'"),
        ({"surprise": 1}, "not permitted"),
    ],
)
def test_a_body_that_does_not_fit_is_told_where_and_what(
    shared_client: TestClient, here: str, wrong: dict[str, Any], said: str
) -> None:
    answer = shared_client.post(f"{here}/signatures", json=wrong)
    name = next(iter(wrong))
    assert answer.status_code == 422
    assert f"body.{name}: " in answer.json()["detail"]
    assert said in answer.json()["detail"]
    assert answer.json()["remedy"].startswith(f"Correct {name}; ")


def test_the_usual_signature_names_the_call_that_makes_others(
    shared_client: TestClient, here: str
) -> None:
    answer = shared_client.get(f"{here}/signature", params={"modes": "12"})
    assert answer.status_code == 422
    assert "POST /v1/sequences/{id}/signatures" in answer.json()["remedy"]
    assert shared_client.post(f"{here}/signatures", json={"modes": 12}).status_code == 201


def test_a_call_that_does_not_exist_names_those_like_it(shared_client: TestClient) -> None:
    for guessed, meant in (("classify", "POST /v1/classify"), ("report", "{key}/report")):
        answer = shared_client.post(f"/v1/sequences/{'0' * 64}/{guessed}")
        assert answer.status_code == 404
        assert meant in answer.json()["remedy"]


@pytest.mark.parametrize(
    ("places", "named"),
    [
        ([("body", "name")], "name"),
        ([("body", "ids", 3), ("body", "ids", 4), ("body", "coverage")], "ids, coverage"),
        ([("body", 3)], "the request"),
        ([("body",)], "the request"),
        ([], "the request"),
        ([("query", name) for name in "abcd"], "a, b, c"),
    ],
)
def test_remedies_name_the_parameters(places: list[Any], named: str) -> None:
    remedy = remedy_of([{"loc": place} for place in places])
    assert remedy == f"Correct {named}; /docs describes the parameters of this call."
