"""Read-outs on the command line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from clinical_cases import read
from template_surfaces import MAKERS

from modalmotion.cli import main
from modalmotion.formats import read_npz, write_npz
from modalmotion.mesh.sequence import mesh_sequence

SIMULATE = ["--frames", "8", "--grid", "8,16", "--noise", "0.2", "--seed", "4"]


@pytest.fixture
def beat(tmp_path: Path) -> Path:
    path = tmp_path / "beat.npz"
    run = CliRunner().invoke(main, ["simulate", "-o", str(path), *SIMULATE])
    assert run.exit_code == 0, run.output
    return path


def test_numbers_are_the_librarys_and_the_picture_is_written(beat: Path, tmp_path: Path) -> None:
    plot = tmp_path / "volume.png"
    command = ["readouts", str(beat), "--modes", "18", "--json", "--plot", str(plot)]
    run = CliRunner().invoke(main, command)
    assert run.exit_code == 0, run.output
    own = read(read_npz(beat.read_bytes()).sequence, modes=18)
    answer = json.loads(run.stdout)
    assert answer["from_signature"]["volumes"] == (own.curve.volumes * own.shown_in).tolist()
    assert answer["from_signature"]["ejection_fraction"] == own.curve.ejection_fraction
    assert plot.read_bytes().startswith(b"\x89PNG")


def test_a_bulls_eye_is_drawn_of_a_ventricle(beat: Path, tmp_path: Path) -> None:
    picture = tmp_path / "segments.png"
    run = CliRunner().invoke(main, ["readouts", str(beat), "--bulls-eye", str(picture)])
    assert run.exit_code == 0, run.output
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert "inward motion over the radius" in run.output
    assert "cardiac output" in run.output


def test_a_table_for_people_and_a_line_beside_the_signature(beat: Path) -> None:
    own = read(read_npz(beat.read_bytes()).sequence)
    table = CliRunner().invoke(main, ["readouts", str(beat)])
    line = CliRunner().invoke(main, ["signature", str(beat)])
    assert f"{own.curve.ejection_fraction:.2f}" in table.output
    assert f"ejection fraction {own.curve.ejection_fraction:.1f} %" in line.output


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
        low, high = answer["share_range"]
        assert low <= answer[name] <= high
        assert answer[other] is None
        for command in ("readouts", "signature"):
            table = CliRunner().invoke(main, [command, str(path), *words])
            assert name.replace("_", " ") + " " in table.output
            assert other.replace("_", " ") + "  " not in table.output


def test_a_sheet_has_a_signature_and_no_read_outs(tmp_path: Path) -> None:
    rows, columns = np.divmod(np.arange(48.0), 8)
    sheet = np.stack([rows, columns, np.sin(rows)], axis=1)
    path = tmp_path / "sheet.npz"
    moving = np.stack([sheet, sheet * 1.1])
    path.write_bytes(write_npz(mesh_sequence(moving, grid=(6, 8), topology="plane")))
    line = CliRunner().invoke(main, ["signature", str(path)])
    assert line.exit_code == 0, line.output
    assert "ejection" not in line.output
    refused = CliRunner().invoke(main, ["readouts", str(path)])
    assert refused.exit_code == 1
    assert "encloses nothing" in refused.output
