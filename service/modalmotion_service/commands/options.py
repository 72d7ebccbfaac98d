"""Options that several commands share."""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path

import click

from modalmotion.cli.shared import aligned

DATA_DIR = click.option(
    "--data-dir",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder of the results  [default: MODALMOTION_DATA_DIR or modalmotion-data].",
)


def folder_of(data_dir: Path | None) -> Path:
    """Give the stated folder, or that of the settings."""
    # Here, so that the help of all commands need not import the settings.
    from modalmotion_service.settings import read_settings

    return read_settings().data_dir if data_dir is None else data_dir


def folder_with(data_dir: Path | None, name: str, what: str) -> Path:
    """Give the folder, which has a file or folder of that name.

    Raises
    ------
    click.ClickException
        If it does not; `what` says so.
    """
    folder = folder_of(data_dir)
    if not (folder / name).exists():
        raise click.ClickException(
            f"There {what} in {folder.absolute()}. Name the service's data folder with "
            "--data-dir or MODALMOTION_DATA_DIR."
        )
    return folder


def tell_rows(
    head: Sequence[str], rows: Iterable[Sequence[object]], values: object, *, as_json: bool
) -> None:
    """Print a table, or what it shows as JSON."""
    click.echo(json.dumps(values, indent=1) if as_json else aligned([head, *rows]))
