"""The proxy of `deploy/nginx.conf` with TLS before a service, as a client far away meets both."""

from __future__ import annotations

import http.client
import json
import re
import shutil
import ssl
import subprocess
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest
from dask_cluster import free_port
from project import ROOT
from running import Answer, RunningService

from modalmotion.formats import read_npz
from modalmotion_service.access.audit import AuditLog
from modalmotion_service.access.keys import KeyRing
from modalmotion_service.access.scopes import Scope
from modalmotion_service.settings import Settings

NAME = "modalmotion.example"

pytestmark = pytest.mark.skipif(
    shutil.which("nginx") is None or shutil.which("openssl") is None,
    reason="nginx or openssl is not installed",
)


@dataclass
class Proxied:
    service: RunningService
    port: int
    plain_port: int
    token: str
    trusted: ssl.SSLContext
    log: Path

    def request(self, method: str, path: str, body: bytes | None = None, **headers: str) -> Answer:
        key = {"Authorization": f"Bearer {self.token}", "Host": NAME}
        return self.bare(method, path, body, {**key, **headers})

    def bare(
        self, method: str, path: str, body: bytes | None, headers: Mapping[str, str]
    ) -> Answer:
        connection = http.client.HTTPSConnection(
            "127.0.0.1", self.port, timeout=60, context=self.trusted
        )
        try:
            connection.request(method, path, body, dict(headers))
            response = connection.getresponse()
            found = {name.lower(): value for name, value in response.getheaders()}
            return Answer(response.status, found, response.read())
        finally:
            connection.close()


@pytest.fixture(scope="module")
def proxied(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Proxied]:
    folder = tmp_path_factory.mktemp("proxy")
    service = RunningService(folder / "results", {"REQUIRE_KEYS": "true", "WORKERS": "1"})
    nginx: subprocess.Popen[bytes] | None = None
    try:
        service.start()
        with KeyRing(service.data_dir) as ring:
            token = ring.create("lab", frozenset(Scope))[1]
        port, plain_port = free_port(), free_port()
        _certificate(folder)
        (folder / "nginx.conf").write_text(_configuration(folder, service.port, port, plain_port))
        command = ["nginx", "-e", "stderr", "-p", str(folder), "-c", str(folder / "nginx.conf")]
        tested = subprocess.run([*command, "-t"], capture_output=True, text=True, check=False)
        assert tested.returncode == 0, tested.stderr
        assert "warn" not in tested.stderr.replace('the "user" directive', "")
        with (folder / "nginx.log").open("wb") as sink:
            nginx = subprocess.Popen([*command, "-g", "daemon off;"], stderr=sink)
        trusted = ssl.create_default_context(cafile=folder / "fullchain.pem")
        trusted.check_hostname = False
        found = Proxied(service, port, plain_port, token, trusted, folder / "nginx.log")
        _wait_for(found)
        yield found
    finally:
        if nginx is not None:
            nginx.terminate()
            nginx.wait(30)
        service.stop()


