from __future__ import annotations

import json
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from template_surfaces import MAKERS, cut_in_two

from modalmotion.cli import commands, main
from modalmotion.formats import read_npz
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.store import signature_from_hdf5

SIMULATE = ["--frames", "6", "--grid", "8,16", "--noise", "0.2", "--seed", "4"]


@pytest.fixture
def beat(tmp_path: Path) -> Path:
    path = tmp_path / "beat.npz"
    run = CliRunner().invoke(main, ["simulate", "-o", str(path), *SIMULATE])
    assert run.exit_code == 0, run.output
    return path


def test_simulating_twice_with_one_seed_gives_the_same_file(beat: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.npz"
    CliRunner().invoke(main, ["simulate", "-o", str(other), *SIMULATE])
    assert other.read_bytes() == beat.read_bytes()
    CliRunner().invoke(main, ["simulate", "-o", str(other), *SIMULATE[:-1], "5"])
    assert other.read_bytes() != beat.read_bytes()


def test_doubled_rims_are_merged(tmp_path: Path) -> None:
    vertices, faces = cut_in_two(MAKERS["cup"](120, np.random.default_rng(1)))
    path = tmp_path / "cut.npz"
    np.savez(path, vertices=vertices, faces=faces, unit="mm")
    run = CliRunner().invoke(main, ["signature", str(path), "--json"])
    assert run.exit_code == 0, run.output
    answer = json.loads(run.stdout)
    assert (answer["topology"], answer["n_vertices"]) == ("cup", vertices.shape[1])


def test_signature_writes_what_the_library_computes(beat: Path, tmp_path: Path) -> None:
    out, plot = tmp_path / "beat.h5", tmp_path / "beat.png"
    run = CliRunner().invoke(
        main, ["signature", str(beat), "-o", str(out), "--plot", str(plot), "--json"]
    )
    assert run.exit_code == 0, run.output
    own = modal_signature(read_npz(beat.read_bytes()).sequence)
    assert json.loads(run.stdout)["rms_error"] == own.rms_error
    assert np.array_equal(signature_from_hdf5(out).amplitudes, own.amplitudes)
    assert plot.read_bytes().startswith(b"\x89PNG")


def test_options_reach_the_library(beat: Path, tmp_path: Path) -> None:
    out = tmp_path / "beat.h5"
    options = ["--modes", "18", "--topology", "cylinder"]
    options += ["--reference", "2", "--no-remove-rotation"]
    run = CliRunner().invoke(main, ["signature", str(beat), "-o", str(out), *options])
    assert run.exit_code == 0, run.output
    found = signature_from_hdf5(out)
    assert found.parameters == SignatureParameters(
        modes=18,
        topology="cylinder",
        reference=2,
        remove_rotation=False,
    )
    assert "spectrum" in run.output


def test_the_mean_shape_can_be_the_reference(beat: Path, tmp_path: Path) -> None:
    out, plot = tmp_path / "mean.h5", tmp_path / "mean.png"
    options = ["--reference", "mean", "--plot", str(plot)]
    run = CliRunner().invoke(main, ["signature", str(beat), "-o", str(out), *options])
    assert run.exit_code == 0, run.output
    assert signature_from_hdf5(out).parameters == SignatureParameters(reference="mean")
    assert plot.exists()
    wrong = CliRunner().invoke(main, ["signature", str(beat), "--reference", "median"])
    assert wrong.exit_code == 2
    assert "not a frame" in wrong.output


@pytest.mark.parametrize("suffix", [".npz", ".vtkhdf", ".zip"])
def test_reconstructions_read_back_as_what_was_fitted(
    beat: Path, tmp_path: Path, suffix: str
) -> None:
    out = tmp_path / f"few{suffix}"
    run = CliRunner().invoke(main, ["reconstruct", str(beat), "-o", str(out)])
    assert run.exit_code == 0, run.output
    again = CliRunner().invoke(main, ["signature", str(out), "--json", "--topology", "cup"])
    assert again.exit_code == 0, again.output
    assert json.loads(again.stdout)["rms_error"] < 1e-3


def test_a_folder_of_frames_is_a_sequence(beat: Path, tmp_path: Path) -> None:
    import zipfile

    archive = tmp_path / "few.zip"
    CliRunner().invoke(main, ["reconstruct", str(beat), "-o", str(archive)])
    folder = tmp_path / "frames"
    with zipfile.ZipFile(archive) as unzipped:
        unzipped.extractall(folder)
    for source in (folder, folder / "frame_*.ply"):
        run = CliRunner().invoke(main, ["signature", str(source), "--json"])
        assert run.exit_code == 0, run.output
        assert json.loads(run.stdout)["n_frames"] == 6


def test_classify_names_a_class_or_says_why_not(beat: Path) -> None:
    run = CliRunner().invoke(main, ["classify", str(beat), "--json"])
    answer = json.loads(run.stdout)
    assert sum(answer["probabilities"].values()) == pytest.approx(1.0)
    assert answer["label"] is not None or answer["notes"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["signature", "missing.npz"], "cannot be read"),
        (["signature", "{beat}", "--modes", "0"], "0 modes"),
        (["signature", "{beat}", "--grid", "3,x"], "lattice shape"),
        (["signature", "{beat}", "--topology", "knot"], "knot"),
        (["classify", "{beat}", "--model", "nobody"], "nobody"),
        (["reconstruct", "{beat}", "-o", "x.stl"], ".npz"),
        (["simulate", "-o", "x.npz", "--ejection-fraction", "2"], "ejection"),
        (["simulate", "-o", "x.npz", "--grid", "3,5"], "odd"),
    ],
)
def test_mistakes_are_told_in_one_line_without_a_traceback(
    beat: Path, arguments: list[str], words: str
) -> None:
    arguments = [argument.format(beat=beat) for argument in arguments]
    run = CliRunner().invoke(main, arguments)
    assert run.exit_code != 0
    assert words in run.output
    assert "Traceback" not in run.output
    assert run.exception is None or isinstance(run.exception, SystemExit)


def test_half_a_file_leaves_no_output(beat: Path, tmp_path: Path) -> None:
    half, out = tmp_path / "half.npz", tmp_path / "out.h5"
    half.write_bytes(beat.read_bytes()[:500])
    run = CliRunner().invoke(main, ["signature", str(half), "-o", str(out)])
    assert run.exit_code == 1
    assert not out.exists()


def test_commands_of_the_service_are_found() -> None:
    run = CliRunner().invoke(main, ["--help"])
    assert {"classify", "reconstruct", "serve", "signature", "simulate", "store"} <= set(
        run.output.split()
    )


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("modalmotion sig", "plain,signature"),
        ("modalmotion signature --tolerance-", "plain,--tolerance-of"),
        ("modalmotion signature beat.npz --plot be", "file,be"),
    ],
)
def test_the_shell_completes_commands_options_and_files(
    words: str, expected: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("_MODALMOTION_COMPLETE", "bash_complete")
    monkeypatch.setenv("COMP_WORDS", words)
    monkeypatch.setenv("COMP_CWORD", str(len(words.split()) - 1))
    with pytest.raises(SystemExit):
        main(prog_name="modalmotion")
    assert expected in capsys.readouterr().out.splitlines()


def test_a_command_without_its_packages_names_what_is_missing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    absent = EntryPoint("gone", "absent_package.commands:gone", "modalmotion.commands")
    monkeypatch.setattr(commands, "_registered", lambda: EntryPoints([absent]))
    result = CliRunner().invoke(main, ["gone", "--help"])
    assert result.exit_code == 1
    assert "needs the package absent_package" in result.output
