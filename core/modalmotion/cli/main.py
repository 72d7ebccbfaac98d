"""The group of all commands; other distributions add theirs as ``modalmotion.commands``."""

from __future__ import annotations

from importlib.metadata import entry_points

import click

from modalmotion.cli.analysis_commands import classify, reconstruct, signature
from modalmotion.cli.codec_commands import decode, encode
from modalmotion.cli.simulate_command import simulate
from modalmotion.cli.store_commands import store
from modalmotion.cli.tradeoff_command import tradeoff
from modalmotion.errors import ModalMotionError


class _Commands(click.Group):
    """Adds registered commands, and reports our own errors without a traceback."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        registered = {entry.name for entry in entry_points(group="modalmotion.commands")}
        return sorted({*super().list_commands(ctx), *registered})

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        own = super().get_command(ctx, cmd_name)
        if own is not None:
            return own
        for entry in entry_points(group="modalmotion.commands", name=cmd_name):
            command = entry.load()
            if isinstance(command, click.Command):
                return command
        return None

    def invoke(self, ctx: click.Context) -> object:
        try:
            return super().invoke(ctx)
        except ModalMotionError as error:
            raise click.ClickException(str(error)) from error


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="modalmotion")
def main() -> None:
    """Modal signatures and classes of nonrigidly moving surfaces."""


for command in (signature, reconstruct, encode, decode, classify, simulate, store, tradeoff):
    main.add_command(command)
