"""Options and helps of all commands: words for each, an example for each, tables in columns."""

from __future__ import annotations

from collections.abc import Iterator

import click
import pytest
from click.testing import CliRunner

from modalmotion.cli import main
from modalmotion.cli.options import aligned


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
