"""Options and helps of all commands: words for each, an example for each, tables in columns."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import click
import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib.figure import Figure

from modalmotion.cli import main, shared
from modalmotion.cli.shared import OutputFile, OutputFolder, aligned, described, write_picture
from modalmotion.errors import StoreError


def all_commands(
    group: click.Group, words: str = "modalmotion"
) -> Iterator[tuple[str, click.Command]]:
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        assert command is not None
        if isinstance(command, click.Group):
            yield from all_commands(command, f"{words} {name}")
        else:
            yield f"{words} {name}", command


COMMANDS = dict(all_commands(main))


@pytest.mark.parametrize("words", COMMANDS)
def test_every_option_has_words_and_every_help_an_example(words: str) -> None:
    command = COMMANDS[words]
    silent = [p.opts for p in command.params if isinstance(p, click.Option) and not p.help]
    assert silent == []
    assert f"Example: {words}" in (command.epilog or "")


def test_columns_are_aligned_and_numbers_end_below_one_another() -> None:
    rows = [("name", "MB"), ("a", "1.5"), ("longer", "12.0")]
    assert aligned(rows).splitlines() == ["name      MB", "a        1.5", "longer  12.0"]
    assert aligned([("name", "MB")]) == "name  MB"


def test_an_answer_is_described_member_by_member() -> None:
    lines = [
        " ".join(line.split())
        for line in described(
            {
                "n_frames": 8,
                "rms_error": np.float64(0.25),
                "is_sound": True,
                "unit": None,
                "faults": (),
                "facts": {},
                "times": [None, *(0.5 * k for k in range(20))],
                "amplitudes": [[1.0, 2.0], [3.0, 4.0]],
                "interval": (1.0, 2.5),
                "modes": [{"label": "a", "largest_error": 1.0}, {"label": "b"}],
                "price": {"n_bytes": 3, "rms": 0.5, "unit": "mm"},
                "notes": ["Mind the gap."],
            }
        )
    ]
    assert lines == [
        *("frames 8", "rms error 0.250", "is sound yes", "times 0.000 to 9.500 (21 values)"),
        *("amplitudes 2 x 2 values", "interval 1.000, 2.500"),
        *(
            "modes:",
            "label largest error",
            "a 1.000",
            "b",
            "price:",
            "bytes 3",
            "rms 0.500 mm",
            "unit mm",
            "note: Mind the gap.",
        ),
    ]


@pytest.mark.parametrize("name", ["signature", "report", "classify", "modes", "encode", "view"])
def test_a_commands_own_options_come_before_those_of_reading(name: str) -> None:
    text = CliRunner().invoke(main, [name, "--help"]).output
    own, _, reading = text.partition("Reading FILE:")
    assert "--json" in own
    assert "--help" in own
    for option in ("--unit", "--frame-interval", "--dtype", "--cavity", "--landmark "):
        assert option in reading
        assert f"\n  {option.strip()} " not in own


def test_a_unit_is_asked_for_where_it_matters() -> None:
    # Features are the same in any unit, and images are in mm.
    for name in ("features", "segment", "card", "decode"):
        assert "--unit" not in CliRunner().invoke(main, [name, "--help"]).output


# Paths that are only read, or that a service makes by itself.
READ = {"source", "sources", "manifest", "data_dir"}


def commands(
    group: click.Group = main, words: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], click.Command]]:
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        assert command is not None
        if isinstance(command, click.Group):
            yield from commands(command, (*words, name))
        else:
            yield (*words, name), command


ALL = [
    pytest.param(words, command, p, id=f"{' '.join(words)} {p.name}")
    for words, command in commands()
    for p in command.params
    if isinstance(p.type, OutputFile | OutputFolder)
]


def arguments(
    command: click.Command, tested: click.Parameter, value: Path, here: Path
) -> list[str]:
    """The tested parameter, and whatever else the command requires; no input is there."""
    told: list[str] = []
    for p in command.params:
        if p is not tested and not p.required:
            continue
        text = str(value)
        if p is not tested:
            text = {"terms": "1,1,cos=1", "name": "mine"}.get(p.name or "", "absent")
            if isinstance(p.type, OutputFile):
                text = str(here / f"other{(*p.type.suffixes, '.out')[0]}")
            elif isinstance(p.type, click.Path) and p.type.exists:
                text = str(here if p.type.dir_okay and not p.type.file_okay else here / "file")
        told += [text] if isinstance(p, click.Argument) else [p.opts[0], text]
    return told


def refused(words: tuple[str, ...], command: click.Command, p: click.Parameter, path: Path) -> str:
    here = path.parent if path.parent.is_dir() else path.parent.parent
    (here / "file").touch()
    run = CliRunner().invoke(main, [*words, *arguments(command, p, path, here)])
    assert run.exit_code == 2, run.output
    assert "absent" not in run.output.replace("\n", " ").partition("Error:")[2]
    return " ".join(run.output.split())


def test_every_path_is_read_or_checked() -> None:
    for words, command in commands():
        for p in command.params:
            if isinstance(p.type, click.Path) and not isinstance(p.type, OutputFile | OutputFolder):
                assert p.type.exists or p.name in READ, (words, p.name)
    assert len(ALL) >= 20


@pytest.mark.parametrize(("words", "command", "p"), ALL)
def test_what_cannot_be_written_is_refused_first(
    words: tuple[str, ...],
    command: click.Command,
    p: click.Parameter,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    suffixes: tuple[str, ...] = getattr(p.type, "suffixes", ())
    suffix = (*suffixes, "")[0]
    if isinstance(p.type, OutputFolder):
        (tmp_path / "taken").touch()
        assert "is a file, not a folder" in refused(words, command, p, tmp_path / "taken" / "in")
    else:
        missing = tmp_path / "no" / f"out{suffix}"
        assert "does not exist; make it first" in refused(words, command, p, missing)
        (tmp_path / f"taken{suffix}").mkdir()
        assert "add the name" in refused(words, command, p, tmp_path / f"taken{suffix}")
        if suffixes:
            told = refused(words, command, p, tmp_path / "out.xyz")
            assert all(known in told for known in suffixes), told
    monkeypatch.setattr(os, "access", lambda _, mode, **__: mode == os.R_OK)
    assert "may not write" in refused(words, command, p, tmp_path / f"out{suffix}")


def test_two_outputs_are_two_files(tmp_path: Path) -> None:
    both = str(tmp_path / "beat.png")
    run = CliRunner().invoke(main, ["signature", "absent", "-o", both, "--plot", both])
    assert (run.exit_code, "named twice" in run.output) == (2, True)


def test_pictures_need_matplotlib_before_any_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shared, "find_spec", lambda _: None)
    for words in (
        ("signature", "absent", "--plot", "a.png"),
        ("modes", "absent", "-o", "a.svg"),
        ("animate", "absent", "--mode", "1,1,cos=1", "-o", "a.gif"),
    ):
        run = CliRunner().invoke(main, [*words[:-1], str(tmp_path / words[-1])])
        assert "pip install matplotlib" in run.output


def test_names_in_capitals_pass(tmp_path: Path) -> None:
    context = click.Context(click.Command("x"))
    for name in ("A.PNG", "a.pdf"):
        assert OutputFile(".png", ".pdf").convert(str(tmp_path / name), None, context).name == name


def test_a_picture_is_written_whole_or_not_at_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, start in (("a.PNG", b"\x89PNG"), ("a.svg", b"<?xml"), ("a.pdf", b"%PDF")):
        write_picture(Figure(figsize=(1, 1)), tmp_path / name)
        assert (tmp_path / name).read_bytes().startswith(start)

    def full(*_: object) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "write", full)
    with pytest.raises(StoreError, match="No space"):
        write_picture(Figure(figsize=(1, 1)), tmp_path / "b.png")
    assert not (tmp_path / "b.png").exists()


def test_devices_are_not_replaced() -> None:
    run = CliRunner().invoke(main, ["encode", "absent", "-o", os.devnull])
    assert (run.exit_code, "is a device" in run.output) == (2, True)
