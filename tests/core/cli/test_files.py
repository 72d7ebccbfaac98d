"""Who waits is told for what, and the times add up to what was waited."""

from __future__ import annotations

import csv
import io
import json
import re
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from modalmotion import Facts, ParameterError
from modalmotion.classification.manifest import read_manifest
from modalmotion.cli import files, main
from modalmotion.cli.files import Waiting, stated_facts
from modalmotion.errors import MalformedFileError
from modalmotion.formats import write_npz
from modalmotion.mesh import facts_from_json
from modalmotion.progress import Progress
from modalmotion.signature.hdf5 import signature_from_hdf5
from modalmotion.simulate import simulate_ventricle


@pytest.mark.every(2)
@pytest.mark.parametrize("command", ["signature", "tradeoff"])
def test_the_times_of_a_command_add_up_to_what_was_waited(tmp_path: Path, command: str) -> None:
    file = tmp_path / "beat.npz"
    file.write_bytes(write_npz(simulate_ventricle()))
    start = time.perf_counter()
    run = subprocess.run(
        [sys.executable, "-m", "modalmotion", command, str(file), "--modes", "7", "--json"],
        capture_output=True,
        text=True,
        check=True,
    )
    waited = time.perf_counter() - start
    answer = json.loads(run.stdout)
    stages = answer.get("chosen", answer)["price"]["milliseconds"]
    assert {"read", "template", "other"} <= stages.keys()
    assert 0 < sum(stages.values()) / 1e3 <= waited


def test_a_stage_that_lasts_is_named_once_where_there_is_no_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(files, "_PATIENCE_SECONDS", 0.01)
    with Waiting(Path(__file__)) as long:
        for name in ("read", "template", "fit"):
            with long.watch.stage(name):
                time.sleep(0.06)
    assert capsys.readouterr().err.split() == ["read", "...", "template", "...", "fit", "..."]
    # Frames that are files of their own have a bar of their own.
    with Waiting(tmp_path) as folder, folder.watch.stage("read"):
        time.sleep(0.06)
    assert capsys.readouterr().err == ""


