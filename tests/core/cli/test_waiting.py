"""Who waits is told for what, and the times add up to what was waited."""

from __future__ import annotations

import re
import subprocess
import sys
import time
from pathlib import Path

import pytest

from modalmotion.cli import waiting
from modalmotion.cli.waiting import Waiting
from modalmotion.formats import write_npz
from modalmotion.simulate import simulate_ventricle


@pytest.mark.every(2)
@pytest.mark.parametrize("command", ["signature", "tradeoff"])
def test_the_times_of_a_command_add_up_to_what_was_waited(tmp_path: Path, command: str) -> None:
    file = tmp_path / "beat.npz"
    file.write_bytes(write_npz(simulate_ventricle()))
    start = time.perf_counter()
    run = subprocess.run(
        [sys.executable, "-m", "modalmotion", command, str(file), "--modes", "7", "-v"],
        capture_output=True,
        text=True,
        check=True,
    )
    waited = time.perf_counter() - start
    (line,) = re.findall(r"^time: (.*)$", run.stdout, flags=re.MULTILINE)
    parts, total = line.removesuffix(" s in all").split("; ")
    stages = dict(re.findall(r"([a-z]+) ([0-9.]+) ms", parts))
    assert {"start", "read", "template", "other"} <= stages.keys()
    assert sum(map(float, stages.values())) / 1e3 == pytest.approx(float(total), abs=0.06)
    # Less is missing than the interpreter takes to begin and to end.
    assert waited - 0.5 * waited < float(total) <= waited + 0.1


def test_a_stage_that_lasts_is_named_once_where_there_is_no_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(waiting, "_PATIENCE_SECONDS", 0.01)
    with Waiting(Path(__file__)) as long:
        for name in ("read", "template", "fit"):
            with long.watch.stage(name):
                time.sleep(0.06)
    assert capsys.readouterr().err.split() == ["read", "...", "template", "...", "fit", "..."]
    # Frames that are files of their own have a bar of their own.
    with Waiting(tmp_path) as folder, folder.watch.stage("read"):
        time.sleep(0.06)
    assert capsys.readouterr().err == ""


def test_on_a_terminal_the_seconds_go_by(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(waiting, "_PATIENCE_SECONDS", 0.01)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with Waiting(Path(__file__)) as long, long.watch.stage("fit") as report:
        time.sleep(0.05)
        report(0.4)
        time.sleep(0.05)
    said = capsys.readouterr().err
    assert said.count("\rfit 0 s") > 2
    assert said.count("\rfit 0 s, 40%") > 1
    assert "0%" not in said.partition("40%")[0]
    # The line is taken away at the end.
    assert re.search(r"\r +\r$", said)


def test_what_is_quick_says_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    with Waiting(Path(__file__)) as quick, quick.watch.stage("fit"):
        pass
    assert capsys.readouterr().err == ""
