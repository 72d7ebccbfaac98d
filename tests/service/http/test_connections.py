"""Clients that mean ill, or are unlucky: what they cost others, and what they leave behind."""

from __future__ import annotations

import http.client
import io
import json
import resource
import socket
import stat
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from access_parts import guarded
from fastapi.testclient import TestClient
from project import ROOT
from running import RunningService

from modalmotion_service.access.keys import KeyRing
from modalmotion_service.access.scopes import Scope
from modalmotion_service.app import create_app
from modalmotion_service.errors import ClusterError
from modalmotion_service.http.connections import room_for_connections
from modalmotion_service.http.middleware import UNKNOWN_CLIENT, UPLOADS, plain_address
from modalmotion_service.settings import Settings
from modalmotion_service.work.pool import WorkerPool

JSON = {"Content-Type": "application/json"}
MOST = 4


def eventually(holds: Callable[[], bool], seconds: float = 20.0) -> bool:
    end = time.monotonic() + seconds
    while not (held := holds()) and time.monotonic() < end:
        time.sleep(0.05)
    return held


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningService]:
    settings = {
        "REQUIRE_KEYS": "true",
        "WORKERS": "1",
        "MAX_CONCURRENT_REQUESTS": str(MOST),
        "IDLE_SECONDS": "2",
    }
    running = RunningService(tmp_path_factory.mktemp("abuse") / "results", settings)
    yield running.start()
    running.stop()


@pytest.fixture(scope="module")
def keys(service: RunningService) -> dict[str, str]:
    with KeyRing(service.data_dir) as ring:
        keys = {owner: ring.create(owner, frozenset(Scope))[1] for owner in ("alice", "bob")}
        return keys | {"reader": ring.create("reader", frozenset({Scope.READ}))[1]}


def asked(service: RunningService, key: str, path: str = "/v1/sequences") -> int:
    return service.request("GET", path, None, {"X-API-Key": key}).status


def head(method: str, path: str, key: str, *more: str) -> bytes:
    lines = (f"{method} {path} HTTP/1.1", "Host: 127.0.0.1", f"X-API-Key: {key}", *more, "", "")
    return "\r\n".join(lines).encode()


def answered(service: RunningService, request: bytes) -> bytes:
    """Everything that comes until the service closes the connection."""
    with socket.create_connection(("127.0.0.1", service.port), timeout=20.0) as connection:
        connection.sendall(request)
        return b"".join(iter(lambda: connection.recv(65536), b""))


def test_a_body_of_many_faults_costs_no_more_than_one_of_few(client: TestClient) -> None:
    """Each fault was an error of its own: 1.2 MB took 10 s, 0.7 GB and an answer of 35 MB."""
    unknown = {f"x{n}": 1 for n in range(5000)}
    for path, body in [
        ("signatures/query", {"ids": ["", {}] * 5000}),
        ("models", {"name": "x", "sequences": ["", {}] * 5000}),
        ("models", {"name": "x", "sequences": [unknown]}),
        ("signatures/query", {"ids": ["0" * 64], **unknown}),
        (f"signatures/{'0' * 64}/classifications", unknown),
        ("models", {"name": "x", "sequences": [], "options": {"modes": "9" * 100_000}}),
        ("models", {"name": "x", "sequences": [], "options": {"coverage": "9" * 100_000}}),
    ]:
        answer = client.post(f"/v1/{path}", content=json.dumps(body), headers=JSON)
        assert answer.json()["detail"]
        assert len(answer.content) < 5000, (path, answer.content[:500])
        assert answer.status_code == 422


