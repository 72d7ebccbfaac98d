"""`modalmotion dicom`: objects of a patient's study, in a folder."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from dicom_samples import study_instance
from norm_controls import beat

from modalmotion.cli import main
from modalmotion.formats import write_npz

pytest.importorskip("highdicom")


def test_objects_are_written_and_nothing_without_a_space(tmp_path: Path) -> None:
    source, study = tmp_path / "beat.npz", tmp_path / "image.dcm"
    source.write_bytes(write_npz(beat(1)))
    study.write_bytes(study_instance())

    def run(out: str, *options: str, study: Path = study) -> Result:
        fixed = ("--issued", "2026-01-31T12:00:00+00:00", "-o", str(tmp_path / out))
        named = ("dicom", str(source), "--study", str(study))
        return CliRunner().invoke(main, [*named, *fixed, *options])

    done = run("a", "--coordinates", "LPS", "--cavity", "lv")
    assert done.exit_code == 0, done.output
    names = ["end-diastole.dcm", "end-systole.dcm", "report.dcm"]
    assert sorted(path.name for path in (tmp_path / "a").iterdir()) == names
    refused = run("c")
    assert refused.exit_code == 1
    assert "coordinates are not stated" in refused.output
    assert "coordinates=LPS" in refused.output
    wrong = run("c", "--coordinates", "LPS", study=source)
    assert "no DICOM instance" in wrong.output
    assert not (tmp_path / "c").exists()
