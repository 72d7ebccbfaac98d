"""Every route: without a key 401, with another scope 403, for another's id 404, never data."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from access_parts import NOBODYS, Guarded, guarded, json_body
from clouds import small_recording
from fastapi.testclient import TestClient
from image_files import metaimage
from starlette.routing import Route

from modalmotion.formats import read_npz
from modalmotion_service.access.scopes import OPEN, SCOPE_OF, Scope, target_of
from modalmotion_service.app import create_app
from modalmotion_service.http.gate import route_of
from modalmotion_service.settings import Settings

ROUTES = sorted(SCOPE_OF, key=lambda route: (route[1], route[0]))
PAGES = {"/", "/docs", "/view/{key}", "/images/{images_id}", "/viewer/{name}"}
CLOSED = [route for route in ROUTES if SCOPE_OF[route] is not OPEN]
# What is the same for everybody, whatever its path names.
SHARED = {"/metrics", "/v1/limits"}
NEEDS_QUERY = {
    "/v1/signatures/{key}/distance": {"to": "0" * 64},
}
_CASES = [{"id": "0" * 64, "label": label} for label in ("normal", "weak")]
NEEDS_BODY = {
    ("PATCH", "/v1/sequences/{sequence_id}"): {"label": "mine"},
    ("POST", "/v1/models/{name}/evaluations"): {"sequences": _CASES},
    ("POST", "/v1/norms/{name}/deviations"): {"sequences": _CASES},
}


def filled(template: str, ids: dict[str, str]) -> str:
    if "/models/" in template:
        ids = {**ids, "name": f"{ids['name']}@1"}
    return re.sub(r"\{(\w+)\}", lambda found: ids.get(found[1], "ventricle-simulated"), template)


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Guarded]:
    settings = {"max_failures_per_minute": 10_000, "max_body_bytes": 2_000_000}
    with guarded(tmp_path_factory.mktemp("access") / "data", **settings) as service:
        yield service


@pytest.fixture(scope="module")
def alices(service: Guarded, beat: bytes) -> dict[str, str]:
    """Ids of everything that one owner has."""
    upload = service.ask("alice", "POST", "/v1/sequences?subject=Jane&label=secret", content=beat)
    sequence_id = upload.json()["id"]
    here = f"/v1/sequences/{sequence_id}"
    signature = service.ask("alice", "POST", f"{here}/signatures")
    assert signature.status_code == 201
    link = signature.headers["location"]
    assert service.ask("alice", "POST", f"{link}/classifications").status_code == 201
    template = service.ask("alice", "POST", "/v1/templates", content=beat).json()["id"]
    sent = {"content": small_recording(2), "params": {"modes": 2}}
    track = service.ask("alice", "POST", "/v1/tracks", **sent).json()["id"]
    images = service.ask("alice", "POST", "/v1/images", content=metaimage()).json()["id"]
    body = json_body([sequence_id])
    body["headers"]["Prefer"] = "respond-async"
    job = service.ask("alice", "POST", "/v1/signatures/query", **body).json()["id"]
    while service.ask("alice", "GET", f"/v1/jobs/{job}").json()["progress"] < 1:
        pass
    assert service.ask("alice", "GET", f"/v1/jobs/{job}/result").status_code == 200
    service.keep_model("alice", "hers")
    service.keep_norm("alice", "hers")
    assert service.ask("alice", "GET", "/v1/norms/hers").status_code == 200
    assert service.ask("alice", "GET", "/v1/models/hers@1").status_code == 200
    ids = {"sequence_id": sequence_id, "template_id": template, "track_id": track}
    return {
        **ids,
        "key": signature.json()["key"],
        "images_id": images,
        "job_id": job,
        "name": "hers",
    }


def test_every_route_of_the_app_has_a_scope_and_every_scope_a_route() -> None:
    app = create_app(Settings(data_dir=Path("never-made")))
    described = {
        (method.upper(), path)
        for path, operations in app.openapi()["paths"].items()
        for method in operations
    }
    plain = {("GET", route.path) for route in app.routes if type(route) is Route}
    # The page's own: a simulated heart to begin with.
    plain.add(("POST", "/v1/sequences/sample"))
    assert described | plain | {("GET", page) for page in PAGES} == set(SCOPE_OF)


def test_a_route_that_no_scope_is_stated_for_is_refused_to_everybody(tmp_path: Path) -> None:
    app = create_app(Settings(data_dir=tmp_path, workers=1))

    @app.get("/v1/new")
    def new() -> str:
        return "data"

    @app.get("/v1/sequences/{sequence_id}/other")
    def other(sequence_id: str) -> str:
        return "data"

    with TestClient(app) as client:
        for path in ("/v1/new", "/v1/sequences/x/other"):
            answer = client.get(path)
            assert (answer.status_code, answer.json()["code"]) == (403, "forbidden")


def test_open_are_only_calls_that_tell_nothing_of_anybody() -> None:
    opened = {path for (_, path), scope in SCOPE_OF.items() if scope is OPEN}
    assert opened == {"/openapi.json", *PAGES, "/health/live", "/health/ready"}


@pytest.mark.parametrize(("method", "template"), CLOSED)
def test_without_a_key_nothing(
    service: Guarded, alices: dict[str, str], method: str, template: str
) -> None:
    path = filled(template, alices)
    for headers in ({}, {"Authorization": "Bearer mm_" + "0" * 16 + "_" + "A" * 43}):
        # Answered before the body is looked at: this one is larger than the limit.
        answer = service.client.request(method, path, headers=headers, content=b"x" * 3_000_000)
        problem = answer.json()
        assert (answer.status_code, problem["code"]) == (401, "unauthenticated")
        assert answer.headers["content-type"] == "application/problem+json"
        assert answer.headers["www-authenticate"] == 'Bearer realm="modalmotion"'
        assert set(problem) == {"type", "title", "status", "code", "detail", "remedy"}


@pytest.mark.parametrize(("method", "template"), CLOSED)
def test_with_every_other_scope_nothing(
    service: Guarded, alices: dict[str, str], method: str, template: str
) -> None:
    needed = SCOPE_OF[method, template]
    others = set(Scope) - {needed}
    path = filled(template, alices)
    answer = service.ask("alice", method, path, *others, content=b"x" * 3_000_000)
    problem = answer.json()
    assert (answer.status_code, problem["code"], problem["scope"]) == (403, "forbidden", needed)
    assert set(problem) == {"type", "title", "status", "code", "detail", "remedy", "scope"}


@pytest.mark.parametrize(("method", "template"), CLOSED)
def test_with_the_scope_alone_the_call_is_taken(
    service: Guarded, method: str, template: str
) -> None:
    scope = SCOPE_OF[method, template]
    assert scope is not None
    path, query = filled(template, NOBODYS), NEEDS_QUERY.get(template)
    answer = service.ask("nobody", method, path, scope, params=query)
    assert answer.status_code not in (401, 403)
    assert answer.status_code < 500


@pytest.mark.parametrize(
    ("method", "template"),
    [route for route in CLOSED if "{" in route[1] and route[1] not in SHARED],
)
def test_for_anothers_id_exactly_what_an_unknown_one_is_answered(
    service: Guarded, alices: dict[str, str], method: str, template: str
) -> None:
    """Bob may do everything, knows Alice's ids, and learns not even that they are there."""
    body = NEEDS_BODY.get((method, template))
    more: dict[str, Any] = {"json": body, "params": NEEDS_QUERY.get(template)}
    tag = {"If-None-Match": "*"}
    for headers in ({}, tag, {"Accept": "*/*"}, {"Prefer": "respond-async"}):
        theirs = service.ask("bob", method, filled(template, alices), headers=headers, **more)
        unknown = service.ask("bob", method, filled(template, NOBODYS), headers=headers, **more)
        assert (theirs.status_code, theirs.json()["code"]) == (404, "not_found")
        # A problem may repeat the id that was asked for, and says nothing else.
        assert _without_ids(theirs.text) == _without_ids(unknown.text)