def test_few_faults_are_each_named(client: TestClient) -> None:
    body = json.dumps({"label": "a", "lable": "b", "colour": 1})
    answer = client.patch(f"/v1/sequences/{'0' * 64}", content=body, headers=JSON)
    assert answer.status_code == 422
    where = {error["where"] for error in answer.json()["errors"]}
    assert where == {"body.lable", "body.colour"}
    answer = client.get("/v1/sequences?" + "&".join(f"x{n}=1" for n in range(200)))
    assert answer.status_code == 422
    assert len(answer.json()["errors"]) == 50
    answer = client.get("/v1/sequences?" + "&".join(f"x{n}=1" for n in range(201)))
    assert (answer.status_code, answer.json()["limit"]) == (413, "query_fields")


def test_what_is_no_upload_is_held_in_memory_and_must_be_small(tmp_path: Path, beat: bytes) -> None:
    settings = Settings(data_dir=tmp_path / "r", workers=1, max_json_bytes=1000)
    with TestClient(create_app(settings), raise_server_exceptions=False) as client:
        body = json.dumps({"ids": ["0" * 64] * 20}).encode()
        for content in (body, iter([body[:500], body[500:]])):
            # Whatever it says it is: it is read before that is looked at.
            answer = client.post("/v1/signatures/query", content=content)
            assert (answer.status_code, answer.json()["limit"]) == (413, "json_bytes")
        assert client.post("/v1/nowhere", content=body).json()["limit"] == "json_bytes"
        assert client.get("/v1/limits").json()["json_bytes"] == 1000
        assert client.post("/v1/sequences", content=beat).status_code == 201


def test_uploads_are_the_routes_that_take_a_file() -> None:
    paths = json.loads((ROOT / "openapi" / "openapi.json").read_text())["paths"]
    takes_file = {
        path
        for path, operations in paths.items()
        for operation in operations.values()
        if "application/octet-stream" in operation.get("requestBody", {}).get("content", {})
    }
    assert takes_file == UPLOADS


def test_slow_uploads_of_one_owner_keep_no_other_out(
    service: RunningService, keys: dict[str, str]
) -> None:
    slow = head("POST", "/v1/signature", keys["alice"], "Content-Length: 1000000")
    with ExitStack() as stack:
        for _ in range(MOST):
            connection = socket.create_connection(("127.0.0.1", service.port))
            stack.enter_context(connection).sendall(slow)
        assert eventually(lambda: asked(service, keys["alice"]) == 429)
        assert asked(service, keys["bob"]) == 200
    assert eventually(lambda: asked(service, keys["alice"]) == 200)


def test_every_health_check_passes_whoever_else_asks(
    service: RunningService, keys: dict[str, str]
) -> None:
    slow = "Content-Length: 1000000"
    with ExitStack() as stack:
        for key in [*keys.values()] * MOST:
            connection = socket.create_connection(("127.0.0.1", service.port))
            stack.enter_context(connection).sendall(head("POST", "/v1/signature", key, slow))
        assert eventually(lambda: {asked(service, key) for key in keys.values()} == {429})
        for path in ("/health/live", "/health/ready"):
            assert service.request("GET", path).status == 200, path
    assert eventually(lambda: asked(service, keys["alice"]) == 200)


def test_answers_that_are_not_read_hold_no_place_for_ever(
    service: RunningService, keys: dict[str, str]
) -> None:
    vertices = np.random.default_rng(1).normal(size=(260, 2000, 3)).astype("f4")
    buffer = io.BytesIO()
    np.savez(buffer, vertices=vertices, grid=(40, 50), topology="cup", unit="mm")
    key = {"X-API-Key": keys["alice"]}
    known = service.request("POST", "/v1/sequences", buffer.getvalue(), key).json["id"]
    path = f"/v1/signatures/{known}/reconstruction"
    size = len(service.request("GET", path, None, key).body)
    assert size > 6_000_000  # More than the system keeps for a client by itself.
    assert eventually(lambda: asked(service, keys["alice"]) == 200)
    with ExitStack() as stack:
        readers = []
        for _ in range(MOST - 1):
            connection = stack.enter_context(socket.socket())
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            connection.connect(("127.0.0.1", service.port))
            connection.sendall(head("GET", path, keys["alice"]))
            readers.append(connection)
        assert eventually(lambda: asked(service, keys["alice"]) == 429)
        assert eventually(lambda: asked(service, keys["alice"]) == 200)
        # Which of them had to make room first is not said.
        received = []
        for reader in readers:
            reader.settimeout(20.0)
            received.append(sum(len(piece) for piece in iter(partial(reader.recv, 1 << 20), b"")))
        assert min(received) < size


