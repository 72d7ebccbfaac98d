"""`modalmotion report`: a folder for people and systems."""

from __future__ import annotations

import csv
import json
import re
from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from click.testing import CliRunner, Result
from dicom_samples import study_instance
from ellipsoid_images import LANDMARKS, enclosed, labels, planes
from fhir_profile import PROFILE
from norm_controls import beat

from modalmotion.cli import main
from modalmotion.formats import write_npz
from modalmotion.formats.volumes import write_nifti_zip
from modalmotion.images import ImageSequence

pytest.importorskip("matplotlib")


def run(*arguments: object) -> Result:
    return CliRunner().invoke(main, ["report", *(str(argument) for argument in arguments)])


# Two frames of images are tracked, and a page is drawn: 3 s.
def test_from_images_to_the_folder_with_no_other_option(tmp_path: Path) -> None:
    pytest.importorskip("nibabel")
    frames = tuple(planes(radius) for radius in (22.0, 18.0))
    source = tmp_path / "beat.zip"
    source.write_bytes(write_nifti_zip(ImageSequence(frames, np.array([0.0, 0.4]))))
    marks = {name: place.tolist() for name, place in LANDMARKS.items()}
    file = tmp_path / "heart.json"
    file.write_text(json.dumps({"coordinates": "LPS", "landmarks": marks}))
    model = ("--model", "ventricle-simulated")
    result = run(source, "--landmarks", file, *model, "-o", tmp_path / "out")
    assert result.exit_code == 0, result.output
    bundle = json.loads((tmp_path / "out" / "report.fhir.json").read_text())
    jsonschema.validate(bundle, PROFILE)
    parts = {
        part["code"]["coding"][-1]["code"]: part["valueQuantity"]["value"]
        for entry in bundle["entry"]
        for part in entry["resource"].get("component", ())
    }
    # Of the phantom, cut at its base: volumes go with the square of the radius.
    share = parts.get("ejection-fraction", parts.get("volume-change"))
    assert share == pytest.approx(100 * (1 - (18 / 22) ** 2), abs=4)
    # Points that slide are read by the model of offsets.
    assert "ventricle-simulated-normal-displacement" in json.dumps(bundle)
    rows = (tmp_path / "out" / "frames.csv").read_text().splitlines()
    assert len(rows) == 1 + len(frames)
    assert (tmp_path / "out" / "report.pdf").read_bytes().startswith(b"%PDF")
    without = run(source, *model, "-o", tmp_path / "none")
    assert without.exit_code == 1
    assert "apex" in without.output
    assert not (tmp_path / "none").exists()


def test_a_label_map_needs_no_option(tmp_path: Path) -> None:
    pytest.importorskip("nibabel")
    source = tmp_path / "map.zip"
    frames = ImageSequence((labels(), labels(18.0)))
    source.write_bytes(write_nifti_zip(frames))
    result = run(source, "-o", tmp_path / "out.csv")
    assert result.exit_code == 0, result.output
    assert "Label 3 was taken as the cavity" in result.output
    line = re.search(r"Ejection fraction .*\(([\d.]+) to ([\d.]+)\)", result.output)
    assert line is not None
    low, high = line.groups()
    assert float(low) < 100 * (1 - enclosed(18.0) / enclosed()) < float(high)
    assert (tmp_path / "out.csv").exists()
    # The read-outs track it in the same way, and report the same numbers.
    read = CliRunner().invoke(main, ["readouts", str(source)])
    assert line[0] in read.output, read.output
    refused = run(source, "--label", 7, "-o", tmp_path / "none")
    assert refused.exit_code == 1
    assert re.search(r"--label: 2: [\d.]+ ml, 3: [\d.]+ ml", refused.output)


@pytest.mark.parametrize(
    ("name", "start"),
    [("x.pdf", b"%PDF"), ("x.json", b"{"), ("x.csv", b"frame"), ("x.HTML", b"<!")],
)
def test_a_name_with_a_suffix_is_that_file(tmp_path: Path, name: str, start: bytes) -> None:
    path = tmp_path / "beat.npz"
    path.write_bytes(write_npz(beat(1)))
    result = run(path, "-o", tmp_path / name)
    assert result.exit_code == 0, result.output
    assert (tmp_path / name).read_bytes().startswith(start)
    assert f"written: {tmp_path / name}" in result.output
    assert len(list(tmp_path.iterdir())) == 2
    refused = run(path, "-o", tmp_path / "no" / name)
    assert (refused.exit_code, "does not exist" in refused.output) == (2, True)


def test_a_report_has_no_words_of_the_command_line(tmp_path: Path) -> None:
    path = tmp_path / "beat.npz"
    path.write_bytes(write_npz(replace(beat(1), times=None)))
    result = run(path, "-o", tmp_path / "x.json")
    assert "Give the times or the interval of the frames." in result.output
    assert "--" not in result.output
    assert b"--" not in (tmp_path / "x.json").read_bytes()


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


def test_a_folder_of_contours_is_tracked_and_not_read_as_meshes(tmp_path: Path) -> None:
    heading = "x\ty\tz\tcontour type\tsliceID\tweight\ttime frame"
    rows = [heading, *(f"1\t{k}\t0\tSAX_LV_ENDOCARDIAL\t2\t1.0\t{k}" for k in range(2))]
    (tmp_path / "GPFile_000.txt").write_text("\n".join(rows))
    result = run(tmp_path, "-o", tmp_path / "out")
    assert result.exit_code != 0
    assert "GPFile_000.txt" in result.output
    assert "two time frames" in result.output


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
