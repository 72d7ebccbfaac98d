"""The service does what its OpenAPI document says: every call, with inputs made from it."""

from __future__ import annotations

import io
import itertools
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import httpx2
import numpy as np
import pytest
import requests
import schemathesis
from access_parts import Guarded, guarded, json_body
from asgi_session import session_of
from clouds import small_recording
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from image_files import metaimage
from project import ROOT
from schemathesis import GenerationMode

from modalmotion_service.access.scopes import SCOPE_OF

# The state of `random`, which Hypothesis watches, is the process's: other threads serve meanwhile.
pytestmark = pytest.mark.filterwarnings("ignore:Do not use the `random` module")


def _readable(found: Any) -> Any:
    return found.ok()


SCHEMA = schemathesis.openapi.from_path(ROOT / "openapi" / "openapi.json")
OPERATIONS: dict[str, Any] = {
    operation.label: operation for operation in map(_readable, SCHEMA.get_all_operations())
}
# A document cannot say which bytes are a readable file, nor which modes a surface has.
UNSAID: list[Any] = [schemathesis.checks.CHECKS.get_one("positive_data_acceptance")]
# Fields of a form are text: a list of nothing is not sent, and a number as its digits.
UNTYPED: list[Any] = [schemathesis.checks.CHECKS.get_one("negative_data_rejection")]


def small(seed: int = 3) -> bytes:
    vertices = np.random.default_rng(seed).normal(size=(4, 64, 3))
    buffer = io.BytesIO()
    np.savez(buffer, vertices=vertices, grid=(8, 8), topology="cup", unit="mm")
    return buffer.getvalue()


# Where hardly any made-up query is answered: with whom to compare, and one of three targets.
NEEDED = {
    "/v1/signatures/{key}/distance": {"to": "{key}"},
    "/v1/encode": {"rms": "0.5"},
    "/v1/tracks": {"modes": "2"},
    "/v1/sequences/{sequence_id}/encoded": {"rms": "0.5"},
}


@dataclass
class Service:
    guarded: Guarded
    session: requests.Session
    token: str
    ids: dict[str, str]
    bodies: dict[str, bytes]
    statuses: dict[str, Counter[int]] = field(default_factory=dict)

    def check(self, case: Any) -> None:
        try:
            answer = case.call(
                base_url="http://testserver",
                session=self.session,
                headers={"Authorization": f"Bearer {self.token}"},
            )
        except httpx2.InvalidURL:
            return  # Longer than a request line: no server would see it.
        self.statuses.setdefault(case.operation.label, Counter())[answer.status_code] += 1
        is_text = not isinstance(case.body, dict) or "json" in (case.media_type or "")
        is_text = is_text or all(isinstance(value, str | bytes) for value in case.body.values())
        case.validate_response(answer, excluded_checks=UNSAID if is_text else UNSAID + UNTYPED)


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    folder = tmp_path_factory.mktemp("contract") / "data"
    # What is trained at the end is given up.
    with guarded(folder, max_requests_per_minute=10_000_000, drain_seconds=0.0) as found:
        ask = found.ask
        sent = [ask("lab", "POST", "/v1/sequences", content=small(seed)) for seed in range(6)]
        sequences = [answer.json()["id"] for answer in sent]
        sequence = sequences[3]
        template = ask("lab", "POST", "/v1/templates", content=small()).json()["id"]
        cloud = small_recording(2)
        track = ask("lab", "POST", "/v1/tracks?modes=2", content=cloud).json()["id"]
        images = ask("lab", "POST", "/v1/images", content=metaimage()).json()["id"]
        body = json_body([sequence])
        body["headers"]["Prefer"] = "respond-async"
        job = ask("lab", "POST", "/v1/signatures/query", **body).json()["id"]
        found.keep_model("lab", "kept")
        found.keep_norm("lab", "kept")
        stream = ask("lab", "GET", f"/v1/sequences/{sequence}/encoded?rms=0.5").content
        made = ask("lab", "POST", f"/v1/sequences/{sequences[4]}/signatures", json={"modes": 4})
        ids = {
            "sequence_id": sequence,
            "key": made.json()["key"],
            "template_id": template,
            "track_id": track,
            "images_id": images,
            "job_id": job,
            "name": "kept",
            **{f"sequence_{n}": found_id for n, found_id in enumerate(sequences)},
        }
        bodies = {"/v1/decode": stream, "/v1/tracks": cloud, "/v1/images": metaimage()}
        yield Service(found, session_of(found.client), found.token("lab"), ids, bodies)


