"""The commands of docs/operations.md run, in their order, beside a service in use."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import click
import pytest
from click.testing import CliRunner
from running import RunningService

from modalmotion.cli.main import main
from modalmotion_service.settings import Settings

ROOT = Path(__file__).resolve().parents[2]
DOCUMENT = (ROOT / "docs" / "operations.md").read_text()


def commands(heading: str) -> list[str]:
    section = DOCUMENT.partition(f"## {heading}\n")[2].partition("\n## ")[0]
    found = re.findall(r"^```sh\n(.*?)^```", section, flags=re.MULTILINE | re.DOTALL)
    return [line.split("  #")[0].strip() for block in found for line in block.splitlines()]


def run(command: str) -> str:
    program, *arguments = command.split()
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
        assert said.rstrip().endswith("sound")
        service.start()
        assert service.request("GET", link).json["subject"] == "P1"
        assert service.request("GET", f"{link}/signature", timeout=150).json == before
    finally:
        service.stop()


def test_every_setting_that_is_named_exists() -> None:
    for name in re.findall(r"`MODALMOTION_([A-Z_]+)`", DOCUMENT):
        assert name.lower() in Settings.model_fields, name


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
