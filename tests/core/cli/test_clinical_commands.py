"""Read-outs on the command line."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from clinical_cases import read
from norm_controls import beat
from template_surfaces import MAKERS

from modalmotion.cli import main
from modalmotion.formats import read_npz, write_npz
from modalmotion.mesh.sequence import mesh_sequence
from modalmotion.simulate import MotionClass

SIMULATE = ["--frames", "8", "--grid", "8,16", "--noise", "0.2", "--seed", "4"]


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    path = tmp_path / "beat.npz"
    run = CliRunner().invoke(main, ["simulate", "-o", str(path), *SIMULATE])
    assert run.exit_code == 0, run.output
    return path


def test_numbers_are_the_librarys_and_the_picture_is_written(
    recording: Path, tmp_path: Path
) -> None:
    plot = tmp_path / "volume.png"
    command = ["readouts", str(recording), "--modes", "18", "--json", "--plot", str(plot)]
    run = CliRunner().invoke(main, command)
    assert run.exit_code == 0, run.output
    own = read(read_npz(recording.read_bytes()).sequence, modes=18)
    answer = json.loads(run.stdout)
    assert answer["from_signature"]["volumes"] == (own.curve.volumes * own.shown_in).tolist()
    ejected = answer["from_signature"]["ejection_fraction"]
    assert ejected["value"] == own.curve.ejection_fraction
    assert (ejected["low"], ejected["high"]) == own.curve.share_range
    assert plot.read_bytes().startswith(b"\x89PNG")


def test_a_bulls_eye_is_drawn_of_a_ventricle(recording: Path, tmp_path: Path) -> None:
    picture = tmp_path / "segments.png"
    run = CliRunner().invoke(main, ["readouts", str(recording), "--bulls-eye", str(picture)])
    assert run.exit_code == 0, run.output
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert "inward motion over the radius" in run.output
    assert "cardiac output" in run.output


def test_a_table_for_people(recording: Path) -> None:
    own = read(read_npz(recording.read_bytes()).sequence)
    table = CliRunner().invoke(main, ["readouts", str(recording)])
    assert f"{own.curve.ejection_fraction:.1f} %" in table.output


def test_a_closed_surface_has_an_ejection_fraction_where_its_cavity_is_stated(
    tmp_path: Path,
) -> None:
    vertices, faces = MAKERS["sphere"](100, np.random.default_rng(2))
    path = tmp_path / "ball.npz"
    path.write_bytes(write_npz(mesh_sequence(vertices, faces, unit="mm")))
    for words, name, other in (
        ((), "volume_change", "ejection_fraction"),
        (("--cavity", "la"), "ejection_fraction", "volume_change"),
    ):
        run = CliRunner().invoke(main, ["readouts", str(path), "--json", *words])
        answer = json.loads(run.stdout)["from_signature"]
        assert answer[name]["low"] <= answer[name]["value"] <= answer[name]["high"]
        assert answer[other] is None
        table = CliRunner().invoke(main, ["readouts", str(path), *words])
        assert name.replace("_", " ") + " " in table.output.lower()
        assert other.replace("_", " ") + "  " not in table.output.lower()


def test_a_sheet_has_a_signature_and_no_read_outs(tmp_path: Path) -> None:
    rows, columns = np.divmod(np.arange(48.0), 8)
    sheet = np.stack([rows, columns, np.sin(rows)], axis=1)
    path = tmp_path / "sheet.npz"
    moving = np.stack([sheet, sheet * 1.1])
    path.write_bytes(write_npz(mesh_sequence(moving, grid=(6, 8), topology="plane")))
    line = CliRunner().invoke(main, ["signature", str(path)])
    assert line.exit_code == 0, line.output
    refused = CliRunner().invoke(main, ["readouts", str(path)])
    assert refused.exit_code == 1
    assert "encloses nothing" in refused.output


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
    assert "age is not accounted for: it is not stated" in said


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