def test_a_reader_who_goes_on_gets_all_of_it(service: RunningService, keys: dict[str, str]) -> None:
    """Slower than the limit in all, and never at rest for as long as it."""
    request = head("GET", "/openapi.json", keys["alice"], "Connection: close")
    with socket.create_connection(("127.0.0.1", service.port), timeout=20.0) as connection:
        connection.sendall(request)
        answer = b""
        while piece := connection.recv(1 << 14):
            answer += piece
            time.sleep(0.01)
    assert json.loads(answer.partition(b"\r\n\r\n")[2])["openapi"]


@pytest.mark.parametrize(
    "request_of",
    [
        lambda key: head("A" * 21, "/v1/sequences", key),
        # Routes' patterns end before a line break: a proxy that keeps /metrics to itself let it in.
        lambda key: head("GET", "/metrics%0a", key),
        lambda key: head("GET", "/v1/sequences%0A", key),
        lambda key: head("GET", "/v1/limits%00", key),
        # A proxy that goes by the length takes the second request for the first one's body.
        lambda key: (
            head("POST", "/v1/signature", key, "Content-Length: 70", "Transfer-Encoding: chunked")
            + b"0\r\n\r\n"
            + head("GET", "/v1/sequences", key)
        ),
    ],
)
def test_what_two_programs_could_read_in_two_ways_is_refused(
    service: RunningService, keys: dict[str, str], request_of: Callable[[str], bytes]
) -> None:
    answer = answered(service, request_of(keys["alice"]))
    assert answer.startswith(b"HTTP/1.1 400 ")
    assert answer.count(b"HTTP/1.1") == 1
    assert b"application/problem+json" in answer


def test_made_up_methods_and_addresses_are_not_recorded(
    service: RunningService, keys: dict[str, str]
) -> None:
    method, name = "PATIENT" * 1000, "Jane Doe, born 1970"
    assert answered(service, head(method, "/v1/sequences", "none")).startswith(b"HTTP/1.1 400")
    # A proxy that is believed, for it is this machine, and passes on what it was sent.
    for address in (name, f"{name}:80", "fe80::1%Jane", "a" * 9000, "2.3.4.5"):
        forwarded = {"X-Forwarded-For": address}
        assert service.request("GET", "/v1/sequences", None, forwarded).status == 401
    entries = service.request("GET", "/v1/audit?limit=5", None, {"X-API-Key": keys["bob"]}).json
    clients = [entry["client"] for entry in entries["entries"]]
    assert clients == ["2.3.4.5", UNKNOWN_CLIENT, "fe80::1", UNKNOWN_CLIENT, UNKNOWN_CLIENT]
    text = service.log.read_text() + json.dumps(entries)
    assert "Jane" not in text
    assert "PATIENT" * 3 not in text


def test_an_address_is_written_without_what_its_sender_adds() -> None:
    assert plain_address("192.0.2.7") == "192.0.2.7"
    assert plain_address("2001:DB8::0:1") == "2001:db8::1"
    assert plain_address("fe80::1%eth0") == "fe80::1"
    for text in ("", "Jane", "1.2.3", "1.2.3.4, 5.6.7.8", "1.2.3.4 "):
        assert plain_address(text) == UNKNOWN_CLIENT