def test_a_bar_is_drawn_on_a_terminal_alone(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for is_terminal in (False, True):
        monkeypatch.setattr(sys.stderr, "isatty", lambda is_terminal=is_terminal: is_terminal)
        with files.progress_bar([1, 2], label="cases") as bar:
            assert list(bar) == [1, 2]
        assert ("cases" in capsys.readouterr().err) == is_terminal


def test_on_a_terminal_the_seconds_go_by(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(files, "_PATIENCE_SECONDS", 0.01)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with Waiting(Path(__file__)) as long, long.watch.stage("fit") as report:
        time.sleep(0.05)
        report(Progress(0.4))
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


ALL = [
    "--tracking",
    "NORMAL_DISPLACEMENT",
    "--handedness",
    "right",
    "--coordinates",
    "LPS",
    "--period",
    "2",
]
ALL += ["--cavity", "lv", "--modality", "MR", "--landmark", "apex=0,0,-40", "--landmark", "RV=7"]
ALL += ["--covariate", "age=61", "--covariate", "sex=f"]

FACTS = Facts(
    tracking="normal_displacement",
    handedness="right",
    coordinates="LPS",
    period=2.0,
    cavity="lv",
    modality="MR",
    landmarks={"apex": (0, 0, -40), "RV": 7},
    covariates={"age": 61, "sex": "f"},
)


@pytest.fixture
def beat(tmp_path: Path) -> Path:
    path = tmp_path / "beat.npz"
    run = CliRunner().invoke(main, ["simulate", "-o", str(path), "--frames", "3", "--grid", "6,8"])
    assert run.exit_code == 0, run.output
    return path


def test_options_go_over_the_file_and_are_shown_and_written(beat: Path, tmp_path: Path) -> None:
    out = tmp_path / "beat.h5"
    run = CliRunner().invoke(main, ["signature", str(beat), "-o", str(out), "--json", *ALL])
    assert run.exit_code == 0, run.output
    assert facts_from_json(json.loads(run.stdout)["facts"]) == FACTS
    assert signature_from_hdf5(out).facts == FACTS
    text = CliRunner().invoke(main, ["signature", str(beat), *ALL]).stdout
    assert (
        "facts: normal_displacement, right, LPS, lv, MR, period 2 s, 2 landmarks, 2 covariates"
        in text
    )
    assert "61" not in text.split("facts: ")[1].splitlines()[0]


@pytest.mark.parametrize(
    "options",
    [
        ["--covariate", "age=1", "--covariate", "age=2"],
        ["--landmark", "apex"],
        ["--landmark", "apex=1,2"],
        ["--period", "0.01"],
        ["--tracking", "tissue"],
        ["--handedness", "left", "--coordinates", "RAS"],
    ],
)
def test_bad_facts_end_a_command_with_a_line_and_no_traceback(
    beat: Path, options: list[str]
) -> None:
    run = CliRunner().invoke(main, ["signature", str(beat), *options])
    assert run.exit_code in (1, 2)
    assert "Error" in run.output
    assert run.exception is None or isinstance(run.exception, SystemExit)


def test_options_are_taken_out_of_what_was_said() -> None:
    said = {"tracking": "material", "covariate": ("age=61",), "unit": "mm"}
    assert stated_facts(said) == Facts(tracking="material", covariates={"age": 61})
    assert said == {"unit": "mm"}
    with pytest.raises(ParameterError, match="stated twice"):
        stated_facts({"landmark": ("apex=1", " apex=2")})


def test_cohorts_have_their_facts_in_their_table(tmp_path: Path) -> None:
    run = CliRunner().invoke(main, ["simulate-cohort", "-o", str(tmp_path), "--per-class", "1"])
    assert run.exit_code == 0, run.output
    files = read_manifest(tmp_path / "cases.csv")
    with (tmp_path / "cases.csv").open() as table:
        rows = list(csv.DictReader(table))
    for file, row in zip(files, rows, strict=True):
        assert (file.facts.tracking, file.facts.modality) == ("material", "simulated")
        assert file.facts.period == float(row["period"])


def test_a_manifest_states_facts_in_columns_and_each_once(tmp_path: Path) -> None:
    (tmp_path / "a.npz").touch()
    manifest = tmp_path / "cases.csv"
    manifest.write_text("path,label,Cavity,covariate:Age\na.npz,x,RV,61\n")
    assert read_manifest(manifest)[0].facts == Facts(cavity="rv", covariates={"Age": 61})
    for text, message in (
        ("path,label,cavity,cavity\na.npz,x,lv,lv\n", "two columns 'cavity'"),
        ("path,label,covariate:age\na.npz,x,nan\n", "Line 2 of 'cases.csv': The covariate 'age'"),
    ):
        manifest.write_text(text)
        with pytest.raises(MalformedFileError, match=message):
            read_manifest(manifest)


OUTPUTS = {"signature": ".h5", "report": ".pdf", "readouts": ""}


@pytest.mark.parametrize("command", OUTPUTS)
@pytest.mark.parametrize("fault", ["cut", "nan", "empty", "absent"])
def test_an_error_names_the_file_once(beat: Path, tmp_path: Path, command: str, fault: str) -> None:
    data = beat.read_bytes()
    arrays = dict(np.load(beat))
    arrays["vertices"][1, 2, 0] = np.nan
    with_nan = io.BytesIO()
    np.savez(with_nan, **arrays)
    found = {"cut": data[: len(data) // 2], "nan": with_nan.getvalue(), "empty": b""}
    path = tmp_path / "sent.npz"
    if fault in found:
        path.write_bytes(found[fault])
    output = [] if command == "readouts" else ["-o", str(tmp_path / f"out{OUTPUTS[command]}")]
    run = CliRunner().invoke(main, [command, str(path), *output])
    assert run.exit_code == 1
    assert run.stderr.count("sent.npz") == 1
    assert ("Frame 1, vertex 2" in run.stderr) == (fault == "nan")
    assert not (tmp_path / f"out{OUTPUTS[command]}").exists()


@pytest.mark.parametrize(
    "words",
    [
        "decode {bad}.mms -o {out}.npz",
        "show {bad}.mms",
        "show {bad}.nii.gz",
        "score {beat} {bad}.npz",
        "score {beat} {bad}.h5",
        "score {bad}.npz {beat}",
        "dicom {beat} --study {bad}.dcm -o {out}",
        "track {bad}.npz -o {out}.npz",
        "segment {bad}.nii.gz -o {out}.ply",
        "report {bad}.nii.gz -o {out}",
    ],
)
def test_of_several_files_an_error_names_the_one_that_is_bad(
    beat: Path, tmp_path: Path, words: str
) -> None:
    pytest.importorskip("pydicom")
    heads = {
        ".mms": b"MMSQ",
        ".nii.gz": b"\x1f\x8b",
        ".npz": b"PK\x03\x04",
        ".h5": b"\x89HDF\r\n\x1a\n",
    }
    for suffix, head in {**heads, ".dcm": b""}.items():
        (tmp_path / f"bad{suffix}").write_bytes(head + b" no such file")
    named = {"bad": tmp_path / "bad", "out": tmp_path / "out", "beat": beat}
    run = CliRunner().invoke(main, words.format(**named).split())
    assert run.exit_code == 1
    assert run.stderr.count("bad.") == 1
    assert "beat.npz" not in run.stderr
