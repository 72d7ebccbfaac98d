"""Options that several commands share."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Final

import click

from modalmotion.cli.options import aligned

DATA_DIR = click.option(
    "--data-dir",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder that results are in  [default: MODALMOTION_DATA_DIR or modalmotion-data].",
)


def folder_of(data_dir: Path | None) -> Path:
    """Give the stated folder, or that of the settings."""
    # Here, so that the help of all commands need not import the settings.
    from modalmotion_service.settings import read_settings

    return read_settings().data_dir if data_dir is None else data_dir


def tell_rows(
    head: Sequence[str], rows: Iterable[Sequence[object]], values: object, *, as_json: bool
) -> None:
    """Print a table, or what it shows as JSON."""
    click.echo(json.dumps(values, indent=1) if as_json else aligned([head, *rows]))


class Moment(click.ParamType[datetime]):
    """A time, or days from now such as 90d.

    Parameters
    ----------
    sign : int
        1 if days count from now on, -1 if they count back.
    """

    def __init__(self, name: str, sign: int) -> None:
        self.name = name
        self._sign = sign

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> datetime:
        """Read it; without a time zone it is UTC."""
        text = str(value)
        try:
            if days := _DAYS.fullmatch(text):
                return datetime.now(UTC) + timedelta(days=self._sign * int(days[1]))
            time = datetime.fromisoformat(text)
        except ValueError:
            self.fail(f"{text!r} is neither days such as 90d nor an ISO 8601 time", param, ctx)
        return time if time.tzinfo else time.replace(tzinfo=UTC)


_DAYS: Final = re.compile(r"([1-9][0-9]{0,4})d")