def test_an_owner_has_three_of_four_places_and_at_least_one(tmp_path: Path) -> None:
    shares = {
        most: Settings(
            data_dir=tmp_path, max_concurrent_requests=most
        ).max_concurrent_requests_of_owner
        for most in (1, 2, 4, 64)
    }
    assert shares == {1: 1, 2: 2, 4: 3, 64: 48}
    with guarded(tmp_path / "r", max_concurrent_requests=4) as service:
        limits = service.ask("a", "GET", "/v1/limits").json()
        assert limits["concurrent_requests_of_owner"] == 3


def test_connections_that_say_nothing_leave_room_for_those_that_ask(
    tmp_path: Path, beat: bytes
) -> None:
    """They took all open files: nothing was kept, and 75,000 lines were logged in 9 s."""
    running = RunningService(
        tmp_path / "results",
        {"REQUIRE_KEYS": "true", "WORKERS": "1"},
        most_files=400,
    )
    try:
        running.start()
        with KeyRing(running.data_dir) as ring:
            key = {"X-API-Key": ring.create("lab", frozenset(Scope))[1]}
        with ExitStack() as stack:
            for _ in range(500):
                address = "127.0.0.1", running.port
                stack.enter_context(socket.create_connection(address, timeout=20.0))
            assert running.request("POST", "/v1/sequences", beat, key).status == 201
            assert running.request("GET", "/health/ready").status == 200
        assert "out of system resource" not in running.log.read_text()
    finally:
        running.stop()


