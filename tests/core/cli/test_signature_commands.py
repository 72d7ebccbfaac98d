"""`modalmotion tradeoff`, and signatures by tolerance on the command line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from modalmotion.cli import main

SIMULATE = ["--frames", "8", "--grid", "8,16", "--noise", "0.2", "--seed", "4"]


@pytest.fixture
def beat(tmp_path: Path) -> str:
    path = str(tmp_path / "beat.npz")
    assert CliRunner().invoke(main, ["simulate", "-o", path, *SIMULATE]).exit_code == 0
    return path


def test_the_front_is_printed_and_drawn(beat: str, tmp_path: Path) -> None:
    plot = tmp_path / "trade.png"
    options = ["--plot", str(plot), "--tolerance", "1", "--front-modes", "25"]
    run = CliRunner().invoke(main, ["tradeoff", beat, *options])
    assert run.exit_code == 0, run.output
    for words in ("cup, cartesian", "cylinder, cylindrical", "as a rigid motion", "chosen"):
        assert words in run.output
    assert plot.read_bytes().startswith(b"\x89PNG")


def test_all_of_it_as_json(beat: str) -> None:
    options = ["--json", "--modes", "7", "--components", "cylindrical", "--front-modes", "7"]
    run = CliRunner().invoke(main, ["tradeoff", beat, *options])
    assert run.exit_code == 0, run.output
    answer = json.loads(run.stdout)
    assert answer["chosen"]["price"]["amplitudes_per_frame"] == 21
    assert {branch["components"] for branch in answer["front"]} == {"cylindrical"}


def test_a_signature_says_its_price(beat: str) -> None:
    run = CliRunner().invoke(main, ["signature", beat, "--tolerance", "1", "--json"])
    assert run.exit_code == 0, run.output
    answer = json.loads(run.stdout)
    assert answer["price"]["rms_error"] <= 1.0
    assert {"read", "template", "fit", "notes", "other"} == set(answer["price"]["milliseconds"])
    assert answer["choice"]["asked"] == "tolerance"


def test_what_cannot_be_is_said_without_a_traceback(beat: str) -> None:
    twice = CliRunner().invoke(main, ["signature", beat, "--modes", "7", "--auto"])
    assert twice.exit_code == 1
    assert "several ways" in twice.output
    reach = CliRunner().invoke(main, ["tradeoff", beat, "--tolerance", "0"])
    assert reach.exit_code == 1
    assert "No set of modes" in reach.output
