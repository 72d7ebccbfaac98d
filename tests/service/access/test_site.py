"""Keys with a service of its own process, and stores of owners from the command line."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import pytest
from access_parts import guarded
from click.testing import CliRunner, Result
from project import ROOT
from running import RunningService

from modalmotion.cli import main
from modalmotion.formats import read_npz
from modalmotion_service.access.audit import AuditLog, Event
from modalmotion_service.access.keys import KeyRing
from modalmotion_service.access.scopes import Scope


def command(*words: str) -> Result:
    return CliRunner().invoke(main, list(words))


def test_a_service_that_needs_keys_shows_its_first_one_once(tmp_path: Path, beat: bytes) -> None:
    service = RunningService(tmp_path / "results", {"REQUIRE_KEYS": "true", "WORKERS": "1"})
    try:
        service.start()
        shown = re.findall(r"mm_[0-9a-f]{16}_[A-Za-z0-9_-]{43}", service.log.read_text())
        assert len(shown) == 1
        key = {"Authorization": f"Bearer {shown[0]}"}
        assert service.request("GET", "/v1/sequences").status == 401
        assert service.request("GET", "/v1/audit", None, key).status == 200

        here = ("--data-dir", str(service.data_dir))
        made = command("keys", "create", "--owner", "lab", "--scopes", "read,write", *here)
        token = made.stdout.strip()
        lab = {"X-API-Key": token}
        known = service.request("POST", "/v1/sequences", beat, lab).json["id"]
        assert known == read_npz(beat).sequence.id
        assert service.request("GET", f"/v1/sequences/{known}", None, key).status == 404
        assert service.request("GET", "/v1/audit", None, lab).status == 403
        command("keys", "revoke", token[3:19], *here)
        assert service.request("GET", f"/v1/sequences/{known}", None, lab).status == 401
        assert service.terminate()

        service.start()
        text = service.log.read_text()
        assert text.count("mm_") == 1
        lines = [json.loads(line) for line in text.splitlines() if line.startswith("{")]
        assert len(lines) > 10
        assert service.terminate()
    finally:
        service.stop()

    folder = str(service.data_dir)
    own = command("store", "verify", folder)
    assert (own.exit_code, "orphans" in own.output) == (0, False)
    assert re.search(r"sequences +0\n", own.output)
    for word in ("verify", "rebuild"):
        done = command("store", word, folder, "--owner", "lab")
        assert re.search(r"sequences +1\n", done.output)
    out = str(tmp_path / "out.h5")
    packed = command("store", "export", folder, out, "--owner", "lab")
    assert (packed.exit_code, "has no signatures" in packed.output) == (1, True)
    for owner in ("nobody", "..", "lab/../lab", ""):
        assert command("store", "verify", folder, "--owner", owner).exit_code == 2
    assert command("audit", "unfinished", "--data-dir", folder).output == ""


def test_the_documented_commands_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MODALMOTION_DATA_DIR", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    with KeyRing(tmp_path) as ring, AuditLog(tmp_path) as log:
        key_id = ring.create("lab", [Scope.READ])[0].id
        log.append([Event("r", "lab", key_id, "127.0.0.1", "GET", "/v1/sequences", "", 200)])
    given = {"ID": key_id}
    text = (ROOT / "docs" / "access.md").read_text()
    lines = re.findall(r"^modalmotion .*$", text, flags=re.MULTILINE)
    assert len(lines) == 5
    for line in lines:
        words = [given.get(word, word) for word in shlex.split(line)[1:]]
        assert command(*words).exit_code == 0, line


def test_one_damaged_store_keeps_no_other_closed(tmp_path: Path, beat: bytes) -> None:
    with guarded(tmp_path) as service:
        for owner in ("good", "hurt"):
            assert service.ask(owner, "POST", "/v1/sequences", content=beat).status_code == 201
    (tmp_path / "owners" / "hurt" / "index.sqlite").write_bytes(b"nonsense" * 1000)
    with guarded(tmp_path) as service:
        assert len(service.ask("good", "GET", "/v1/sequences").json()["sequences"]) == 1
        answer = service.ask("hurt", "GET", "/v1/sequences")
        assert (answer.status_code, answer.json()["code"]) == (500, "corrupt_file")
        assert service.client.get("/health/ready").status_code == 200
    assert command("store", "rebuild", str(tmp_path), "--owner", "hurt").exit_code == 0
    with guarded(tmp_path) as service:
        assert len(service.ask("hurt", "GET", "/v1/sequences").json()["sequences"]) == 1


@pytest.mark.every(3)
@pytest.mark.parametrize(
    "origin",
    [
        *("file://127.0.0.1", "file://", "null", "ftp://127.0.0.1", "chrome-extension://127.0.0.1"),
        *("http://127.0.0.1.evil.example", "http://evil.example", "127.0.0.1", "://127.0.0.1", ""),
        *("http://127.0.0.1:8000", "http:127.0.0.1", "HTTP://127.0.0.1/", "javascript://127.0.0.1"),
    ],
)
def test_only_pages_of_this_very_place_ask_without_a_key(tmp_path: Path, origin: str) -> None:
    with guarded(tmp_path, require_keys=False) as service:
        client = service.client
        for allowed in ("http://127.0.0.1", "https://127.0.0.1"):
            headers = {"Host": "127.0.0.1", "Origin": allowed}
            assert client.get("/v1/limits", headers=headers).status_code == 200
        answer = client.get("/v1/sequences", headers={"Host": "127.0.0.1", "Origin": origin})
        assert (answer.status_code, answer.json()["code"]) == (403, "forbidden")