def test_a_process_asks_for_the_open_files_that_it_may_have(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    unlimited = resource.RLIM_INFINITY
    for limits, asked, room in [
        ((1024, 524_288), (65_536, 524_288), (1000, 2048)),
        ((1024, 1024), None, (341, 128)),
        ((100, 300), (300, 300), (100, 37)),
        ((256, unlimited), (65_536, unlimited), (1000, 2048)),
        ((unlimited, unlimited), None, (1000, 2048)),
        ((1_000_000, 1_000_000), None, (1000, 2048)),
    ]:
        set_to: list[object] = []
        monkeypatch.setattr(resource, "getrlimit", lambda _, limits=limits: limits)
        monkeypatch.setattr(resource, "setrlimit", lambda _, to, kept=set_to: kept.append(to))
        assert room_for_connections(1000) == room
        assert set_to == ([] if asked is None else [asked])


def test_a_form_is_one_however_its_type_is_written(client: TestClient, beat: bytes) -> None:
    form = b'--x\r\nContent-Disposition: form-data; name="file"; filename="../x"\r\n\r\n'
    kind = {"Content-Type": "Multipart/Form-Data; boundary=x"}
    answer = client.post("/v1/sequences", content=form + beat + b"\r\n--x--\r\n", headers=kind)
    assert answer.status_code == 201


def test_restored_keys_can_be_read_by_their_user_alone(tmp_path: Path) -> None:
    with KeyRing(tmp_path):
        pass
    folder = tmp_path / "access"
    for path in (folder, *folder.iterdir()):
        path.chmod(0o755)
    with KeyRing(tmp_path):
        assert stat.S_IMODE(folder.stat().st_mode) == 0o700
        assert stat.S_IMODE((folder / "keys.sqlite").stat().st_mode) == 0o600


def test_health_names_no_machine_inside(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    def lost(self: object) -> None:
        raise ClusterError("The scheduler at 'tcp://10.0.0.7:8786' has no workers.")

    monkeypatch.setattr(WorkerPool, "require_ready", lost)
    for path in ("/health/ready",):
        answer = client.get(path)
        assert (answer.status_code, answer.json()["code"]) == (503, "cluster_unavailable")
        assert answer.json()["remedy"]
        assert "10.0.0.7" not in answer.text


def test_the_rest_of_a_body_that_was_answered_is_not_looked_at(service: RunningService) -> None:
    """A stranger's 3 MB in chunks of one byte kept everybody waiting for 3 s."""
    with socket.create_connection(("127.0.0.1", service.port), timeout=5.0) as connection:
        connection.sendall(head("POST", "/v1/signature", "none", "Transfer-Encoding: chunked"))
        connection.sendall(b"1\r\nx\r\n" * 1000)
        answer = b"".join(iter(lambda: connection.recv(65536), b""))
        assert answer.startswith(b"HTTP/1.1 401 ")
        # Told that nothing more comes, and let to send on, were it no HTTP at all: more than
        # the buffers between here and there hold.
        for _ in range(200):
            connection.sendall(b"zz" * 50_000)


def test_a_large_upload_without_a_key_is_told_so(service: RunningService) -> None:
    body = bytes(20_000_000)
    request = head("POST", "/v1/signature", "none", f"Content-Length: {len(body)}")
    assert answered(service, request + body).startswith(b"HTTP/1.1 401 ")


EARLY = [
    (401, "POST", "/v1/signature", "", {}),
    (401, "POST", "/v1/sequences", "none", {}),
    (403, "POST", "/v1/models", "reader", {}),
    (403, "POST", "/v1/sequences", "reader", {}),
    (404, "POST", "/v1/nowhere", "alice", {}),
    (404, "POST", "/nowhere", "alice", {}),
    (405, "PUT", "/v1/sequences", "alice", {}),
    (413, "POST", "/v1/sequences", "alice", {"Content-Length": "300000000"}),
    (413, "POST", "/v1/signatures/query", "alice", {"Content-Length": "30000000"}),
    (400, "POST", "/v1/signature%00", "alice", {}),
    (429, "POST", "/v1/signature", "busy", {}),
]


@pytest.mark.parametrize(("status", "method", "path", "owner", "more"), EARLY)
@pytest.mark.parametrize("is_chunked", [False, True])
def test_an_answer_before_the_body_is_there_closes_its_connection(
    status: int,
    method: str,
    path: str,
    owner: str,
    more: dict[str, str],
    is_chunked: bool,
    service: RunningService,
    keys: dict[str, str],
) -> None:
    """The next request on such a connection failed 30 of 30."""
    if is_chunked and more:
        pytest.skip("a length in chunks is declared by none")
    with ExitStack() as stack:
        if owner == "busy":
            for _ in range(MOST):
                slow = stack.enter_context(socket.create_connection(("127.0.0.1", service.port)))
                slow.sendall(
                    head("POST", "/v1/signature", keys["alice"], "Content-Length: 1000000")
                )
            assert eventually(lambda: asked(service, keys["alice"]) == 429)
        token = {**keys, "": "", "none": "none", "busy": keys["alice"]}[owner]
        connection = http.client.HTTPConnection("127.0.0.1", service.port, timeout=20.0)
        stack.callback(connection.close)
        headers = {**({"X-API-Key": token} if token else {}), **more}
        for _ in range(3):
            connection.request(
                *(method, path, iter([bytes(100_000)] * 50) if is_chunked else bytes(5_000_000)),
                headers,
                encode_chunked=is_chunked,
            )
            answer = connection.getresponse()
            body = answer.read()
            assert answer.status == status, body
            assert json.loads(body)["status"] == status
            assert answer.headers.get_all("Connection") == ["close"]
            # On the same object, which opens another connection where it was told to.
            connection.request("GET", "/health/live")
            live = connection.getresponse()
            assert (live.status, live.read() != b"", live.headers["Connection"]) == (
                200,
                True,
                None,
            )


def test_an_answer_after_the_body_keeps_its_connection(
    service: RunningService, keys: dict[str, str]
) -> None:
    with socket.create_connection(("127.0.0.1", service.port), timeout=20.0) as connection:
        for path in ("/v1/nowhere", "/v1/signatures/query", "/v1/nowhere"):
            # In one piece: an answer before the body has come closes the connection, and may.
            request = head("POST", path, keys["bob"], "Content-Length: 2") + b"{}"
            connection.sendall(request)
            answer = http.client.HTTPResponse(connection)
            answer.begin()
            assert (answer.status in (404, 422), answer.headers["Connection"]) == (True, None)
            answer.read()
