"""Every command that does not serve answers in JSON where it is asked to, and in that alone."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click
import pytest
from click.testing import CliRunner

from modalmotion.cli import main
from modalmotion.formats import write_npz
from modalmotion.simulate import Acquisition, simulate_ventricle

# What they print is a table or lines of JSON already, or they end when they are stopped.
OTHERWISE = {"serve", "table", "audit show", "audit unfinished"}


def commands(group: click.Group, words: tuple[str, ...] = ()) -> dict[str, click.Command]:
    context = click.Context(group)
    found: dict[str, click.Command] = {}
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        if isinstance(command, click.Group):
            found |= commands(command, (*words, name))
        elif command is not None:
            found[" ".join((*words, name))] = command
    return found


def test_every_command_has_the_option() -> None:
    without = {
        name
        for name, command in commands(main).items()
        if not any("--json" in p.opts for p in command.params)
    }
    assert without == OTHERWISE


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("json")
    beat = simulate_ventricle(grid=(8, 12), acquisition=Acquisition(n_frames=6))
    (folder / "beat.npz").write_bytes(write_npz(beat))
    return folder


def answered(folder: Path, text: str) -> dict[str, Any]:
    done = CliRunner().invoke(main, [*text.format(here=folder).split(), "--json"])
    assert done.exit_code == 0, (text, done.output)
    answer: dict[str, Any] = json.loads(done.stdout)
    for path in answer.get("written", ()):
        assert Path(path).exists(), path
    return answer


def test_what_is_made_of_a_sequence_is_told(folder: Path) -> None:
    made = answered(folder, "simulate -o {here}/made.npz --grid 8,12 --frames 6")
    assert (made["n_frames"], made["unit"]) == (6, "mm")
    assert made["written"] == [str(folder / "made.npz")]
    stream = answered(folder, "encode {here}/beat.npz -o {here}/beat.mms --max-error 0.5")
    assert stream["n_bytes"] == (folder / "beat.mms").stat().st_size
    assert 0.0 < stream["max_error"] <= 0.5
    back = answered(folder, "decode {here}/beat.mms -o {here}/back.npz --first 1 --stop 3")
    assert back["n_frames"] == 2
    again = answered(folder, "reconstruct {here}/beat.npz -o {here}/again.npz --modes 3")
    assert again["rms_error"] > 0
    swing = answered(folder, "animate cup --mode 1,1,cos=0.1 -o {here}/swing.npz --frames 4")
    assert swing["modes"] == ["(1, 1, cos)"]
    page = answered(folder, "view {here}/beat.npz -o {here}/beat.html")
    assert page["titles"] == ["beat.npz"]


def test_a_store_is_looked_after_in_json(folder: Path) -> None:
    pytest.importorskip("modalmotion_service")
    (folder / "cases.csv").write_text("path\nbeat.npz\n")
    made = answered(folder, "cohort {here}/cases.csv -o {here}/store")
    assert (made["n_made"], made["n_known"], made["failures"]) == (1, 0, [])
    sound = answered(folder, "store verify {here}/store")["stores"]["local"]
    assert (sound["is_sound"], sound["n_sequences"]) == (True, 1)
    assert answered(folder, "store export {here}/store {here}/out.h5")["n_signatures"] == 1
    copied = answered(folder, "store backup {here}/store {here}/copy")
    assert copied["n_copied"] == copied["n_files"] > 0
    back = answered(folder, "store restore {here}/copy {here}/other")
    assert back["stores"]["local"]["n_sequences"] == 1
    assert answered(folder, "store rebuild {here}/store")["stores"]["local"]["n_results"] == 1
    (folder / "store" / "cohort.csv").unlink(missing_ok=True)
    next((folder / "store").rglob("*.h5")).write_bytes(b"damaged")
    done = CliRunner().invoke(main, ["store", "verify", str(folder / "store"), "--json"])
    assert done.exit_code == 1
    assert json.loads(done.stdout)["stores"]["local"]["faults"]


def test_keys_are_told_in_json(folder: Path) -> None:
    pytest.importorskip("modalmotion_service")
    there = f"--data-dir {folder / 'kept'}"
    key = answered(folder, f"keys create --owner lab --scopes read {there}")
    assert key["token"].startswith("mm_")
    assert (key["owner"], key["scopes"], key["state"]) == ("lab", ["read"], "active")
    assert answered(folder, f"keys revoke {key['id']} {there}")["state"] == "revoked"
