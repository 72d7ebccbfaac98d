"""What each owner has, and the removal of one."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from fastapi.testclient import TestClient

from modalmotion.cli.commands import main
from modalmotion.store import ResultStore, backup
from modalmotion_service.access.audit import BEGUN, AuditLog
from modalmotion_service.access.keys import KeyRing
from modalmotion_service.access.scopes import Scope
from modalmotion_service.app import create_app
from modalmotion_service.commands.owners import usage_of
from modalmotion_service.settings import Settings

NAMES = ("local", "lab", "ward-3")


def run(*words: object) -> Result:
    return CliRunner().invoke(main, ["owners", *map(str, words)])


@pytest.fixture
def folder(tmp_path: Path, beat: bytes) -> Path:
    """Of a service that three owners have sent something to."""
    settings = Settings(data_dir=tmp_path / "results", workers=1, wait_seconds=120.0)
    settings = settings.model_copy(update={"require_keys": True})
    with KeyRing(settings.data_dir) as ring, TestClient(create_app(settings)) as client:
        for number, name in enumerate(NAMES):
            token = ring.create(name, frozenset(Scope))[1]
            headers = {"Authorization": f"Bearer {token}"}
            for unit in ("mm", "cm", "m")[: number + 1]:
                sent = client.post(f"/v1/sequences?unit={unit}", content=beat, headers=headers)
                assert sent.status_code == 201
        link = sent.json()["links"]["self"]
        assert client.post(f"{link}/signatures", headers=headers).status_code == 201
    return settings.data_dir


def size_of(folder: Path, *without: str) -> int:
    """As the naive sum over all files."""
    return sum(
        path.stat().st_size
        for path in folder.rglob("*")
        if path.is_file() and path.relative_to(folder).parts[0] not in without
    )


def test_what_each_owner_has_is_listed_while_it_is_in_use(folder: Path) -> None:
    with ResultStore(folder), ResultStore(folder / "owners" / "lab"):
        found = {one["owner"]: one for one in usage_of(folder)}
        done = run("list", "--data-dir", folder)
        told = json.loads(run("list", "--json", "--data-dir", folder).stdout)
    assert [one["n_sequences"] for one in found.values()] == [1, 2, 3]
    assert [one["n_results"] for one in found.values()] == [0, 0, 1]
    assert [one["n_keys"] for one in found.values()] == [1, 1, 1]
    found = {one["owner"]: one for one in usage_of(folder)}
    assert found["local"]["n_bytes"] == size_of(folder, "access", "owners", "cluster")
    assert found["ward-3"]["n_bytes"] == size_of(folder / "owners" / "ward-3") > 100_000
    assert [one["owner"] for one in told] == list(found)
    assert [one["n_sequences"] for one in told] == [1, 2, 3]
    lines = done.stdout.splitlines()
    # Columns begin below their names, numbers end there.
    assert {line.rstrip().rfind("1") for line in lines[1:]} == {lines[0].index("keys") + 3}
    assert [line.split()[:2] for line in lines[1:]] == [
        [name, str(number + 1)] for number, name in enumerate(found)
    ]


def test_a_removed_owner_is_gone_with_keys_and_others_stay(folder: Path) -> None:
    done = run("remove", "lab", "--yes", "--data-dir", folder)
    assert done.exit_code == 0, done.output
    assert {one["owner"]: one["n_sequences"] for one in usage_of(folder)} == {
        "local": 1,
        "ward-3": 3,
    }
    assert [path.name for path in (folder / "owners").iterdir()] == ["ward-3"]
    with KeyRing(folder) as ring:
        assert {key.owner: key.state for key in ring.all()} == {
            "local": "active",
            "lab": "revoked",
            "ward-3": "active",
        }
    assert noted(folder)[-3:] == [
        ("lab", "owners remove", BEGUN),
        ("lab", "keys revoke", 200),
        ("lab", "owners remove", 200),
    ]
    with TestClient(create_app(Settings(data_dir=folder, workers=1))) as client:
        assert client.get("/health/ready").status_code == 200


def test_a_removed_owner_goes_from_the_backup_and_nothing_is_called_lost(
    folder: Path, tmp_path: Path
) -> None:
    copy = tmp_path / "copy"
    backup(folder, copy)
    assert run("remove", "lab", "--yes", "--data-dir", folder).exit_code == 0
    assert backup(folder, copy).missing == ()
    assert [path for path in (copy / "owners" / "lab").rglob("*") if path.is_file()] == []


def noted(folder: Path) -> list[tuple[str | None, str, int]]:
    with AuditLog(folder) as log:
        events = log.page(limit=100)[::-1]
    return [(event.owner, event.route, event.status) for event in events]


def test_nothing_is_removed_while_a_service_has_it_or_nobody_agrees(folder: Path) -> None:
    with ResultStore(folder / "owners" / "lab"):
        done = run("remove", "lab", "--yes", "--data-dir", folder)
        assert done.exit_code == 1
        assert "in use by process" in done.stderr
    assert noted(folder)[-2:] == [("lab", "owners remove", BEGUN), ("lab", "owners remove", 409)]
    refused = CliRunner().invoke(
        main, ["owners", "remove", "lab", "--data-dir", str(folder)], input="n\n"
    )
    assert refused.exit_code == 1
    assert [(one["n_sequences"], one["n_keys"]) for one in usage_of(folder)] == [
        (1, 1),
        (2, 1),
        (3, 1),
    ]


def test_a_removal_that_was_interrupted_is_finished(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_: Path) -> None:
        raise OSError(5, "Input/output error")

    with monkeypatch.context() as broken:
        broken.setattr(shutil, "rmtree", fail)
        done = run("remove", "lab", "--yes", "--data-dir", folder)
        assert done.exit_code == 1
        assert "Input/output error" in done.stderr
    settings = Settings(data_dir=folder, workers=1)
    with TestClient(create_app(settings)) as client:
        assert set(client.app.state.owners.states) == {"local", "ward-3"}  # type: ignore[attr-defined]
    assert run("remove", "lab", "--yes", "--data-dir", folder).exit_code == 0
    assert [path.name for path in (folder / "owners").iterdir()] == ["ward-3"]


@pytest.mark.parametrize(
    ("name", "said"), [("local", "data folder itself"), ("dora", "no owner"), ("../lab", "name")]
)
def test_what_is_no_owner_is_told(tmp_path: Path, name: str, said: str) -> None:
    (tmp_path / "lab").mkdir()
    done = run("remove", name, "--yes", "--data-dir", tmp_path)
    assert done.exit_code == 1
    assert said in done.stderr
    assert (tmp_path / "lab").is_dir()


def test_a_folder_that_is_none_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MODALMOTION_DATA_DIR", str(tmp_path / "missing"))
    done = run("list")
    assert done.exit_code == 1
    assert str(tmp_path / "missing") in done.stderr