def strategies(operation: Any, service: Service) -> list[st.SearchStrategy[Any]]:
    """Make cases: right and wrong by the document, and right ones of what is kept."""
    names = {parameter.name for parameter in operation.path_parameters}
    known = {name: service.ids[name] for name in names}
    if operation.label == "DELETE /v1/models/{name}":
        known = {"name": "kept@1"}
    more: dict[str, Any] = {"path_parameters": known} if known else {}
    media_types = operation.get_request_payload_content_types()
    if "application/octet-stream" in media_types:
        body = service.bodies.get(operation.path) or small()
        more.update(body=body, media_type="application/octet-stream")
    elif operation.path.endswith("query"):
        more.update(body={"ids": [service.ids["sequence_id"]]}, media_type="application/json")
    elif operation.path.endswith(("features", "evaluations")):
        case = {"id": service.ids["sequence_id"], "label": "normal", "subject": "s"}
        more.update(body={"sequences": [case]}, media_type="application/json")
    elif operation.label == "POST /v1/norms/{name}/deviations":
        ids = [service.ids[f"sequence_{n}"] for n in range(6)]
        more.update(body={"sequences": ids, "level": 0.1}, media_type="application/json")
    elif operation.label == "POST /v1/norms":
        ids = [service.ids[f"sequence_{n}"] for n in range(6)]
        more.update(body={"name": "made", "sequences": ids}, media_type="application/json")
    elif operation.label == "POST /v1/models":
        # Enough for a training to be begun; whether it succeeds its job says.
        cases = [
            {"id": service.ids[f"sequence_{n}"], "label": "ab"[n % 2], "subject": f"s{n}"}
            for n in range(6)
        ]
        more.update(body={"name": "made", "sequences": cases}, media_type="application/json")
    made = [operation.as_strategy(generation_mode=GenerationMode.POSITIVE, **more)]
    if more:
        made.append(operation.as_strategy(generation_mode=GenerationMode.POSITIVE))
    if asked := NEEDED.get(operation.path):
        query = {name: value.format(**service.ids) for name, value in asked.items()}
        made.append(
            operation.as_strategy(generation_mode=GenerationMode.POSITIVE, **more, query=query)
        )
    if any(True for _ in operation.iter_parameters()) or operation.body:
        made.append(operation.as_strategy(generation_mode=GenerationMode.NEGATIVE))
    return made


def conform(label: str, service: Service, max_examples: int, seed_is_fixed: bool) -> None:
    for cases in strategies(OPERATIONS[label], service):

        @given(case=cases)
        @settings(
            max_examples=max_examples,
            deadline=None,
            database=None,
            derandomize=seed_is_fixed,
            phases=[Phase.generate],
            suppress_health_check=list(HealthCheck),
        )
        def answered_as_described(case: Any) -> None:
            service.check(case)

        answered_as_described()


def cover(label: str, service: Service, every: int, most: int | None = None) -> None:
    """Send the cases that the document's own bounds lead to, or every n-th of the first of them."""
    operation = OPERATIONS[label]
    cases = SCHEMA.iter_coverage_cases(
        operation,
        generation_modes=list(GenerationMode),
        generation_config=SCHEMA.config.generation_for(operation=operation),
    )
    for case in itertools.islice(cases, 0, most, every):
        service.check(case)


def last_first(label: Any) -> tuple[bool, str]:
    """Sort what takes things away behind everything else."""
    return label.startswith("DELETE"), label


@pytest.mark.parametrize("label", sorted(OPERATIONS, key=last_first))
def test_every_call_is_answered_as_described(service: Service, label: str) -> None:
    conform(label, service, 1, seed_is_fixed=True)
    cover(label, service, every=24, most=200)
    assert sum(service.statuses[label].values()) >= 1


def test_what_was_tried_reached_every_call_and_its_answers(service: Service) -> None:
    described = {f"{method} {path}" for method, path in SCOPE_OF if path not in _NOT_DESCRIBED}
    assert set(OPERATIONS) == described
    if set(service.statuses) != described:
        pytest.skip("the calls were not all tried in this run")
    succeeded = [label for label, tried in service.statuses.items() if min(tried) < 300]
    assert set(succeeded) == described - _REFUSED


_REFUSED = {
    # The job has ended by then, and an ended job is not cancelled.
    "DELETE /v1/jobs/{job_id}",
    # An instance's header: tests/service/routes/ has it.
    "POST /v1/signatures/{key}/dicom",
}

_NOT_DESCRIBED = {
    "/",
    "/docs",
    "/openapi.json",
    "/view/{key}",
    "/v1/sequences/sample",
    "/images/{images_id}",
    "/viewer/{name}",
}


@pytest.mark.soak
def test_every_call_is_answered_as_described_at_length(service: Service) -> None:
    for label in sorted(OPERATIONS, key=last_first):
        conform(label, service, 75, seed_is_fixed=False)
        cover(label, service, every=1)
    n_sent = sum(sum(tried.values()) for tried in service.statuses.values())
    print(f"{n_sent} requests to {len(OPERATIONS)} calls: all as described")  # noqa: T201
    assert n_sent >= 10_000
