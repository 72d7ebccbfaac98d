"""Commands for the audit log; a server may be writing it."""

import json
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path

import click

from modalmotion.cli.shared import example
from modalmotion_service.access.audit import AUDIT, AuditEntry, AuditLog
from modalmotion_service.commands.options import DATA_DIR, folder_with


@click.group()
def audit() -> None:
    """Read the audit log."""


@audit.command(epilog=example("audit show --owner lab --limit 20"))
@click.option("--owner", help="Only what this owner did.")
@click.option(
    "--limit",
    default=100,
    show_default=True,
    type=click.IntRange(1, 1_000_000),
    help="Entries to write at most.",
)
@DATA_DIR
def show(owner: str | None, limit: int, data_dir: Path | None) -> None:
    """Write the newest entries as JSON lines, the newest first."""
    with _log(data_dir) as log:
        _write(log.page(limit=limit, owner=owner))


@audit.command(epilog=example("audit unfinished --data-dir results"))
@DATA_DIR
def unfinished(data_dir: Path | None) -> None:
    """Write the changes that were begun but not completed, as JSON lines.

    They are under way, or a crash cut them off: the store tells whether they were made.
    """
    with _log(data_dir) as log:
        _write(log.unfinished())


def _write(entries: Iterable[AuditEntry]) -> None:
    for entry in entries:
        click.echo(json.dumps(asdict(entry)))


def _log(data_dir: Path | None) -> AuditLog:
    return AuditLog(folder_with(data_dir, AUDIT, "is no audit log"))
