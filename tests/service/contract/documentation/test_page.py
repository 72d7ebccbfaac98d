"""Security headers, the documentation page without a network, KServe v2, and the versions."""

from __future__ import annotations

import base64
import hashlib
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from access_parts import guarded
from fastapi.testclient import TestClient

from modalmotion_service.app import create_app
from modalmotion_service.contract.documentation.page import render
from modalmotion_service.http.api_version import API_VERSION
from modalmotion_service.settings import Settings


@pytest.fixture(scope="module")
def client(shared_client: TestClient) -> TestClient:
    return shared_client


@pytest.mark.parametrize(
    "path", ["/v1/sequences", "/nowhere", "/health/live", "/docs", "/metrics", "/openapi.json"]
)
def test_every_answer_tells_browsers_and_caches_what_not_to_do(
    client: TestClient, path: str
) -> None:
    headers = client.get(path).headers
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["x-frame-options"] == "DENY"
    assert headers["referrer-policy"] == "no-referrer"
    assert headers["cross-origin-resource-policy"] == "same-origin"
    assert headers["cache-control"] == "no-store"
    policy = headers["content-security-policy"].split("; ")
    assert {"default-src 'none'", "frame-ancestors 'none'"} <= set(policy)
    assert not [rule for rule in policy if "script" in rule or "unsafe" in rule]
    assert headers["api-version"] == API_VERSION
    assert "server" not in headers
    assert "strict-transport-security" not in headers


def test_refusals_have_the_headers_too_and_tls_is_kept_to(tmp_path: Path) -> None:
    with guarded(tmp_path) as service:
        answer = service.client.get("https://testserver/v1/sequences")
        assert answer.status_code == 401
        assert answer.headers["strict-transport-security"].startswith("max-age=31536000")
        assert answer.headers["cache-control"] == "no-store"


class Page(HTMLParser):
    """What a page holds, and what it would load."""

    def __init__(self) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.links: list[str] = []
        self.ids: list[str] = []
        self.tags: set[str] = set()
        self.styles: list[str] = []
        self.text: list[str] = []
        self.within = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        self.within = tag
        for name, value in attrs:
            if name in ("src", "srcset", "action") or (tag == "link" and name == "href"):
                self.loads.append(str(value))
            if tag == "a" and name == "href":
                self.links.append(str(value))
            if name == "id":
                self.ids.append(str(value))
            assert not name.startswith("on")
            assert name != "style"

    def handle_data(self, data: str) -> None:
        (self.styles if self.within == "style" else self.text).append(data)


def test_the_documentation_loads_nothing_and_its_policy_lets_its_style_in(
    client: TestClient,
) -> None:
    answer = client.get("/docs")
    assert answer.headers["content-type"] == "text/html; charset=utf-8"
    page = Page()
    page.feed(answer.text)
    assert page.loads == []
    assert not page.tags & {"script", "link", "img", "iframe", "object", "form", "base"}
    (style,) = page.styles
    assert "url(" not in style
    assert "@import" not in style
    digest = base64.b64encode(hashlib.sha256(style.encode()).digest()).decode()
    assert f"style-src 'sha256-{digest}'" in answer.headers["content-security-policy"]
    within = [link[1:] for link in page.links if link.startswith("#")]
    assert len(page.ids) == len(set(page.ids))
    assert set(within) <= set(page.ids)
    assert [link for link in page.links if not link.startswith("#")] == ["openapi.json"]


def test_the_documentation_names_every_call_parameter_and_schema(client: TestClient) -> None:
    document = client.get("/openapi.json").json()
    page = Page()
    page.feed(client.get("/docs").text)
    text = " ".join(page.text)
    for path, operations in document["paths"].items():
        for word in re.split(r"[{}]", path):
            assert word in text
        for operation in operations.values():
            for parameter in operation.get("parameters", ()):
                assert parameter["name"] in text
    for name in document["components"]["schemas"]:
        assert f"schema-{name}" in page.ids


def test_the_documentation_shows_text_and_never_runs_it() -> None:
    evil = "<script>alert(1)</script>"
    document = {
        "info": {"title": evil, "version": evil, "description": evil},
        "paths": {
            f"/{evil}": {
                "get": {
                    "summary": evil,
                    "description": f"{evil}\n\n{evil}",
                    "tags": [evil],
                    "parameters": [
                        {
                            "name": evil,
                            "in": "query",
                            "description": evil,
                            "schema": {"type": evil, "default": evil, "pattern": evil},
                        }
                    ],
                    "responses": {"200": {"description": evil, "content": {evil: {}}}},
                }
            }
        },
        "components": {"schemas": {evil: {"enum": [evil], "description": evil}}},
    }
    page = Page()
    page.feed(render(document, f"http://{evil}"))
    assert "script" not in page.tags
    assert " ".join(page.text).count("alert(1)") > 8


def test_kserve_clients_find_health_and_metadata(client: TestClient) -> None:
    assert client.get("/v2").json()["name"] == "modalmotion"
    assert client.get("/v2/health/live").json() == {"live": True}
    assert client.get("/v2/health/ready").json() == {"ready": True}
    name = "ventricle-simulated"
    assert client.get(f"/v2/models/{name}/ready").json() == {"name": name, "ready": True}
    model = client.get(f"/v2/models/{name}").json()
    assert (model["name"], len(model["versions"])) == (name, 1)
    assert {tensor["name"] for tensor in model["inputs"] + model["outputs"]} >= {"sequence"}
    for tensor in model["inputs"] + model["outputs"]:
        assert tensor["datatype"] in ("BYTES", "FP64")
        assert all(isinstance(size, int) for size in tensor["shape"])
    for path in ("/v2/models/nobody", "/v2/models/nobody/ready"):
        assert client.get(path).status_code == 404


def test_errors_are_described_as_problems_and_calls_with_their_scope() -> None:
    document = create_app(Settings(data_dir=Path("never-made"))).openapi()
    assert document["info"]["version"] == API_VERSION
    assert set(document["components"]["securitySchemes"]) == {"bearer", "header"}
    for path, operations in document["paths"].items():
        for operation in operations.values():
            is_open = operation["security"] == []
            assert is_open == ("x-scope" not in operation), path
            assert is_open or {"401", "403", "429"} <= set(operation["responses"])
            for status, answer in operation["responses"].items():
                if status >= "400":
                    assert list(answer["content"]) == ["application/problem+json"]
