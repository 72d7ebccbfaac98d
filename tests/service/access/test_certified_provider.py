"""Logins by a provider of OpenID Connect that others have written. Needs node and its package."""

from __future__ import annotations

import base64
import contextlib
import http.client
import json
import os
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import pytest
from fastapi.testclient import TestClient

from modalmotion_service.access import logins as provider_module
from modalmotion_service.app import create_app
from modalmotion_service.settings import Settings

pytest.importorskip("jwt")
pytest.importorskip("cryptography")

HERE = Path(__file__).parent / "issuer"
CLIENT, SECRET = "ward-7", "not-a-secret"

pytestmark = pytest.mark.skipif(
    shutil.which("node") is None or not (HERE / "node_modules").is_dir(),
    reason=f"needs node, and npm ci in {HERE.parent.name}/{HERE.name}",
)


def key(kind: str, name: str) -> dict[str, Any]:
    """A fresh private key as the provider takes it."""
    from cryptography.hazmat.primitives.asymmetric import ec, rsa
    from jwt.algorithms import ECAlgorithm, RSAAlgorithm

    made = (
        RSAAlgorithm.to_jwk(rsa.generate_private_key(public_exponent=65537, key_size=2048))
        if kind == "RS256"
        else ECAlgorithm.to_jwk(ec.generate_private_key(ec.SECP256R1()))
    )
    jwk = {name: value for name, value in json.loads(made).items() if name != "key_ops"}
    return {**jwk, "kid": name, "use": "sig", "alg": kind}


class Issuer:
    """The provider as a process; begun anew with other keys, its address stays."""

    def __init__(self) -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = probe.getsockname()[1]
        self.issuer = f"http://127.0.0.1:{self.port}"
        self._process: subprocess.Popen[bytes] | None = None

    def begin(self, *keys: dict[str, Any]) -> None:
        """Sign with the first of these keys, and publish all."""
        self.end()
        self._process = subprocess.Popen(
            ["node", "issuer.mjs", str(self.port)],
            cwd=HERE,
            env={
                **os.environ,
                "KEYS": json.dumps(keys),
                "CLIENT": CLIENT,
                "SECRET": SECRET,
                "ALGORITHM": keys[0]["alg"],
            },
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for _ in range(600):
            with contextlib.suppress(OSError):
                self._asked("GET", "/.well-known/openid-configuration")
                break
            assert self._process.poll() is None
            time.sleep(0.05)

    def token(self, scope: str = "modalmotion:read", resource: str = "urn:modalmotion") -> str:
        """An access token for a machine, as the standard has it (RFC 6749, 4.4; RFC 8707)."""
        query = {"grant_type": "client_credentials", "scope": scope, "resource": resource}
        basic = base64.b64encode(f"{CLIENT}:{SECRET}".encode()).decode()
        headers = {
            "Authorization": f"Basic {basic}",
            "Content-Type": "application/x-www-form-urlencoded",
        }
        return str(self._asked("POST", "/token", urlencode(query), headers)["access_token"])

    def end(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()

    def _asked(self, method: str, path: str, body: str | None = None, headers: Any = None) -> Any:
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=30)
        try:
            connection.request(method, path, body, headers or {})
            answer = connection.getresponse()
            data = answer.read()
            assert answer.status == 200, data
            return json.loads(data)
        finally:
            connection.close()


@pytest.fixture(scope="module")
def issuer() -> Iterator[Issuer]:
    own = Issuer()
    yield own
    own.end()


def test_its_tokens_are_taken_by_audience_scope_and_key(
    issuer: Issuer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # An unknown key is asked for again without a wait.
    monkeypatch.setattr(provider_module, "_BETWEEN_SECONDS", 0.0)
    first, second, curve = key("RS256", "first"), key("RS256", "second"), key("ES256", "curve")
    issuer.begin(first)
    settings = Settings(
        data_dir=tmp_path / "data",
        workers=1,
        require_keys=True,
        oidc_issuer=issuer.issuer,
        oidc_audience="modalmotion",
    )
    with TestClient(create_app(settings)) as client:

        def asked(token: str, method: str = "GET", path: str = "/v1/sequences") -> Any:
            return client.request(method, path, headers={"Authorization": f"Bearer {token}"})

        by_first = issuer.token()
        assert asked(by_first).status_code == 200
        # Its scopes, and no others; its audience, and no other.
        assert asked(by_first, "DELETE", f"/v1/sequences/{'0' * 64}").status_code == 403
        wide = issuer.token("modalmotion:read modalmotion:write")
        assert asked(wide, "DELETE", f"/v1/sequences/{'0' * 64}").status_code == 404
        other = asked(issuer.token(resource="urn:another-service"))
        assert (other.status_code, "another service" in other.json()["detail"]) == (401, True)
        # Keys rotate: both are published for a while, then the new one alone.
        issuer.begin(second, first)
        assert asked(issuer.token()).status_code == 200
        assert asked(by_first).status_code == 200
        issuer.begin(curve)
        assert asked(issuer.token()).status_code == 200
        refused = asked(by_first)
        assert (refused.status_code, "does not have" in refused.json()["detail"]) == (401, True)
    # One login, one owner, whichever key has signed.
    (owner,) = (tmp_path / "data" / "owners").iterdir()
    assert CLIENT not in owner.name


def test_a_login_goes_the_whole_way_from_an_upload_to_a_report(
    issuer: Issuer, tmp_path: Path, beat: bytes
) -> None:
    issuer.begin(key("RS256", "first"))
    settings = Settings(
        data_dir=tmp_path,
        workers=1,
        require_keys=True,
        oidc_issuer=issuer.issuer,
        oidc_audience="modalmotion",
    )
    token = issuer.token("modalmotion:read modalmotion:write")
    with TestClient(create_app(settings)) as client:
        client.headers["Authorization"] = f"Bearer {token}"
        uploaded = client.post("/v1/sequences", content=beat)
        assert uploaded.status_code == 201
        made = client.post(f"{uploaded.headers['location']}/signatures")
        here = made.headers["location"]
        assert (made.status_code, client.get(here).json()["key"]) == (201, made.json()["key"])
        named = client.post(f"{here}/classifications")
        assert named.status_code == 201
        fhir = {"Accept": "application/fhir+json"}
        report = client.get(f"{here}/report?model=ventricle-simulated", headers=fhir)
        assert report.status_code == 200
        assert named.json()["model"].partition("@")[0] == "ventricle-simulated"
        bundle = report.json()
        assert bundle["resourceType"] == "Bundle"
        # The same with a token that may only read.
        client.headers["Authorization"] = f"Bearer {issuer.token()}"
        assert client.get(f"{here}/report?model=ventricle-simulated", headers=fhir).json() == bundle
        assert client.post(f"{here}/classifications").status_code == 403
    (owner,) = (tmp_path / "owners").iterdir()
    assert len([*(owner / "classifications").rglob("*.h5")]) == 1
