"""The commands of docs/operations.md run, in their order, beside a service in use."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import click
import pytest
from click.testing import CliRunner
from project import ROOT
from running import RunningService

from modalmotion.cli.commands import main
from modalmotion_service.access.keys import KeyRing
from modalmotion_service.settings import Settings

DOCUMENT = (ROOT / "docs" / "operations.md").read_text()


def blocks(heading: str, language: str) -> list[str]:
    section = DOCUMENT.partition(f"## {heading}\n")[2].partition("\n## ")[0]
    return re.findall(rf"^```{language}\n(.*?)^```", section, flags=re.MULTILINE | re.DOTALL)


def commands(heading: str) -> list[str]:
    found = blocks(heading, "sh")
    return [line.split("  #")[0].strip() for block in found for line in block.splitlines()]


def native(command: str) -> str:
    """The command inside a container, or for another user, as one for this folder."""
    inner = re.sub(
        r"^(docker compose (exec|run --rm -v \S+) modalmotion|sudo -u modalmotion) ", "", command
    )
    for there, here in (
        ("/var/lib/modalmotion/results", "results"),
        ("/data/results", "results"),
        ("/backup/results", "of-container"),
    ):
        inner = inner.replace(there, here)
    return inner


def run(command: str) -> str:
    program, *arguments = native(command).split()
    if program == "modalmotion":
        said = CliRunner().invoke(main, arguments)
        assert said.exit_code == 0, f"{command}: {said.output}"
        return said.stdout
    assert program in ("mv", "cp")
    done = subprocess.run([program, *arguments], capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{command}: {done.stdout} {done.stderr}"
    return done.stdout


def test_a_backup_made_in_use_is_restored_by_the_documented_commands(
    tmp_path: Path, beat: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    service = RunningService(tmp_path / "results", {"WORKERS": "1", "WAIT_SECONDS": "120"})
    try:
        service.start()
        answer = service.request("POST", "/v1/sequences?subject=P1", beat, timeout=150)
        link = answer.json["links"]["self"]
        before = service.request("GET", f"{link}/signature", timeout=150).json
        for command in commands("Back up"):
            run(command)
        # The disk is lost with everything on it.
        service.kill()
        shutil.rmtree(tmp_path / "results")
        (tmp_path / "results").mkdir()
        for command in commands("Restore"):
            said = run(command)
        assert re.search(r"is sound +yes", said)
        service.start()
        assert service.request("GET", link).json["subject"] == "P1"
        assert service.request("GET", f"{link}/signature", timeout=150).json == before
    finally:
        service.stop()


def test_keys_are_made_and_data_is_taken_away_by_the_documented_commands(
    tmp_path: Path, beat: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MODALMOTION_DATA_DIR", "results")
    service = RunningService(tmp_path / "results", {"WORKERS": "1", "REQUIRE_KEYS": "true"})
    try:
        service.start()
        create, *lists = commands("One machine")
        key = run(create).strip()
        for command in lists:
            assert re.search(r"lab +read,write", run(command))
        header = {"Authorization": f"Bearer {key}"}
        for subject, unit in (("P%207", "mm"), ("P%207", "cm"), ("P%208", "m")):
            path = f"/v1/sequences?subject={subject}&unit={unit}"
            assert service.request("POST", path, beat, header, 150).status == 201
        show, remove = commands("Owners and deletion")
        assert re.search(r"^lab +3 ", run(show), re.MULTILINE)
        (code,) = blocks("Owners and deletion", "python")
        exec(code.replace(":8000", f":{service.port}"), {"KEY": key})  # noqa: S102 (our own document)
        left = service.request("GET", "/v1/sequences", None, header).json["sequences"]
        assert [one["subject"] for one in left] == ["P 8"]
        service.stop()
        run(remove)
        assert re.search(r"^lab ", run(show), re.MULTILINE) is None
        with KeyRing(tmp_path / "results") as ring:
            assert {one.state for one in ring.all() if one.owner == "lab"} == {"revoked"}
    finally:
        service.stop()


def test_files_of_deploy_that_are_named_are_there() -> None:
    named = re.findall(r"`(deploy/[^`]+)`", DOCUMENT)
    assert len(named) > 3
    for name in named:
        assert (ROOT / name).is_file(), name


def test_every_setting_that_is_named_exists() -> None:
    for name in re.findall(r"`MODALMOTION_([A-Z_]+)`", DOCUMENT):
        # The codec reads its own, for it knows no service.
        assert name == "KERNELS" or name.lower() in Settings.model_fields, name


def test_every_command_that_is_named_exists() -> None:
    for heading in ("Several machines", "Many files"):
        listed = commands(heading)
        assert listed
        for command in listed:
            words = command.split()
            if "modalmotion" not in words:
                continue
            name = words[words.index("modalmotion") + 1]
            found = main.get_command(click.Context(main), name)
            assert found is not None, command
            # Some are imported when they are called.
            context = found.make_context(name, [], resilient_parsing=True)
            params = context.command.params
            options = {option for parameter in params for option in parameter.opts}
            assert options >= set(re.findall(r"--[a-z-]+", command)), command
