"""What a file holds, in words and as JSON."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from viewed_surfaces import viewed

from modalmotion.classification import classify
from modalmotion.classification.model_files import load_model
from modalmotion.cli import main
from modalmotion.cli.commands import COMMANDS, MEANT
from modalmotion.codec import encode
from modalmotion.formats import write_npz
from modalmotion.formats.volumes.one_file import write_nifti
from modalmotion.images import ImageSequence, Volume
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.simulate import simulate_ventricle
from modalmotion.store import (
    classification_to_hdf5,
    model_to_hdf5,
    sequence_to_hdf5,
    signature_to_hdf5,
    template_to_hdf5,
)
from modalmotion.template import make_template


def shown(path: Path) -> dict[str, Any]:
    run = CliRunner().invoke(main, ["show", str(path), "--json"])
    assert run.exit_code == 0, run.output
    content: dict[str, Any] = json.loads(run.stdout)
    words = CliRunner().invoke(main, ["show", str(path)])
    assert str(content["content"]) in words.stdout.splitlines()[0]
    return content


def written(folder: Path, name: str) -> Path:
    sequence, signature = viewed("cup")
    beat = simulate_ventricle(grid=(8, 16))
    makers: dict[str, Callable[[], Any]] = {
        "signature.h5": lambda: signature_to_hdf5(signature),
        "sequence.h5": lambda: sequence_to_hdf5(sequence),
        "template.h5": lambda: template_to_hdf5(make_template(sequence)),
        "class.h5": lambda: classification_to_hdf5(classify(beat)),
        "model.h5": lambda: model_to_hdf5(load_model()),
        "beat.stream": lambda: encode(sequence, max_error=0.3),
        "beat.npz": lambda: write_npz(sequence),
    }
    data = makers[name]()
    path = folder / name
    path.write_bytes(data if isinstance(data, bytes) else data.data)
    return path


@pytest.mark.parametrize(
    ("name", "holds", "stated"),
    [
        ("signature.h5", "signature", {"modes": 9, "unit": "mm", "surface": "cup"}),
        ("sequence.h5", "sequence", {"frames": 5, "vertices": 108, "topology": "cup"}),
        ("template.h5", "template", {"surface": "cup", "vertices": 108}),
        ("class.h5", "classification", {"model": "ventricle-simulated"}),
        ("model.h5", "model", {"name": "ventricle-simulated"}),
        ("beat.stream", "compressed sequence", {"n_frames": 5, "unit": "mm"}),
        ("beat.npz", "moving surface", {"format": "npz", "frames": 5, "grid": [9, 12]}),
    ],
)
def test_each_kind_of_file_says_what_it_is(
    tmp_path: Path, name: str, holds: str, stated: dict[str, Any]
) -> None:
    content = shown(written(tmp_path, name))
    assert content["content"] == holds
    assert {key: content[key] for key in stated} == stated


def test_folders_of_frames_and_label_maps_are_shown(tmp_path: Path) -> None:
    frames = tmp_path / "frames"
    frames.mkdir()
    for k, points in enumerate(np.random.default_rng(1).normal(size=(3, 12, 3))):
        lines = [f"v {x} {y} {z}" for x, y, z in points] + ["f 1 2 3", "f 2 3 4"]
        (frames / f"a_{k}.obj").write_text("\n".join(lines))
    content = shown(frames)
    assert (content["content"], content["frames"], content["vertices"]) == ("moving surface", 3, 12)
    labels = np.zeros((20, 21, 22), dtype=np.uint8)
    labels[4:14, 4:14, 4:14] = 3
    labelled = ImageSequence((Volume(labels, 2.0 * np.eye(3, 4)),) * 2)
    (tmp_path / "map.nii.gz").write_bytes(write_nifti(labelled))
    content = shown(tmp_path / "map.nii.gz")
    assert (content["content"], content["frames"], content["labels"]) == ("label map", 2, "3: 8 ml")
    assert content["voxels"] == [20, 21, 22]


def test_what_is_neither_is_refused_in_words(tmp_path: Path) -> None:
    path = tmp_path / "letter.txt"
    path.write_text("Dear all")
    run = CliRunner().invoke(main, ["show", str(path)])
    assert run.exit_code == 1
    assert "neither a file of modalmotion nor a moving surface" in run.output


def test_a_mistyped_command_is_answered_with_the_intended_one() -> None:
    run = CliRunner().invoke(main, ["signatur"])
    assert run.exit_code == 2
    assert "Did you mean signature" in run.output
    for name, meant in MEANT.items():
        assert f"Did you mean {meant}?" in CliRunner().invoke(main, [name]).output
        assert meant == "--help" or meant.split()[0] in COMMANDS


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
    assert "left out: " in run.stderr
    assert len(list(csv.DictReader(io.StringIO(run.stdout)))) == 1
    assert CliRunner().invoke(main, ["table", str(manifest), "--frames"]).exit_code == 2
    # However many there are.
    gone = [f"gone-{number}.npz" for number in range(30)]
    manifest.write_text("\n".join([*lines, *(f"{name},weak,P 2" for name in gone)]))
    run = CliRunner().invoke(main, ["table", str(manifest), "--skip-unreadable"])
    assert run.exit_code == 0, run.output
    assert all(f"{name}: " in run.stderr for name in gone)
    manifest.write_text("\n".join([*lines, "broken.npz,weak,P 2"]))
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
