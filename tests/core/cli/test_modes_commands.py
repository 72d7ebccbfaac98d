"""`modalmotion modes` and `modalmotion animate`: every output, every refusal before the work."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from PIL import Image, ImageSequence

from modalmotion.cli import main
from modalmotion.formats import read_sequence, write_npz
from modalmotion.simulate import Acquisition, simulate_ventricle
from modalmotion.template import make_template


@pytest.fixture
def beat(tmp_path: Path) -> Path:
    path = tmp_path / "beat.npz"
    path.write_bytes(write_npz(simulate_ventricle(grid=(6, 8), acquisition=Acquisition(3))))
    return path


def run(*arguments: object) -> Result:
    return CliRunner().invoke(main, [*map(str, arguments)])


def test_the_table_of_a_lattice_and_of_a_file(beat: Path) -> None:
    table = run("modes", "cylinder", "--grid", "32,64", "--modes", 7)
    assert table.exit_code == 0, table.output
    assert "(1, 1, sin)" in table.output
    assert "K = M = 1" in table.output
    volume = json.loads(run("modes", "open x open x closed", "--modes", 3, "--json").output)
    assert volume["surface"] == "open x open x closed"
    own = json.loads(run("modes", beat, "--modes", 3, "--json").output)
    assert own["surface"] == "cup"
    assert [mode["label"] for mode in own["modes"]][-1] == "(0, 1, sin)"
    springs = json.loads(run("modes", beat, "--topology", "mesh", "--json").output)
    assert springs["surface"] == "mesh"
    lengths = make_template(read_sequence(beat).sequence).lengths
    assert own["modes"][1]["angular_frequency"] == pytest.approx(np.pi / lengths[0])


@pytest.mark.parametrize(
    ("name", "start"),
    [("m.png", b"\x89PNG"), ("m.glb", b"glTF"), ("m.npz", b"PK"), ("m.h5", b"\x89HDF")],
)
def test_modes_are_written(tmp_path: Path, beat: Path, name: str, start: bytes) -> None:
    done = run("modes", beat, "--modes", 2, "-o", tmp_path / name)
    assert done.exit_code == 0, done.output
    assert (tmp_path / name).read_bytes().startswith(start)


@pytest.mark.every(2)
@pytest.mark.parametrize("name", ["a.vtkhdf", "a.npz", "a.glb", "a.gif"])
def test_animations_are_written(tmp_path: Path, beat: Path, name: str) -> None:
    output = tmp_path / name
    modes = ("--mode", "1,1,cos=2", "--mode", "0,2,sin=-1")
    done = run("animate", beat, *modes, "-o", output, "--frames", 4)
    assert done.exit_code == 0, done.output
    if name.endswith(("vtkhdf", "npz", "glb")):
        sequence = read_sequence(output).sequence
        assert (sequence.n_frames, sequence.unit) == (4, "mm")
        assert np.ptp(sequence.vertices, axis=0).max() > 1.0
    else:
        with Image.open(output) as gif:
            assert len([*ImageSequence.Iterator(gif)]) == 4


@pytest.mark.parametrize(
    ("mode", "words"),
    [
        ("1,1=5", "label of a mode"),
        ("1,0,sin=5", "zero everywhere"),
        ("-1,0,cos=5", "backwards"),
        ("1,99,cos=5", "two edge lengths"),
        ("1,1,cos=inf", "finite"),
        ("1,1,cos=much", "not an amplitude"),
        ("spring 3=1", "closed form"),
    ],
)
def test_modes_that_are_none_are_refused(tmp_path: Path, beat: Path, mode: str, words: str) -> None:
    done = run("animate", beat, "--mode", mode, "-o", tmp_path / "a.glb")
    assert done.exit_code == 1
    assert words in done.output
    assert not (tmp_path / "a.glb").exists()


@pytest.mark.parametrize(
    ("output", "words"),
    [("no/a.glb", "make it first"), ("a.mp4", "ends with none")],
)
def test_what_cannot_be_written_is_refused_before_anything_is_read(
    tmp_path: Path, output: str, words: str
) -> None:
    absent = tmp_path / "absent.npz"
    for command in (["animate", absent, "--mode", "0,0,cos=1"], ["modes", absent]):
        done = run(*command, "-o", tmp_path / output)
        assert done.exit_code == 2
        assert words in done.output


def test_volumes_have_no_picture_and_names_that_are_neither_say_so(tmp_path: Path) -> None:
    volume = run("modes", "open x open x closed", "-o", tmp_path / "v.png")
    assert "A volume has no surface" in volume.output
    assert run("modes", tmp_path / "nothing").exit_code != 0
    frames = ("--frames", 20_000)
    many = run("animate", "plane", "--mode", "0,1,cos=1", "-o", tmp_path / "a.gif", *frames)
    assert "at most 10000" in many.output
