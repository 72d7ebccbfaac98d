"""`modalmotion report`: a folder for people and systems."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from norm_controls import beat

from modalmotion.cli import main
from modalmotion.formats import write_npz

pytest.importorskip("matplotlib")


def run(*arguments: object) -> Result:
    return CliRunner().invoke(main, ["report", *(str(argument) for argument in arguments)])


def test_the_whole_road_in_one_command(tmp_path: Path) -> None:
    path = tmp_path / "beat.npz"
    path.write_bytes(write_npz(beat(1)))
    asked = (path, "--model", "ventricle-simulated", "--issued", "2026-01-31T12:00:00+00:00")
    for name in ("a", "b"):
        result = run(*asked, "-o", tmp_path / name)
        assert result.exit_code == 0, result.output
    names = {"report.pdf", "report.fhir.json", "frames.csv", "view.html"}
    assert {one.name for one in (tmp_path / "a").iterdir()} == names
    for name in ("report.pdf", "report.fhir.json", "frames.csv"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    bundle = json.loads((tmp_path / "a" / "report.fhir.json").read_text())
    assert bundle["timestamp"] == "2026-01-31T12:00:00+00:00"
    rows = list(csv.DictReader((tmp_path / "a" / "frames.csv").read_text().splitlines()))
    assert len(rows) == 10
    assert float(rows[0]["volume_ml"]) > 0


def test_nothing_is_written_where_something_is_wrong(tmp_path: Path) -> None:
    path = tmp_path / "beat.npz"
    path.write_bytes(write_npz(beat(1)))
    for wrong in (("--model", "none"), ("--issued", "noon"), ("--norm", str(path))):
        result = run(path, *wrong, "-o", tmp_path / "out")
        assert result.exit_code != 0
        assert not (tmp_path / "out").exists()
