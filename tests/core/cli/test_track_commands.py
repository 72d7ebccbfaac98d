"""The command that tracks: from files to a sequence, a track and a picture."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from clouds import breathing_spheroid, sampled
from ellipsoid_images import LANDMARKS, enclosed, labels, planes
from PIL import Image

from modalmotion.cli import main, simulate_command
from modalmotion.cli.track_commands import stated_landmarks
from modalmotion.errors import ParameterError
from modalmotion.formats import DEFAULT_LIMITS, ParserHere, read_npz
from modalmotion.formats.ply import read_ply
from modalmotion.formats.volumes import read_images, write_nifti_zip
from modalmotion.formats.volumes.one_file import write_nifti
from modalmotion.images import ImageSequence
from modalmotion.tracking.hdf5 import track_from_hdf5
from modalmotion.tracking.landmarks import read_landmark_file
from modalmotion.tracking.reading import Recorded

BALL = breathing_spheroid(3)


def clouds_in(folder: Path) -> Path:
    rng = np.random.default_rng(0)
    for k, x in enumerate(BALL.vertices):
        np.savetxt(folder / f"f_{k}.xyz", sampled(x, BALL.faces, 150, rng, 0.3))
    return folder


def run(*words: object) -> str:
    result = CliRunner().invoke(main, ["track", *map(str, words)])
    assert result.exit_code == 0, result.output
    return result.stdout


def test_a_folder_becomes_a_sequence_and_a_picture(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    source = clouds_in(tmp_path / "in")
    output, plot = tmp_path / "beat.npz", tmp_path / "beat.png"
    text = run(source, "-o", output, "--modes", 7, "--unit", "mm", "--plot", plot)
    assert text.split()[3:9] == ["frames", "3", "modes", "7", "topology", "sphere"]
    assert "deviation across" in text
    sequence = read_npz(output.read_bytes()).sequence
    assert sequence.n_frames == 3
    assert sequence.facts.tracking == "normal_displacement"
    assert plot.read_bytes().startswith(b"\x89PNG")


def test_the_whole_track_and_its_figures(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    source, output = clouds_in(tmp_path / "in"), tmp_path / "beat.h5"
    words = (source, "-o", output, "--modes", 7, "--json", "--frame-interval", 0.1)
    numbers = json.loads(run(*words, "--time", "open"))
    assert numbers["frames"] == 3
    track = track_from_hdf5(output.read_bytes())
    assert track.sequence.id == numbers["sequence_id"]
    assert track.sequence.times is not None
    # The track's own file is read by the other commands, with its deviations.
    asked = ["signature", str(output), "--kind", "normal_displacement", "--json", "--modes", "4"]
    result = CliRunner().invoke(main, asked)
    assert json.loads(result.stdout)["deviation_share"] > 0.0
    assert json.loads(result.stdout)["sequence_id"] == numbers["sequence_id"]


@pytest.mark.thorough
def test_each_picture(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    source, output = clouds_in(tmp_path / "in"), tmp_path / "beat.h5"
    words = (source, "-o", output, "--modes", 4, "--plot", tmp_path / "a.png")
    pictures = set()
    for picture in ("data", "deviations", "determined"):
        run(*words, "--picture", picture)
        pictures.add((tmp_path / "a.png").read_bytes())
    assert len(pictures) == 3


def test_a_landmark_that_is_none_is_refused(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    words = [str(clouds_in(tmp_path / "in")), "-o", str(tmp_path / "b.npz")]
    result = CliRunner().invoke(main, ["track", *words, "--landmarks", "apex=1,2"])
    assert result.exit_code != 0
    assert "apex=1,2,3" in result.output


def test_landmarks_are_of_any_frame() -> None:
    recorded = Recorded(((), (), ()), {})
    texts = ("apex=1,2,3", "base@0=4,5,6", "base@2=7,8,9")
    marks = stated_landmarks(texts, recorded, "mm", reference=1)
    assert np.isnan(marks["apex"]).all(axis=1).tolist() == [True, False, True]
    assert marks["apex"][1].tolist() == [1, 2, 3]
    assert np.isnan(marks["base"]).all(axis=1).tolist() == [False, True, False]
    assert marks["base"][[0, 2]].tolist() == [[4, 5, 6], [7, 8, 9]]
    for wrong in ("base@3=1,2,3", "base@x=1,2,3", "base@0=1,2"):
        with pytest.raises(ParameterError):
            stated_landmarks((wrong,), recorded, "mm")


def test_landmarks_come_from_a_file_too(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    words = [str(clouds_in(tmp_path / "in")), "-o", str(tmp_path / "b.npz")]
    file = tmp_path / "ends.mrk.json"
    file.write_text('{"coordinates": "RAS", "landmarks": {"apex": [900, 0, 0]}}')
    result = CliRunner().invoke(main, ["track", *words, "--landmarks", str(file)])
    # Read and turned: the points are some 40 mm wide.
    assert "'apex' in frame 0 is 8" in result.output


def test_images_are_tracked_and_drawn_over(tmp_path: Path) -> None:
    pytest.importorskip("nibabel")
    frames = tuple(planes(radius) for radius in (22.0, 18.0))
    source, output, plot = (tmp_path / name for name in ("beat.zip", "beat.h5", "beat.gif"))
    source.write_bytes(write_nifti_zip(ImageSequence(frames, np.array([0.0, 0.4]))))
    marks = [f"{name}={','.join(map(str, place))}" for name, place in LANDMARKS.items()]
    words = [w for mark in marks for w in ("--landmarks", mark)]
    text = run(source, "-o", output, *words, "--papillary", "wall", "--plot", plot, "--json")
    numbers = json.loads(text)
    assert numbers["papillary"] == "wall"
    assert numbers["ejection_fraction"] == pytest.approx(numbers["ejection_fractions"]["wall"])
    track = track_from_hdf5(output.read_bytes())
    assert track.images is not None
    assert track.images.papillary == "wall"
    assert track.sequence.facts.coordinates == "LPS"
    with Image.open(plot) as gif:
        assert (gif.format, gif.n_frames) == ("GIF", 2)  # type: ignore[attr-defined]
        assert (gif.info["duration"], gif.info["loop"]) == (400, 0)


def test_simulated_images_come_with_their_truth(tmp_path: Path) -> None:
    pytest.importorskip("nibabel")
    words = ["simulate", "--image", "cine", "--frames", "1", "-o", str(tmp_path / "a.zip")]
    result = CliRunner().invoke(main, words)
    assert result.exit_code == 0, result.output
    images = read_images(tmp_path / "a.zip", parser=ParserHere(DEFAULT_LIMITS))
    assert images.n_frames == 1
    truth = read_npz((tmp_path / "a.truth.npz").read_bytes()).sequence
    marks = read_landmark_file((tmp_path / "a.landmarks.json").read_bytes())
    base = marks.for_points("LPS", "mm")["base"]
    assert np.ravel(base)[:3] == pytest.approx(truth.vertices[0, -64:].mean(axis=0), abs=1e-3)


def test_a_simulated_label_map_is_read_with_no_option(tmp_path: Path) -> None:
    pytest.importorskip("nibabel")
    words = ["simulate", "--image", "labels", "--frames", "4", "-o", str(tmp_path / "map.nii.gz")]
    assert CliRunner().invoke(main, words).exit_code == 0
    values = {}
    for name in ("map.nii.gz", "map.truth.npz"):
        result = CliRunner().invoke(main, ["readouts", str(tmp_path / name), "--json"])
        assert result.exit_code == 0, result.output
        values[name] = json.loads(result.stdout)["from_signature"]["ejection_fraction"]
    found, truth = values["map.nii.gz"], values["map.truth.npz"]
    assert found["low"] < truth["value"] < found["high"]
    assert found["high"] - found["low"] < 12.0


def test_planes_are_refused_as_one_nifti_before_they_are_simulated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def simulated(*_: object, **__: object) -> None:
        raise AssertionError("simulated first")

    monkeypatch.setattr(simulate_command, "simulate_images", simulated)
    words = ["simulate", "--image", "cine", "-o", str(tmp_path / "x.nii.gz")]
    run = CliRunner().invoke(main, words)
    assert run.exit_code == 2, run.output
    assert "-o x.zip" in run.output
    assert not [*tmp_path.iterdir()]


@pytest.mark.parametrize("option", [("--noise", "1"), ("--grid", "8,16"), ("--vertices", "900")])
def test_options_of_surfaces_are_refused_for_images(
    tmp_path: Path, option: tuple[str, str]
) -> None:
    words = ["simulate", "--image", "labels", "-o", str(tmp_path / "x.zip"), *option]
    run = CliRunner().invoke(main, words)
    assert run.exit_code == 2
    assert f"{option[0]} is for surfaces" in run.output
    assert not [*tmp_path.iterdir()]


def test_simulated_images_are_what_their_name_says(tmp_path: Path) -> None:
    pytest.importorskip("nibabel")
    words = ["simulate", "--image", "labels", "--frames", "1", "-o"]
    assert CliRunner().invoke(main, [*words, str(tmp_path / "MAP.NII.GZ")]).exit_code == 0
    assert (tmp_path / "MAP.NII.GZ").read_bytes()[:2] == b"\x1f\x8b"
    assert (tmp_path / "MAP.truth.npz").exists()
    for name in ("map.nii", "map.nrrd", "map"):
        result = CliRunner().invoke(main, [*words, str(tmp_path / name)])
        assert result.exit_code != 0
        assert "written as .zip or .nii.gz" in result.output


def test_a_label_map_is_tracked_with_no_landmark(tmp_path: Path) -> None:
    pytest.importorskip("nibabel")
    source = tmp_path / "labels.nii.gz"
    source.write_bytes(write_nifti(ImageSequence((labels(), labels(18.0)))))
    text = run(source, "-o", tmp_path / "b.npz", "--label", 3, "--modes", 7)
    assert "Apex and base were proposed" in text
    assert "topology                   cup" in text
    words = [str(clouds_in(tmp_path)), "-o", str(tmp_path / "c.npz"), "--label", "3"]
    result = CliRunner().invoke(main, ["track", *words])
    assert result.exit_code != 0
    assert "not a label map and has no typed contours" in result.output
    result = CliRunner().invoke(main, ["track", str(source), *words[1:-1], "LV"])
    assert "The label 'LV' is not a whole number" in result.output


def test_a_moving_picture_needs_images(tmp_path: Path) -> None:
    source = str(clouds_in(tmp_path))
    words = [source, "-o", str(tmp_path / "b.npz"), "--plot", str(tmp_path / "b.gif")]
    result = CliRunner().invoke(main, ["track", *words])
    assert result.exit_code == 1
    assert "Name a .png" in result.output
    assert CliRunner().invoke(main, ["track", *words[:-1], str(tmp_path / "b.png")]).exit_code == 0


pytest.importorskip("nibabel")


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("segment") / "labels.nii.gz"
    path.write_bytes(write_nifti(ImageSequence((labels(18.0), labels()))))
    return path


def segmented(*words: object) -> str:
    result = CliRunner().invoke(main, ["segment", *map(str, words)])
    assert result.exit_code == 0, result.output
    return result.stdout


def test_a_surface_is_written_with_its_error(source: Path, tmp_path: Path) -> None:
    output, plot = tmp_path / "lv.ply", tmp_path / "lv.png"
    words = ("--label", 3, "--frame", 1, "--modes", 7)
    numbers = json.loads(segmented(source, "-o", output, *words, "--plot", plot, "--json"))
    assert numbers["volume_ml"] == pytest.approx(enclosed() / 1000.0, rel=0.06)
    assert plot.read_bytes().startswith(b"\x89PNG")
    data = output.read_bytes()
    assert b"property double deviation_across" in data
    frame = read_ply(data)
    assert dict(frame.statements)["unit"] == "mm"
    text = segmented(source, "-o", tmp_path / "lv.h5", *words)
    assert "volume deviation ml" in text
    assert "Apex and base were proposed" in text
    track = track_from_hdf5(tmp_path / "lv.h5")
    assert np.array_equal(track.sequence.vertices[0], frame.positions)


def test_a_frame_that_is_not_there_is_named(source: Path, tmp_path: Path) -> None:
    words = ["segment", str(source), "-o", str(tmp_path / "a.ply"), "--label", "3", "--frame", "2"]
    result = CliRunner().invoke(main, words)
    assert result.exit_code == 1
    assert "Frame 2 has no image" in result.output
