"""Keys: made, shown once, expired, taken back; the first one; requests that need none."""

from __future__ import annotations

import json
import re
import stat
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from access_parts import guarded
from click.testing import CliRunner
from fastapi.testclient import TestClient

from modalmotion.cli import main
from modalmotion.errors import NotFoundError, ParameterError
from modalmotion_service.access.audit import AuditLog
from modalmotion_service.access.keys import KeyRing
from modalmotion_service.access.rates import is_loopback
from modalmotion_service.access.scopes import Scope
from modalmotion_service.app import create_app
from modalmotion_service.commands.server import offer_first_key, secured, stated_key
from modalmotion_service.errors import AuthenticationError
from modalmotion_service.settings import Settings

READ = frozenset({Scope.READ})


def command(*words: str) -> str:
    run = CliRunner().invoke(main, list(words))
    assert run.exit_code == 0, run.output
    return run.stdout


def test_a_key_is_kept_as_a_hash_only(tmp_path: Path) -> None:
    with KeyRing(tmp_path) as ring:
        key, token = ring.create("clinic-1", READ, note="viewer")
        assert ring.authenticate(token) == key
        secret = token[len("mm_") + len(key.id) + len("_") :]
        assert len(secret) == 43  # 256 bits
        assert {ring.create("clinic-1", READ)[1] for _ in range(20)}.isdisjoint({token})
        files = list((tmp_path / "access").iterdir())
        assert not [path for path in files if secret.encode() in path.read_bytes()]
        assert stat.S_IMODE((tmp_path / "access").stat().st_mode) == 0o700
        assert {stat.S_IMODE(path.stat().st_mode) for path in files} == {0o600}


@pytest.mark.parametrize("change", ["", "x", "mm_", "last", "id", "scheme"])
def test_what_is_not_quite_a_key_is_none(tmp_path: Path, change: str) -> None:
    with KeyRing(tmp_path) as ring:
        _, token = ring.create("a", READ)
        last = "A" if token[-1] != "A" else "B"
        wrong = {
            "last": token[:-1] + last,
            "id": token[:3] + "0" * 16 + token[19:],
            "scheme": token + "=",
        }.get(change, change)
        with pytest.raises(AuthenticationError, match="not known"):
            ring.authenticate(wrong)


def test_a_key_ends_when_it_expires_or_is_taken_back(tmp_path: Path) -> None:
    with KeyRing(tmp_path) as ring:
        soon = datetime.now(UTC) + timedelta(seconds=0.05)
        _, short = ring.create("a", READ, expires=soon)
        key, token = ring.create("a", READ)
        while datetime.now(UTC) <= soon:
            pass
        with pytest.raises(AuthenticationError, match="expired"):
            ring.authenticate(short)
        first = ring.revoke(key.id).revoked
        assert ring.revoke(key.id).revoked == first
        with pytest.raises(AuthenticationError, match="revoked"):
            ring.authenticate(token)
        with pytest.raises(NotFoundError):
            ring.revoke("0" * 16)
        with pytest.raises(ParameterError, match="scope"):
            ring.create("a", frozenset())
        with pytest.raises(ParameterError, match="expired"):
            ring.create("a", READ, expires=soon)


@pytest.mark.parametrize("owner", ["", "..", "a/b", "A", "-a", "a" * 64, "a.b", "é", "a\n"])
def test_an_owner_is_a_name_that_can_be_a_folder(tmp_path: Path, owner: str) -> None:
    with KeyRing(tmp_path) as ring, pytest.raises(ParameterError, match="owner"):
        ring.create(owner, READ)


def test_the_commands_make_list_and_take_back_while_the_service_runs(tmp_path: Path) -> None:
    with guarded(tmp_path) as service:
        here = ("--data-dir", str(tmp_path))
        token = command("keys", "create", "--owner", "lab", "--scopes", "read,write", *here)
        header = {"Authorization": f"Bearer {token.strip()}"}
        assert service.client.get("/v1/sequences", headers=header).status_code == 200
        also = {"X-API-Key": token.strip()}
        assert service.client.get("/v1/sequences", headers=also).status_code == 200
        listed = command("keys", "list", *here)
        assert token.strip() not in listed
        assert listed.split()[:3] == ["key", "state", "owner"]
        key_id = listed.splitlines()[1].split()[0]
        (kept,) = json.loads(command("keys", "list", "--json", *here))
        assert (kept["id"], kept["state"]) == (key_id, "active")
        assert kept["scopes"] == ["read", "write"]
        assert "hash" not in kept
        assert "active" in listed
        assert "read,write" in listed
        assert "revoked" in command("keys", "revoke", key_id, *here)
        answer = service.client.get("/v1/sequences", headers=header)
        assert (answer.status_code, answer.json()["code"]) == (401, "unauthenticated")
        assert answer.headers["www-authenticate"].startswith("Bearer")


