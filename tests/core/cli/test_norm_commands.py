"""`modalmotion norm`: train and ask."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from norm_controls import beat

from modalmotion.cli import main
from modalmotion.formats import write_npz
from modalmotion.simulate import MotionClass


def run(*arguments: object) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


def succeed(*arguments: object) -> Result:
    result = run(*arguments)
    assert result.exit_code == 0, result.output
    return result


def fail(*arguments: object) -> Result:
    result = run(*arguments)
    assert result.exit_code != 0
    return result


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("norms")
    for k in range(19):
        (folder / f"{k}.npz").write_bytes(write_npz(beat(k)))
    (folder / "weak.npz").write_bytes(write_npz(beat(90, MotionClass.HYPOKINESIA)))
    with (folder / "controls.csv").open("w", newline="") as file:
        rows = [[f"{k}.npz", f"S{k}", 30 + k] for k in range(19)]
        csv.writer(file).writerows([["path", "subject", "age"], *rows])
    succeed("norm", "train", folder / "controls.csv", "--name", "ours", "-o", folder / "ours.h5")
    return folder


def test_a_weak_heart_is_told_from_controls(folder: Path) -> None:
    said = succeed("norm", "ask", folder / "ours.h5", folder / "weak.npz").output
    assert "deviates from the 19 controls of ours: p = 0.0500" in said
    assert "contraction: less than in controls" in said
    assert "ejection fraction" in said
    assert "age is not stated" in said


def test_json_says_the_same(folder: Path) -> None:
    files = [folder / f"new{k}.npz" for k in range(5)]
    for k, path in enumerate(files):
        path.write_bytes(write_npz(beat(50 + k)))
    said = json.loads(
        succeed(
            "norm", "ask", folder / "ours.h5", *files, folder / "3.npz", "--level", 0.06, "--json"
        ).stdout
    )
    assert len(said["deviations"]) == 6
    assert said["deviations"][0]["path"].endswith("new0.npz")
    assert said["cohort"]["n_recordings"] == 6
    assert not said["cohort"]["is_another"]
    assert said["deviations"][5]["n_controls"] == 18


def test_too_strict_a_level_is_refused_with_its_remedy(folder: Path) -> None:
    result = fail("norm", "ask", folder / "ours.h5", folder / "weak.npz", "--level", 0.01)
    assert "needs 99" in result.output


def test_unreadable_controls_are_left_out_on_request(folder: Path, tmp_path: Path) -> None:
    files = [folder / f"{k}.npz" for k in range(9)]
    (tmp_path / "cut.npz").write_bytes(files[0].read_bytes()[:500])
    asked = (
        "norm",
        "train",
        *files,
        tmp_path / "cut.npz",
        "--name",
        "few",
        "-o",
        tmp_path / "n.h5",
    )
    assert "cut.npz" in fail(*asked).output
    said = succeed(*asked, "--skip-unreadable", "--json")
    assert json.loads(said.stdout)["n_controls"] == 9
