"""One image from the command line: the surface, its error, and a picture."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from ellipsoid_images import enclosed, labels

from modalmotion.cli import main
from modalmotion.formats.ply import read_ply
from modalmotion.formats.volumes.nifti import write_nifti
from modalmotion.images import ImageSequence
from modalmotion.tracking.hdf5 import track_from_hdf5

pytest.importorskip("nibabel")


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("segment") / "labels.nii.gz"
    path.write_bytes(write_nifti(ImageSequence((labels(18.0), labels()))))
    return path


def run(*words: object) -> str:
    result = CliRunner().invoke(main, ["segment", *map(str, words)])
    assert result.exit_code == 0, result.output
    return result.stdout


def test_a_surface_is_written_with_its_error(source: Path, tmp_path: Path) -> None:
    output, plot = tmp_path / "lv.ply", tmp_path / "lv.png"
    words = ("--label", 3, "--wall", 2, "--frame", 1, "--modes", 7)
    numbers = json.loads(run(source, "-o", output, *words, "--plot", plot, "--json"))
    assert numbers["volume_ml"] == pytest.approx(enclosed() / 1000.0, rel=0.06)
    assert plot.read_bytes().startswith(b"\x89PNG")
    data = output.read_bytes()
    assert b"property double deviation_across" in data
    frame = read_ply(data)
    assert dict(frame.statements)["unit"] == "mm"
    text = run(source, "-o", tmp_path / "lv.h5", *words)
    assert "ml +-" in text
    assert "Apex and base were proposed" in text
    track = track_from_hdf5(tmp_path / "lv.h5")
    assert np.array_equal(track.sequence.vertices[0], frame.positions)


def test_a_frame_that_is_not_there_is_named(source: Path, tmp_path: Path) -> None:
    words = ["segment", str(source), "-o", str(tmp_path / "a.ply"), "--label", "3", "--frame", "2"]
    result = CliRunner().invoke(main, words)
    assert result.exit_code == 1
    assert "no image in frame 2" in result.output