def _certificate(folder: Path) -> None:
    subprocess.run(
        [
            *("openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "1"),
            *("-subj", f"/CN={NAME}", "-addext", f"subjectAltName=DNS:{NAME}"),
            *("-keyout", str(folder / "privkey.pem"), "-out", str(folder / "fullchain.pem")),
        ],
        check=True,
        capture_output=True,
    )


def _configuration(folder: Path, service_port: int, port: int, plain_port: int) -> str:
    """The file as it is delivered, but for ports and folders of this machine."""
    text = (ROOT / "deploy" / "nginx.conf").read_text()
    for there, here in (
        ("127.0.0.1:8000", f"127.0.0.1:{service_port}"),
        ("listen 80;", f"listen 127.0.0.1:{plain_port};"),
        ("listen 443 ssl;", f"listen 127.0.0.1:{port} ssl;"),
        ("/etc/ssl/modalmotion/", f"{folder}/"),
        ("/var/log/nginx/", f"{folder}/"),
    ):
        assert there in text
        text = text.replace(there, here)
    kinds = ("client_body", "proxy", "fastcgi", "uwsgi", "scgi")
    paths = "\n".join(f"{kind}_temp_path {folder}/{kind};" for kind in kinds)
    return (
        f"pid {folder}/nginx.pid;\nevents {{ worker_connections 64; }}\n"
        f"http {{\n{paths}\n{text}\n}}\n"
    )


def _wait_for(proxied: Proxied) -> None:
    for _ in range(100):
        try:
            if proxied.request("GET", "/health/ready").status == 200:
                return
        except OSError:
            time.sleep(0.05)
    raise AssertionError("the proxy does not answer")


def test_a_sequence_goes_in_and_its_signature_comes_out(proxied: Proxied, beat: bytes) -> None:
    sent = proxied.request("POST", "/v1/sequences", beat)
    assert sent.status == 201
    assert sent.headers["strict-transport-security"] == "max-age=31536000"
    assert sent.json["id"] == read_npz(beat).sequence.id
    found = proxied.request("POST", f"/v1/sequences/{sent.json['id']}/signatures", b"")
    assert len(found.json["modes"]) == 7
    place = sent.headers["location"]
    assert not place.startswith("http:")
    assert proxied.request("GET", re.sub(r"^https://[^/]+", "", place)).status == 200


def test_nobody_comes_in_without_a_key_though_the_proxy_is_on_this_machine(
    proxied: Proxied,
) -> None:
    for host in (NAME, "127.0.0.1", "localhost", f"127.0.0.1:{proxied.port}"):
        for more in ({}, {"X-Forwarded-For": "127.0.0.1"}, {"Forwarded": "for=127.0.0.1"}):
            answer = proxied.bare("GET", "/v1/sequences", None, {"Host": host, **more})
            assert answer.status == 401
            assert answer.json["code"]


def test_the_log_names_the_client_and_not_what_it_claims(proxied: Proxied) -> None:
    proxied.request("GET", "/v1/sequences?limit=7", None, **{"X-Forwarded-For": "203.0.113.9"})
    with AuditLog(proxied.service.data_dir) as log:
        entry = log.page(limit=1)[0]
    assert (entry.owner, entry.client) == ("lab", "127.0.0.1")


def test_a_request_is_found_by_its_id_in_all_logs_and_a_name_in_none(proxied: Proxied) -> None:
    limit, path = Settings().max_body_bytes, "/v1/sequences?subject=Jane"
    sent = proxied.request("GET", path, None, **{"X-Request-ID": "made-up"})
    # What the proxy itself refuses, it would tell of in its log of errors.
    proxied.request("POST", path, b"", **{"Content-Length": str(2 * limit)})
    request_id, folder = sent.headers["x-request-id"], proxied.service.data_dir.parent
    with AuditLog(proxied.service.data_dir) as log:
        entries = log.page(limit=5)
    assert request_id in [entry.request_id for entry in entries]
    # Written when the answer is on its way.
    for _ in range(100):
        if request_id in proxied.service.log.read_text():
            break
        time.sleep(0.02)
    assert request_id in proxied.service.log.read_text()
    (line,) = [
        line for line in (folder / "modalmotion.log").read_text().splitlines() if request_id in line
    ]
    assert line.split()[1:5] == ["127.0.0.1", request_id, "GET", "200"]
    for file in folder.glob("*.log"):
        assert "Jane" not in file.read_text(), file


def test_figures_stay_inside_and_plain_http_is_sent_on(proxied: Proxied) -> None:
    assert proxied.request("GET", "/metrics").status == 403
    connection = http.client.HTTPConnection("127.0.0.1", proxied.plain_port, timeout=10)
    connection.request("GET", "/v1/sequences?limit=1", headers={"Host": NAME})
    answer = connection.getresponse()
    assert answer.status == 308
    assert answer.getheader("location") == f"https://{NAME}/v1/sequences?limit=1"
    connection.close()


def test_plain_http_is_sent_on_to_no_other_host(proxied: Proxied) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", proxied.plain_port, timeout=10)
    connection.request("GET", "/v1/limits", headers={"Host": "evil.test"})
    assert connection.getresponse().getheader("location") == f"https://{NAME}/v1/limits"
    connection.close()


def test_figures_stay_inside_however_their_path_is_written(proxied: Proxied) -> None:
    for path in (
        "/metrics",
        "//metrics",
        "/%6detrics",
        "/x/../metrics",
        "/metrics?x",
        "/metrics%23",
    ):
        assert proxied.request("GET", path).status in (403, 404), path
    # To nginx another path, and to a router's pattern the same.
    assert proxied.request("GET", "/metrics%0a").status == 400


def test_the_proxy_logs_no_path_and_no_query(proxied: Proxied) -> None:
    """What it refuses, what it cannot pass on, and what goes through."""
    large = {"Host": NAME, "Content-Length": str(1 << 40)}
    assert proxied.bare("POST", "/v1/sequences?subject=Jane", b"", large).status == 413
    assert proxied.request("GET", "/metrics?subject=Jane").status == 403
    assert proxied.request("GET", "/v1/sequences?subject=Jane").status == 200
    assert "Jane" not in proxied.log.read_text()


def test_what_the_service_refuses_comes_back_as_it_says_it(proxied: Proxied, beat: bytes) -> None:
    cut = proxied.request("POST", "/v1/sequences", beat[: len(beat) // 2])
    assert cut.status == 400
    assert cut.headers["content-type"] == "application/problem+json"
    assert json.loads(cut.body)["remedy"]
    limit = Settings().max_body_bytes
    headers = {"Host": NAME, "Authorization": f"Bearer {proxied.token}"}
    headers["Content-Length"] = str(limit + 1)
    # The body itself is never sent: its announced length is refused.
    large = proxied.bare("POST", "/v1/sequences", b"", headers)
    assert large.status == 413
    assert large.headers["content-type"] == "application/problem+json"
