"""HEAD is answered wherever GET is; pages of other origins are let in where settings name them."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from modalmotion_service.access.keys import KeyRing
from modalmotion_service.access.scopes import SCOPE_OF, Scope
from modalmotion_service.app import create_app
from modalmotion_service.settings import Settings

ORIGIN = "https://viewer.example"


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    folder = tmp_path_factory.mktemp("head")
    settings = Settings(data_dir=folder, workers=1, require_keys=True, cors_origins=(ORIGIN,))
    with KeyRing(folder) as ring:
        token = ring.create("lab", frozenset(Scope))[1]
    with TestClient(create_app(settings), headers={"Authorization": f"Bearer {token}"}) as client:
        while client.get("/health/ready").status_code == 503:
            time.sleep(0.05)
        yield client


@pytest.mark.parametrize(
    "path", [path for method, path in SCOPE_OF if method == "GET" and "{" not in path]
)
def test_the_head_is_that_of_a_get_without_a_body(client: TestClient, path: str) -> None:
    got, head = client.get(path), client.head(path)
    assert head.content == b""
    assert head.status_code == got.status_code == 200
    own = {"x-request-id", "date", "server-timing", "etag", "ratelimit", "content-length"}
    assert {name for name in got.headers if name not in own} <= set(head.headers)


def test_what_is_not_there_is_not_there_for_head_and_what_no_get_has_is_not_allowed(
    client: TestClient,
) -> None:
    assert client.head(f"/v1/sequences/{'0' * 64}").status_code == 404
    refused = client.head("/v1/signature")
    assert (refused.status_code, refused.content) == (405, b"")
    assert client.put("/v1/limits").headers["allow"] == "GET, HEAD"


def test_only_pages_of_stated_origins_may_read_answers(client: TestClient) -> None:
    asks = {"Access-Control-Request-Method": "POST", "Access-Control-Request-Headers": "x-api-key"}
    for origin, status in ((ORIGIN, 200), ("https://other.example", 400)):
        answer = client.options("/v1/signature", headers={"Origin": origin, **asks})
        assert answer.status_code == status
        assert ("access-control-allow-origin" in answer.headers) == (status == 200)
    answer = client.get("/v1/limits", headers={"Origin": ORIGIN})
    assert answer.headers["access-control-allow-origin"] == ORIGIN
    assert "access-control-allow-credentials" not in answer.headers
    # An error is told to the page as well.
    unknown = client.get("/v1/limits", headers={"Origin": ORIGIN, "Authorization": "Bearer x"})
    assert unknown.status_code == 401
    assert unknown.headers["access-control-allow-origin"] == ORIGIN


def test_without_a_stated_origin_nothing_is_said_to_other_pages(tmp_path: Path) -> None:
    with TestClient(create_app(Settings(data_dir=tmp_path, workers=1))) as plain:
        answer = plain.options(
            "/v1/limits", headers={"Origin": ORIGIN, "Access-Control-Request-Method": "GET"}
        )
        assert "access-control-allow-origin" not in answer.headers
