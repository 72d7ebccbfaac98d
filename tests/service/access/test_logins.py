"""Logins beside keys: signed by the issuer, for this service, valid now; else refused."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import json
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from identity_provider import IdentityProvider

from modalmotion.errors import ParameterError
from modalmotion_service.access import logins as provider_module
from modalmotion_service.access.logins import Provider, is_login, logins_of
from modalmotion_service.app import create_app
from modalmotion_service.errors import AuthenticationError, ProviderError
from modalmotion_service.settings import Settings

pytest.importorskip("jwt")
pytest.importorskip("cryptography")


@pytest.fixture(scope="module")
def issuer() -> Iterator[IdentityProvider]:
    own = IdentityProvider()
    own.rotate("first")
    yield own
    own.close()


@pytest.fixture(scope="module")
def data_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("logins") / "data"


@pytest.fixture(scope="module")
def client(issuer: IdentityProvider, data_dir: Path) -> Iterator[TestClient]:
    settings = Settings(
        data_dir=data_dir,
        workers=1,
        require_keys=True,
        oidc_issuer=issuer.issuer,
        oidc_audience="modalmotion",
        max_failures_per_minute=10_000,
    )
    with TestClient(create_app(settings), raise_server_exceptions=False) as client:
        yield client


def ask(client: TestClient, token: str, method: str = "GET", path: str = "/v1/sequences") -> Any:
    return client.request(method, path, headers={"Authorization": f"Bearer {token}"})


def test_a_login_opens_a_store_of_its_own_by_its_scopes(
    client: TestClient, issuer: IdentityProvider, data_dir: Path
) -> None:
    assert ask(client, issuer.token("first")).status_code == 200
    other = issuer.token("first", sub="john")
    assert ask(client, other).status_code == 200
    folders = sorted(path.name for path in (data_dir / "owners").iterdir())
    assert len(folders) == 2
    assert all(name.startswith("oidc-") for name in folders)
    written = b"".join(path.read_bytes() for path in data_dir.rglob("*") if path.is_file())
    assert b"jane.doe" not in written
    lacking = ask(client, issuer.token("first"), "POST", "/v1/models")
    assert (lacking.status_code, lacking.json()["scope"]) == (403, "train")
    scopes: dict[str, Any]
    for scopes in (
        {"scope": None, "scp": ["modalmotion:read"]},
        {"scope": None, "scp": "modalmotion:read x"},
    ):
        assert ask(client, issuer.token("first", **scopes)).status_code == 200
    for scopes in ({"scope": "read"}, {"scope": None}, {"scope": 7}, {"scope": ["a", 3]}):
        token = issuer.token("first", **scopes)
        assert ask(client, token).status_code == 403
    # Keys go on as before.
    assert ask(client, "mm_" + "0" * 16 + "_" + "A" * 43).status_code == 401


def test_roles_and_groups_open_scopes_and_the_audit_may_name_people(
    issuer: IdentityProvider, tmp_path: Path
) -> None:
    settings = Settings(
        data_dir=tmp_path,
        workers=1,
        require_keys=True,
        oidc_issuer=issuer.issuer,
        oidc_audience="modalmotion",
        oidc_roles={"cardiology": "read, write", "it": "admin"},
        oidc_name_claim="preferred_username",
    )
    bare: dict[str, Any] = {"scope": None, "preferred_username": "jane.doe@ward"}
    claims: dict[str, Any]
    with TestClient(create_app(settings)) as client:
        for claims in (
            {"roles": ["cardiology", "it"]},
            {"groups": ["it", "cardiology", 3]},
            {"realm_access": {"roles": ["it", "cardiology"]}},
            {"roles": ["modalmotion:read", "it"]},
        ):
            token = issuer.token("first", **bare, **claims)
            assert ask(client, token).status_code == 200, claims
            assert ask(client, token, path="/v1/audit").status_code == 200, claims
        for claims in ({"roles": ["surgery"]}, {"realm_access": ["cardiology"]}, {"groups": 7}):
            assert ask(client, issuer.token("first", **bare, **claims)).status_code == 403, claims
        # A name that could break a line of the log counts for nothing.
        odd = issuer.token("first", scope="modalmotion:read", preferred_username="a\nb")
        assert ask(client, odd).status_code == 200
        admin = issuer.token("first", **bare, roles=["it"])
        entries = ask(client, admin, path="/v1/audit").json()["entries"]
    people = {entry["key_id"].partition(":")[2] for entry in entries}
    assert people == {"jane.doe@ward", ""}


def stated(issuer: str, **more: Any) -> Settings:
    return Settings(oidc_issuer=issuer, oidc_audience="modalmotion", oidc_scope_prefix="", **more)


def test_a_role_with_what_is_no_scope_is_refused_at_the_start() -> None:
    with pytest.raises(ParameterError, match="the role 'x' the scopes 'reed'"):
        logins_of(stated("https://a.example", oidc_roles={"x": "reed"}))


def unsigned(claims: dict[str, Any], **head: Any) -> str:
    def part(value: dict[str, Any]) -> str:
        return base64.urlsafe_b64encode(json.dumps(value).encode()).decode().rstrip("=")

    return f"{part(head)}.{part(claims)}."


def wrong_tokens(issuer: IdentityProvider) -> dict[str, tuple[str, str]]:
    now = int(time.time())
    stranger = IdentityProvider()
    stranger.rotate("first")
    of_stranger = stranger.token("first", iss=issuer.issuer)
    stranger.close()
    good = issuer.token("first")
    head, body, signature = good.split(".")
    claims = json.loads(base64.urlsafe_b64decode(body + "=="))
    public = issuer.published["first"]["n"]
    return {
        "expired": (issuer.token("first", exp=now - 120), "has expired"),
        "not yet": (issuer.token("first", nbf=now + 120), "not valid yet"),
        "of the future": (issuer.token("first", iat=now + 120), "not valid yet"),
        "audience": (issuer.token("first", aud="other"), "another service"),
        "no audience": (issuer.token("first", aud=None), "not valid"),
        "issuer": (issuer.token("first", iss="http://127.0.0.1:1"), "another issuer"),
        "no end": (issuer.token("first", exp=None), "not valid"),
        "no subject": (issuer.token("first", sub=None), "not valid"),
        "stranger": (of_stranger, "not valid"),
        "none": (unsigned(claims, alg="none", kid="first"), "not accepted"),
        "no algorithm": (unsigned(claims, kid="first"), "not accepted"),
        "secret": (
            issuer.token("first", algorithm="HS256", key=public.ljust(64)),
            "not accepted",
        ),
        "curve": (unsigned(claims, alg="ES256", kid="first") + signature, "not valid"),
        "no key": (unsigned(claims, alg="RS256"), "names no key"),
        "unknown key": (unsigned(claims, alg="RS256", kid="?"), "does not have"),
        "changed": (f"{head}.{body[:-4]}AAAA.{signature}", "not valid"),
        "garbage": ("a.b.c", "does not read"),
    }


def test_every_other_token_is_refused_with_a_remedy(
    client: TestClient, issuer: IdentityProvider
) -> None:
    for name, (token, why) in wrong_tokens(issuer).items():
        answer = ask(client, token)
        assert answer.status_code == 401, name
        assert why in answer.json()["detail"], name
        assert "Log in again" in answer.json()["remedy"]
    # Clocks differ by less than a minute.
    now = int(time.time())
    assert ask(client, issuer.token("first", exp=now - 30, nbf=now + 30)).status_code == 200


def test_keys_rotate_and_those_that_are_withdrawn_end(
    issuer: IdentityProvider,
) -> None:
    time_of = [0.0]
    logins = logins_of(stated(issuer.issuer))
    assert logins is not None
    keys = Provider(issuer.issuer, clock=lambda: time_of[0])

    async def known(key_id: str) -> bool:
        return await keys.key(key_id) is not None

    async def story() -> None:
        issuer.rotate("a")
        assert await known("a")
        for kind in ("EC", "OKP"):
            issuer.rotate(kind, kind)
            # At once again: the provider is asked no more than every ten seconds.
            n = len(issuer.requests)
            assert not await known(kind)
            assert len(issuer.requests) == n
            time_of[0] += 11
            assert await known(kind)
        assert not await known("a")
        algorithm = {"EC": "ES256", "OKP": "EdDSA"}["OKP"]
        token = issuer.token("OKP", algorithm=algorithm, scope="read")
        assert (await logins.principal(token)).scopes == {"read"}
        # Withdrawn without a new one: known until the keys are fetched again.
        issuer.published = {}
        assert await known("OKP")
        time_of[0] += provider_module.REFRESH_SECONDS + 1
        assert not await known("OKP")
        issuer.rotate("b")
        time_of[0] += 11
        assert await known("b")
        issuer.is_down = True
        time_of[0] += 3600
        assert await known("b")
        time_of[0] += 86_400
        with pytest.raises(ProviderError) as caught:
            await known("b")
        assert caught.value.remedy
        issuer.is_down = False
        issuer.stated = "http://somebody-else"
        time_of[0] += 11
        with pytest.raises(ProviderError):
            await known("b")
        issuer.stated = issuer.issuer
        # Keys that come over a line that others can change.
        issuer.keys_at = "http://keys.example/keys"
        time_of[0] += 11
        with pytest.raises(ProviderError):
            await known("b")
        issuer.keys_at = f"{issuer.issuer}/keys"
        time_of[0] += 11
        assert await known("b")

    asyncio.run(story())
    issuer.rotate("first")


def test_an_issuer_whose_documents_nest_without_end_has_no_keys(
    client: TestClient, issuer: IdentityProvider
) -> None:
    own = IdentityProvider()
    own.rotate("first")
    own.nesting = 100_000
    keys = Provider(own.issuer)
    assert asyncio.run(keys.key("first")) is None
    own.close()
    # So do claims.
    deep = b'{"a":' + b"[" * 5_000 + b"]" * 5_000 + b"}"
    head, _, _ = issuer.token("first").split(".")
    signed = f"{head}.{base64.urlsafe_b64encode(deep).decode().rstrip('=')}"
    signature = issuer.sign("first", signed.encode())
    answer = ask(client, f"{signed}.{base64.urlsafe_b64encode(signature).decode().rstrip('=')}")
    assert answer.status_code == 401
    assert "not valid" in answer.json()["detail"]


def test_a_slow_issuer_holds_nobody_longer_than_one_deadline(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(provider_module, "_TIMEOUT", 0.2)
    own = IdentityProvider()
    own.rotate("first")
    own.seconds_between_bytes = 0.02
    time_of = [0.0]
    keys = Provider(own.issuer, clock=lambda: time_of[0])

    async def story() -> None:
        for _ in range(3):
            with pytest.raises(ProviderError):
                await keys.key("first")
            time_of[0] += 11
        # Asked once, however often somebody waits; what comes late is there for the next.
        assert len(own.requests) == 1
        own.seconds_between_bytes = 0.0
        found = None
        while found is None:
            time_of[0] += 11
            with contextlib.suppress(ProviderError):
                found = await keys.key("first")

    asyncio.run(story())
    own.close()


def test_a_short_key_of_rsa_signs_nothing() -> None:
    own = IdentityProvider()
    own.rotate("short", n_bits=1024)
    logins = logins_of(stated(own.issuer))
    assert logins is not None
    with warnings.catch_warnings():
        # Of PyJWT, which signs with it all the same.
        warnings.simplefilter("ignore")
        token = own.token("short")
    with pytest.raises(AuthenticationError, match="less than 2048 bits"):
        asyncio.run(logins.principal(token))
    own.close()


def test_many_at_once_ask_the_provider_once(issuer: IdentityProvider) -> None:
    keys = Provider(issuer.issuer)
    n = len(issuer.requests)

    async def story() -> None:
        await asyncio.gather(*(keys.key(f"unknown {k}") for k in range(50)))

    asyncio.run(story())
    assert len(issuer.requests) == n + 2


def test_a_setting_that_is_none_is_told_at_the_start(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="OIDC_AUDIENCE"):
        create_app(Settings(data_dir=tmp_path, oidc_issuer="https://login.example"))
    for issuer in ("http://login.example", "ftp://login.example", "login.example", "https://"):
        with pytest.raises(ParameterError, match="no address"):
            Provider(issuer)
    assert logins_of(Settings()) is None
    assert not is_login("mm_" + "0" * 16 + "_" + "A" * 43)
    assert not is_login("a.b")
