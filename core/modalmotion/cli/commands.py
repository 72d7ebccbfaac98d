"""The group of all commands; other distributions add theirs as ``modalmotion.commands``."""

import re
import sys
from difflib import get_close_matches
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoints, entry_points
from importlib.util import LazyLoader, find_spec, module_from_spec
from pathlib import Path
from typing import Final

import click

from modalmotion.errors import ModalMotionError, needs_extra

_OF_MODULES: Final = {
    "clinical_commands": "norm readouts score",
    "cohort_command": "cohort",
    "file_commands": "convert decode encode show table",
    "model_commands": "card classify evaluate features train",
    "modes_commands": "animate modes",
    "report_commands": "dicom report view",
    "signature_commands": "reconstruct signature tradeoff",
    "simulate_command": "simulate simulate-cohort",
    "store_commands": "store",
    "track_commands": "segment track",
}
COMMANDS: Final = {name: module for module, all_ in _OF_MODULES.items() for name in all_.split()}
"""Module of each; it is imported when the command is called."""

MEANT: Final = {
    "help": "--help",
    **dict.fromkeys(("ef", "strain", "volume", "volumes"), "readouts"),
    **dict.fromkeys(("info", "inspect", "load", "read"), "show"),
    "plot": "signature FILE --plot beat.png",
}
"""Commands that are asked for by other names."""


class _Commands(click.Group):
    """Adds registered commands, and reports our own errors without a traceback."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return sorted({*super().list_commands(ctx), *COMMANDS, *_registered().names})

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name in COMMANDS:
            _put_off("f2py", "testing", "polynomial", "ma")
            module = import_module(f".{COMMANDS[cmd_name]}", __package__)
            return _command(getattr(module, cmd_name.replace("-", "_")))
        for entry in _registered().select(name=cmd_name):
            with needs_extra("service"):
                return _command(entry.load())
        return super().get_command(ctx, cmd_name)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        try:
            return super().resolve_command(ctx, args)
        except click.UsageError as error:
            near = [MEANT[args[0]]] if args[0] in MEANT else []
            near = near or get_close_matches(args[0], self.list_commands(ctx), n=2)
            if not near:
                raise
            text = f"{error.message.rstrip('.')}. Did you mean {' or '.join(near)}?"
            raise click.UsageError(text, ctx) from error

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, self._line(ctx, name)) for name in self.list_commands(ctx)])

    def invoke(self, ctx: click.Context) -> object:
        try:
            return super().invoke(ctx)
        except ModalMotionError as error:
            raise click.ClickException(str(error)) from error

    def _line(self, ctx: click.Context, name: str) -> str:
        if name in COMMANDS:
            # The first line of its docstring, read without the module's imports.
            source = Path(__file__).with_name(f"{COMMANDS[name]}.py").read_text()
            function = rf'^def {name.replace("-", "_")}\(.*?"""(.*?)(?:"""|\n)'
            found = re.search(function, source, re.DOTALL | re.MULTILINE)
            return found[1] if found else ""
        for entry in _registered().select(name=name):
            # A distribution may contain its lines beside its commands, so that no command is
            # imported.
            lines = getattr(import_module(entry.module.rpartition(".")[0]), "LINES", {})
            if name in lines:
                return str(lines[name])
        command = self.get_command(ctx, name)
        return "" if command is None else command.get_short_help_str(limit=80)


@cache
def _registered() -> EntryPoints:
    """Find the commands of other distributions, once: every one that is installed is opened."""
    return entry_points(group="modalmotion.commands")


def _put_off(*parts: str) -> None:
    """Import parts of NumPy that SciPy names and no command uses only at their first use.

    SciPy's `from numpy import *` takes each, a fifth of what a short command costs.
    """
    import numpy

    for part in parts:
        name = f"numpy.{part}"
        spec = None if name in sys.modules else find_spec(name)
        if spec is None or spec.loader is None:
            continue
        spec.loader = LazyLoader(spec.loader)
        module = sys.modules[name] = module_from_spec(spec)
        spec.loader.exec_module(module)
        setattr(numpy, part, module)


def _command(value: object) -> click.Command | None:
    return value if isinstance(value, click.Command) else None


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="modalmotion")
def main() -> None:
    """Modal signatures and motion classes of surfaces that deform over time."""
