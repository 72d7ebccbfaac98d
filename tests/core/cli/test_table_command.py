"""Tables from the command line."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from viewed_surfaces import viewed

from modalmotion.cli import main
from modalmotion.formats import write_npz
from modalmotion.signature.making import SignatureParameters, modal_signature


@pytest.fixture
def beat(tmp_path: Path) -> Path:
    path = tmp_path / "beat.npz"
    path.write_bytes(write_npz(viewed("cup")[0]))
    return path


def test_amplitudes_are_the_library_s_to_the_last_bit(beat: Path) -> None:
    run = CliRunner().invoke(main, ["table", str(beat), "--modes", "4"])
    assert run.exit_code == 0, run.output
    rows = list(csv.DictReader(io.StringIO(run.stdout)))
    own = modal_signature(viewed("cup")[0], SignatureParameters(modes=4)).amplitudes
    assert np.array_equal([float(row["amplitude"]) for row in rows], own.ravel())
    as_json = CliRunner().invoke(main, ["signature", str(beat), "--modes", "4", "--json"])
    answer = json.loads(as_json.stdout)
    assert np.array_equal(answer["amplitudes"], own)
    assert answer["labels"][1] == rows[3]["label"]


def test_frames_hold_volume_and_segments_where_there_are_any(beat: Path, tmp_path: Path) -> None:
    out = tmp_path / "frames.csv"
    run = CliRunner().invoke(main, ["table", str(beat), "--frames", "-o", str(out)])
    assert run.exit_code == 0, run.output
    rows = list(csv.DictReader(io.StringIO(out.read_text())))
    assert len(rows) == 5
    assert {"volume_ml", "inward_basal_percent", "rms_error"} <= set(rows[0])
    sheet = tmp_path / "sheet.npz"
    sheet.write_bytes(write_npz(viewed("plane")[0]))
    run = CliRunner().invoke(main, ["table", str(sheet), "--frames"])
    assert run.exit_code == 0, run.output
    assert "volume" not in run.stdout
    assert "encloses nothing" in run.stderr


def test_a_manifest_is_a_table_with_a_row_for_each_recording(beat: Path, tmp_path: Path) -> None:
    lines = ["path,label,subject", "beat.npz,weak,P 1"]
    manifest = tmp_path / "cohort.csv"
    manifest.write_text("\n".join(lines))
    run = CliRunner().invoke(main, ["table", str(manifest), "--modes", "4"])
    assert run.exit_code == 0, run.output
    (row,) = csv.DictReader(io.StringIO(run.stdout))
    assert (row["label"], row["subject"]) == ("weak", "P 1")
    assert row["modes"] == "4"
    assert float(row["ejection_fraction_percent"]) > 0
    # One that cannot be read ends it by its name, or is left out and named.
    (tmp_path / "broken.npz").write_bytes(b"nothing")
    manifest.write_text("\n".join([*lines, "broken.npz,weak,P 2"]))
    run = CliRunner().invoke(main, ["table", str(manifest)])
    assert run.exit_code == 1
    assert "broken.npz" in run.output
    run = CliRunner().invoke(main, ["table", str(manifest), "--skip-unreadable"])
    assert run.exit_code == 0, run.output
    assert "left out" in run.stderr
    assert len(list(csv.DictReader(io.StringIO(run.stdout)))) == 1
    assert CliRunner().invoke(main, ["table", str(manifest), "--frames"]).exit_code == 2
    # What is stated holds for all; a table of nothing is refused.
    stated = CliRunner().invoke(
        main, ["table", str(tmp_path / "cohort.csv"), "--cavity", "none", "--skip-unreadable"]
    )
    (row,) = csv.DictReader(io.StringIO(stated.stdout))
    assert row["ejection_fraction_percent"] == ""
    assert float(row["volume_change_percent"]) > 0
    manifest.write_text("\n".join([lines[0], "broken.npz,weak,P 2"]))
    run = CliRunner().invoke(main, ["table", str(manifest), "--skip-unreadable"])
    assert run.exit_code == 1
    assert "No recording" in run.output
