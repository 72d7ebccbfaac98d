"""What is wrong in the environment is said by its name, and costs no traceback."""

from __future__ import annotations

import json
import os
import resource
import socket
import stat
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner
from running import RunningService

from modalmotion.cli.commands import main
from modalmotion.errors import ParameterError
from modalmotion_service.access.keys import KeyRing
from modalmotion_service.settings import Settings, read_settings, unknown_variables


def test_values_that_are_none_are_all_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MODALMOTION_WORKERS", "0")
    monkeypatch.setenv("MODALMOTION_KEEP_UPLOADS", "perhaps")
    with pytest.raises(ParameterError) as caught:
        read_settings()
    assert "MODALMOTION_WORKERS is '0'" in caught.value.message
    assert "MODALMOTION_KEEP_UPLOADS is 'perhaps'" in caught.value.message
    assert caught.value.remedy
    assert read_settings(workers=3, keep_uploads=False).workers == 3


@pytest.mark.parametrize("command", [["serve"], ["keys", "list"], ["settings"]])
def test_no_command_answers_with_a_traceback(
    command: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MODALMOTION_WORKERS", "none")
    run = CliRunner().invoke(main, command)
    assert run.exit_code == 1
    assert run.stderr.startswith("Error: MODALMOTION_WORKERS is 'none'")
    assert len(run.stderr.splitlines()) == 1


def test_all_settings_are_listed_with_values_defaults_and_meanings(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("MODALMOTION_WORKERS", "3")
    monkeypatch.setenv("MODALMOTION_CORS_ORIGINS", '["https://viewer.example"]')
    runner = CliRunner()
    listed = json.loads(runner.invoke(main, ["settings", "--json"]).stdout)
    assert [one["variable"] for one in listed] == [
        f"MODALMOTION_{name.upper()}" for name in Settings.model_fields
    ]
    assert all(one["meaning"] for one in listed)
    by_name = {one["variable"]: one["value"] for one in listed}
    assert by_name["MODALMOTION_WORKERS"] == 3
    assert by_name["MODALMOTION_CORS_ORIGINS"] == ["https://viewer.example"]
    shown = runner.invoke(main, ["settings"]).stdout
    assert "MODALMOTION_WORKERS = 3 (default:" in shown
    assert 'MODALMOTION_LOG_LEVEL = "info"\n' in shown
    helped = runner.invoke(main, ["serve", "--help"]).stdout
    assert all(one["variable"] in helped for one in listed)


def test_a_start_that_fails_shows_no_key(tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        run = subprocess.run(
            [
                *(sys.executable, "-m", "modalmotion", "serve", "--port"),
                *(str(taken.getsockname()[1]), "--data-dir", str(tmp_path)),
            ],
            env={**os.environ, "MODALMOTION_REQUIRE_KEYS": "true", "MODALMOTION_WORKERS": "1"},
            capture_output=True,
            text=True,
            check=False,
        )
    assert run.returncode != 0
    assert "mm_" not in run.stdout + run.stderr
    with KeyRing(tmp_path) as ring:
        assert ring.all() == []


def test_a_misspelt_setting_is_found_and_what_is_no_setting_is_let_be() -> None:
    environment = {
        "MODALMOTION_REQUIRE_KEY": "true",
        "modalmotion_workers": "2",
        "MODALMOTION_SCHEDULER": "",
        "MODALMOTION_ZZZ": "1",
        "MODALMOTION_SERVICE_HOST": "10.0.0.1",
        "MODALMOTION_PORT_8000_TCP": "tcp://10.0.0.1:8000",
        "PATH": "/bin",
    }
    assert dict(unknown_variables(environment)) == {
        "MODALMOTION_REQUIRE_KEY": "MODALMOTION_REQUIRE_KEYS",
        "MODALMOTION_ZZZ": "",
    }


def test_a_started_service_is_private_warns_and_opens_many_files(tmp_path: Path) -> None:
    service = RunningService(
        tmp_path / "results", {"WORKERS": "1", "REQUIRE_KEY": "true"}, is_warm=False
    )
    try:
        service.start()
        assert service.process is not None
        lines = [json.loads(line) for line in service.log.read_text().splitlines()]
        (warning,) = [line for line in lines if line["level"] == "warning"]
        assert warning["variable"] == "MODALMOTION_REQUIRE_KEY"
        assert warning["nearest"] == "MODALMOTION_REQUIRE_KEYS"
        for path in (service.data_dir, *service.data_dir.rglob("*")):
            assert not stat.S_IMODE(path.stat().st_mode) & 0o077, path
        soft, hard = resource.prlimit(service.process.pid, resource.RLIMIT_NOFILE)
        assert soft >= min(hard if hard != resource.RLIM_INFINITY else 65_536, 65_536)
    finally:
        service.stop()