def _without_ids(text: str) -> str:
    return re.sub(r"[0-9a-f]{12,}|hers|nobodys", "ID", text)


def test_lists_comparisons_and_many_at_once_name_nothing_of_another(
    service: Guarded, alices: dict[str, str], beat: bytes
) -> None:
    known = alices["sequence_id"]
    for path in ("/v1/sequences", "/v1/sequences?tracked=true", "/v1/images", "/v1/jobs"):
        listed = service.ask("bob", "GET", path).json()
        assert listed == {path.split("/")[2].split("?")[0]: [], "cursor": None}
    query = json_body([known])
    assert service.ask("bob", "POST", "/v1/signatures/query", **query).status_code == 404
    vertices = read_npz(beat).sequence.vertices
    own = service.ask("bob", "POST", "/v1/sequences", content=_saved(vertices[:5])).json()["id"]
    here, key = f"/v1/sequences/{own}", alices["key"]
    for to in (known, key):
        assert (
            service.ask("bob", "GET", f"/v1/signatures/{own}/distance?to={to}").status_code == 404
        )
    named = {"json": {"template": alices["template_id"]}}
    assert service.ask("bob", "POST", f"{here}/signatures", **named).status_code == 404
    # Another's key with one's own sequence in it, and the other way round, is nobody's.
    mixed = f"/v1/signatures/{own}-{key.rpartition('-')[2]}"
    assert service.ask("bob", "GET", mixed).status_code == 404
    images = alices["images_id"]
    assert service.ask("bob", "POST", f"/v1/tracks?images={images}").status_code == 404
    assert service.ask("alice", "POST", f"/v1/tracks?images={images}").status_code == 422
    service.ask("bob", "DELETE", here)


