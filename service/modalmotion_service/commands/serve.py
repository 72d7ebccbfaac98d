"""The command that starts the service."""

from __future__ import annotations

from pathlib import Path

import click

from modalmotion_service.commands.options import DATA_DIR


@click.command()
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen on.")
@click.option("--port", default=8000, show_default=True, help="Port; 0 takes a free one.")
@DATA_DIR
def serve(host: str, port: int, data_dir: Path | None) -> None:
    """Start the HTTP service; its documentation is at /docs."""
    # Here, so that the help of all commands need not import the service.
    from modalmotion_service.commands.server import run
    from modalmotion_service.environment import read_settings

    settings = read_settings() if data_dir is None else read_settings(data_dir=data_dir)
    run(settings, host, port)
