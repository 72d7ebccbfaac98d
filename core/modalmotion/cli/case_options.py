"""Options of commands that take labelled files."""

from __future__ import annotations

from pathlib import Path

import click

from modalmotion.cli.options import several
from modalmotion.cli.outputs import OutputFile

labelled_sources = several(
    click.argument(
        "sources",
        metavar="MANIFEST|FILES...",
        nargs=-1,
        required=True,
        type=click.Path(path_type=Path),
    ),
    click.option(
        "--skip-unreadable",
        is_flag=True,
        help="Continue without files that are missing, unreadable or unlike the others; the "
        "summary names them.",
    ),
)
"""MANIFEST or FILES, as `sources`, and the options of all of them."""

unit_option = click.option("--unit", help="Length unit of all files; overrides their own.")
"""Where the answer depends on the unit: features do not."""

cases_option = click.option(
    "--cases",
    "cases_file",
    type=OutputFile(".csv"),
    help="Table to write: probabilities of each case, held out (.csv).",
)
"""The table of held-out cases, as `cases_file`."""