def test_the_same_content_is_two_owners_each_of_their_own(
    service: Guarded, alices: dict[str, str], beat: bytes
) -> None:
    """Neither that it is known, nor names, nor idempotency keys pass from one to the other."""
    key = {"Idempotency-Key": "the same"}
    first = service.ask("alice", "POST", "/v1/sequences", content=beat, headers=key)
    again = service.ask("carol", "POST", "/v1/sequences", content=beat, headers=key)
    assert (first.status_code, again.status_code) == (200, 201)
    assert again.json()["id"] == alices["sequence_id"]
    assert (again.json()["subject"], again.json()["label"]) == (None, None)
    here = f"/v1/sequences/{alices['sequence_id']}"
    kept = f"/v1/signatures/{alices['sequence_id']}/classifications"
    assert service.ask("carol", "GET", kept).json()["classifications"] == []
    assert service.ask("carol", "GET", f"/v1/signatures/{alices['key']}").status_code == 404
    assert service.ask("carol", "DELETE", here).status_code == 204
    assert service.ask("carol", "GET", here).status_code == 404
    assert service.ask("alice", "GET", here).json()["subject"] == "Jane"


def test_owners_lie_in_folders_of_their_own(service: Guarded, alices: dict[str, str]) -> None:
    known = alices["sequence_id"]
    holding = {path for path in service.data_dir.rglob("*") if known in path.name}
    assert holding
    assert all(path.is_relative_to(service.data_dir / "owners" / "alice") for path in holding)


def test_unknown_paths_and_methods_need_a_key_too(service: Guarded) -> None:
    for path in ("/nowhere", "/v1/../v1/sequences/..", "//v1/sequences", "/v1/sequences/"):
        assert service.client.get(path).status_code == 401
        assert service.ask("alice", "GET", path).status_code == 404
    assert service.client.request("TRACE", "/v1/sequences").status_code == 401
    assert service.ask("alice", "PUT", "/v1/sequences").status_code == 405
    # A name in a path is no other method of what stands there literally.
    refused = service.ask("alice", "PUT", "/v1/signatures/query")
    assert (refused.status_code, refused.headers["allow"]) == (405, "POST")
    assert service.client.get("/health/live").status_code == 200


def test_jobs_of_every_owner_are_taken_up_after_a_restart(tmp_path: Path, beat: bytes) -> None:
    from modalmotion.store import ResultStore
    from modalmotion_service.workspace.jobs import Jobs

    with guarded(tmp_path) as service:
        token = service.token("dora")
        link = service.ask("dora", "POST", "/v1/sequences", content=beat).headers["location"]
    with ResultStore(tmp_path / "owners" / "dora") as store:
        request = {"name": "signature", "sequence_id": link.rsplit("/", 1)[1]}
        request["query"] = {"modes": 11}
        job = Jobs(store.database).create("signature", request)
    with guarded(tmp_path) as service:
        header = {"Authorization": f"Bearer {token}"}
        state = ""
        while state not in ("succeeded", "failed"):
            state = service.client.get(f"/v1/jobs/{job.id}", headers=header).json()["state"]
    assert state == "succeeded"


def test_a_path_is_judged_by_the_route_that_it_takes() -> None:
    found = target_of("GET", "/v1/sequences/abc/signatures")
    assert found is not None
    assert found.path_parameters == {"sequence_id": "abc"}
    assert target_of("GET", "/v1/sequences/abc/signatures/x") is None
    assert target_of("POST", "/v1/sequences/abc/signature") is None
    assert target_of("HEAD", "/openapi.json") is not None
    assert route_of({}) is None


def _saved(vertices: Any) -> bytes:
    import io

    import numpy as np

    buffer = io.BytesIO()
    np.savez(buffer, vertices=vertices, grid=(8, 16), topology="cup")
    return buffer.getvalue()