@pytest.mark.parametrize(
    "words",
    [
        ["--scopes", "all"],
        ["--scopes", "read", "--expires", "soon"],
        ["--scopes", "read", "--expires", "9999-12-31T23:59:59-14:00"],
        [],
    ],
)
def test_the_command_refuses_what_it_does_not_understand(tmp_path: Path, words: list[str]) -> None:
    arguments = ["keys", "create", "--owner", "lab", *words, "--data-dir", str(tmp_path)]
    assert CliRunner().invoke(main, arguments).exit_code == 2


def test_an_expiry_is_days_or_a_time(tmp_path: Path) -> None:
    for expiry in ("90d", "2999-12-31", "2999-12-31T12:00:00+01:00"):
        command(
            *("keys", "create", "--owner", "lab", "--scopes", "read", "--expires", expiry),
            *("--data-dir", str(tmp_path)),
        )
    with KeyRing(tmp_path) as ring:
        ends = [key.expires for key in ring.all()]
    assert ends[1] == "2999-12-31T00:00:00.000000Z"
    assert ends[2] == "2999-12-31T11:00:00.000000Z"


def offered(settings: Settings) -> None:
    with KeyRing(settings.data_dir) as ring, AuditLog(settings.data_dir) as log:
        offer_first_key(settings, ring, log)


def test_the_first_key_comes_from_a_file_and_is_not_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    token = f"mm_{'0a' * 8}_{'Ab-_' * 10}abc"
    file = tmp_path / "secret"
    file.write_text(f"{token}\nanything")
    settings = Settings(data_dir=tmp_path / "d", require_keys=True, first_key_file=file)
    offered(settings)
    assert capsys.readouterr().out == ""
    with KeyRing(settings.data_dir) as ring:
        assert ring.authenticate(token).scopes == frozenset(Scope)
    for content in ("", "mm_short", "mm_\u00e9", f"x{token}"):
        file.write_text(content)
        with pytest.raises(ParameterError, match="has no key") as caught:
            stated_key(file)
        assert token not in str(caught.value)
    with pytest.raises(ParameterError, match="No such file"):
        stated_key(tmp_path / "absent")


def test_the_first_key_is_made_and_shown_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    settings = Settings(data_dir=tmp_path, workers=1)
    offered(secured(settings, "127.0.0.1"))
    assert capsys.readouterr().out == ""
    open_to_all = secured(settings, "0.0.0.0")  # noqa: S104 (nothing listens)
    offered(open_to_all)
    found = re.search(r"mm_\S+", capsys.readouterr().out)
    assert found is not None
    offered(open_to_all)
    assert capsys.readouterr().out == ""
    with TestClient(create_app(open_to_all)) as client:
        assert client.get("/v1/sequences").status_code == 401
        header = {"Authorization": f"Bearer {found[0]}"}
        assert client.get("/v1/audit", headers=header).status_code == 200


@pytest.mark.parametrize(
    ("host", "answer"),
    [
        *(("127.0.0.1", True), ("127.8.8.8", True), ("::1", True), ("localhost", True)),
        *(("0.0.0.0", False), ("::", False), ("10.0.0.1", False), ("", False)),  # noqa: S104
        ("localhost.example", False),
    ],
)
def test_only_loopback_addresses_need_no_key(host: str, answer: bool) -> None:
    assert is_loopback(host) is answer


@pytest.mark.every(3)
@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({}, 200),
        ({"Host": "localhost:8000"}, 200),
        ({"Host": "127.0.0.1"}, 200),
        ({"Host": "[::1]:8000"}, 200),
        ({"Host": "localhost:8000", "Origin": "http://localhost:8000"}, 200),
        ({"Sec-Fetch-Site": "same-origin"}, 200),
        ({"Host": "rebound.example"}, 403),
        ({"Host": "rebound.example:8000"}, 403),
        ({"Host": "localhost@rebound.example"}, 403),
        ({"Host": "localhost.rebound.example"}, 403),
        ({"Host": ""}, 403),
        ({"Host": "localhost:8000", "Origin": "http://other.example"}, 403),
        ({"Host": "localhost:8000", "Origin": "http://localhost:9000"}, 403),
        ({"Origin": "null"}, 403),
        ({"Sec-Fetch-Site": "cross-site"}, 403),
        ({"Sec-Fetch-Site": "same-site"}, 403),
        ({"Authorization": "Basic abc"}, 401),
        ({"Authorization": "Bearer "}, 401),
        ({"X-API-Key": "wrong"}, 401),
    ],
)
def test_without_a_key_only_this_machine_and_no_page_of_another_site(
    client: TestClient, headers: dict[str, str], status: int
) -> None:
    assert client.get("/v1/sequences", headers=headers).status_code == status


def test_an_address_that_others_reach_needs_keys_whatever_the_settings_say(
    tmp_path: Path,
) -> None:
    app = create_app(Settings(data_dir=tmp_path, workers=1))
    with TestClient(app, base_url="http://192.0.2.7") as client:
        assert client.get("/v1/sequences").status_code == 401
        spoofed = {"Host": "127.0.0.1", "X-Forwarded-For": "127.0.0.1"}
        assert client.get("/v1/sequences", headers=spoofed).status_code == 401
        assert client.get("/health/ready").status_code == 200
