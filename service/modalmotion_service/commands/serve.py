"""The command that starts the service."""

import gc
import os
from pathlib import Path

import click

from modalmotion.cli.shared import example
from modalmotion_service.commands.options import DATA_DIR
from modalmotion_service.work.forks import FORKS, take_one_thread


class _WithSettings(click.Command):
    """A command whose help lists the settings of the environment too."""

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        # Here, so that the help of all commands need not import the settings.
        from modalmotion_service.commands.settings import described
        from modalmotion_service.settings import read_settings

        super().format_epilog(ctx, formatter)
        with formatter.section("Settings, of the environment (see `modalmotion settings`)"):
            formatter.write_dl(
                [
                    (one["variable"], f"{one['meaning']}  [default: {one['default']}]")
                    for one in described(read_settings())
                ]
            )


@click.command(cls=_WithSettings, epilog=example("serve --port 8000 --data-dir results"))
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen on.")
@click.option("--port", default=8000, show_default=True, help="Port; 0 takes a free one.")
@DATA_DIR
@click.option(
    "--stateless",
    is_flag=True,
    help="Store nothing, so that several instances can answer the same requests.",
)
@click.option(
    "--read-only-dir",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    help="With --stateless: data folder or backup whose keys, models and templates are served.",
)
def serve(
    host: str, port: int, data_dir: Path | None, stateless: bool, read_only_dir: Path | None
) -> None:
    """Start the HTTP service; its documentation is at /docs."""
    # Nothing of what is imported is ever garbage: `run_app` has it looked for again.
    gc.disable()
    # What workers write is as much its users' data.
    os.umask(0o077)
    take_one_thread()
    # Here, so that the help of all commands need not import the service.
    from modalmotion_service.commands.server import run
    from modalmotion_service.settings import read_settings

    stated = {"data_dir": data_dir, "stateless": stateless or None, "read_only_dir": read_only_dir}
    settings = read_settings(**{name: one for name, one in stated.items() if one is not None})
    FORKS.split_off()
    run(settings, host, port)
