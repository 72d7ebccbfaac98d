"""Queries that are read once, against FastAPI's own reading of the same model."""

from __future__ import annotations

from typing import Annotated, Any
from urllib.parse import urlencode

import pytest
from fastapi import Depends, FastAPI, Query, Request
from fastapi.testclient import TestClient
from hypothesis import example, given, settings
from hypothesis import strategies as st

from modalmotion.facts import Facts
from modalmotion.limits import ReadLimits
from modalmotion_service.app import create_app
from modalmotion_service.http import problems
from modalmotion_service.http.preferences import Preference
from modalmotion_service.http.query import read_once
from modalmotion_service.routes.parts.dependencies import PreferenceDependency, preference_of
from modalmotion_service.schemas.request_queries import TemplateQuery

NAMES = [*TemplateQuery.model_fields, "MODES", "unknown"]
VALUES = ["", "7", "-1", "2.5", "nan", "true", "maybe", "cup", "66,50", "0,1", "raw", "max", "é&="]
LONG_TIMES = ",".join(f"{0.001 * k:.3f}" for k in range(1000))


@pytest.fixture(scope="module")
def twins() -> TestClient:
    app = FastAPI()
    problems.install(app)

    @app.get("/slow")
    async def slow(query: Annotated[TemplateQuery, Query()]) -> Any:
        return query.model_dump(mode="json")

    @app.get("/once")
    async def once(query: Annotated[TemplateQuery, Depends(read_once(TemplateQuery))]) -> Any:
        return query.model_dump(mode="json")

    @app.get("/slow-preference")
    async def slow_preference(preference: PreferenceDependency) -> Preference:
        return preference

    @app.get("/preference")
    async def preference(request: Request) -> Preference:
        return preference_of(request)

    return TestClient(app, raise_server_exceptions=False)


@pytest.mark.parametrize(
    "header", ["", "respond-async", "wait=5; a", "wait=x", "x" * 200, "x" * 201]
)
def test_a_preference_is_read_as_fastapi_reads_it(twins: TestClient, header: str) -> None:
    slow, own = (
        twins.get(path, headers={"Prefer": header}) for path in ("/slow-preference", "/preference")
    )
    assert (own.status_code, own.json()) == (slow.status_code, slow.json())
    assert own.status_code == (422 if len(header) > 200 else 200)


@given(st.lists(st.tuples(st.sampled_from(NAMES), st.sampled_from(VALUES)), max_size=4))
@example([])
@example([("modes", "7"), ("modes", "11")])
@example([("modes", "11"), ("modes", "none")])
@example([("unknown", "1"), ("unknown", "2")])
@example([("times", LONG_TIMES)])
@example([("times", LONG_TIMES), ("modes", "0")])
@settings(max_examples=40, deadline=None)
def test_a_query_is_read_as_fastapi_reads_it(
    twins: TestClient, given_parameters: list[tuple[str, str]]
) -> None:
    query = urlencode(given_parameters)
    slow = twins.get(f"/slow?{query}")
    # Twice: made anew, and as it was kept.
    for _ in range(2):
        once = twins.get(f"/once?{query}")
        assert (once.status_code, once.json()) == (slow.status_code, slow.json())


@pytest.mark.parametrize("query", ["modes=%ff", "modes=7;grid=1", "&&=&modes", "modes=7&%00=1"])
def test_what_is_hardly_a_query_is_read_as_fastapi_reads_it(twins: TestClient, query: str) -> None:
    slow, once = twins.get(f"/slow?{query}"), twins.get(f"/once?{query}")
    assert (once.status_code, once.json()) == (slow.status_code, slow.json())


def test_it_is_described_as_fastapi_describes_it() -> None:
    paths = create_app().openapi()["paths"]
    own = [one for one in paths["/v1/signature"]["post"]["parameters"] if one["name"] != "prefer"]
    *query, accept = own
    # That call reads the same model in FastAPI's way.
    others = paths["/v1/templates"]["post"]["parameters"]
    assert query == [one for one in others if one["name"] != "prefer"]
    (other,) = (
        parameter
        for parameter in paths["/v1/sequences/{sequence_id}/signature"]["get"]["parameters"]
        if parameter["name"] == "accept"
    )
    assert accept.keys() == other.keys()
    assert accept["schema"].keys() == other["schema"].keys()


def test_what_a_query_means_is_worked_out_once_and_not_for_other_facts() -> None:
    query = TemplateQuery.model_validate({"modes": "4", "apex": "3", "period": "0.8"})
    assert query.parameters() is query.parameters()
    assert (query.parameters().modes, query.parameters().landmarks.apex) == (4, 3)
    limits = ReadLimits(frames=7)
    options = query.options(limits, Facts(modality="US", period=0.5))
    assert (options.limits, options.facts) == (limits, Facts(modality="US", period=0.8))
    assert query.options(limits).facts == Facts(period=0.8)
    # Two that say the same are equal, whichever was used.
    assert query == TemplateQuery.model_validate({"modes": "4", "apex": "3", "period": "0.8"})
