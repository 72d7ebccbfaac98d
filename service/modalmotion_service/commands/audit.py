"""Commands for the audit log; a server may be writing it."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

import click

from modalmotion.cli.options import example, json_option, tell
from modalmotion_service.audit.entry import AuditEntry
from modalmotion_service.audit.log import AuditLog, audit_path, entries_of, faults_of, unfinished
from modalmotion_service.commands.options import DATA_DIR, folder_with

_MOST_PRINTED = 20


@click.group()
def audit() -> None:
    """Read and check the record of who did what."""


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
    with AuditLog(_there(data_dir)) as log:
        _write(log.page(limit=limit, owner=owner))


@audit.command("unfinished", epilog=example("audit unfinished --data-dir results"))
@DATA_DIR
def list_unfinished(data_dir: Path | None) -> None:
    """Write the changes that were begun and have no end, as JSON lines.

    They are under way, or a crash cut them off: the store tells whether they were made.
    """
    _write(unfinished(_entries(data_dir)))


@audit.command(epilog=example("audit verify --lines audit.jsonl"))
@click.option(
    "--lines",
    multiple=True,
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="Lines of the log as they were collected elsewhere (`audit_stream`).",
)
@json_option
@DATA_DIR
def verify(lines: tuple[Path, ...], as_json: bool, data_dir: Path | None) -> None:
    """Check that no entry was changed, taken out or put in; ends with 1 if one was.

    That the end is gone, or all was made anew, shows by the lines that were collected elsewhere.
    """
    handed_on = {number: digest for path in lines for number, digest in _read(path)}
    # Here, so that the help of all commands need not import the settings.
    from modalmotion_service.settings import read_settings

    forgets = read_settings().audit_days > 0
    n_entries, faults = faults_of(_entries(data_dir), handed_on, forgets=forgets)
    verdict = "whole" if not faults else f"{len(faults)} faults"
    said = [*faults[:_MOST_PRINTED], f"{n_entries} entries: {verdict}"]
    if not handed_on:
        said.append("No lines were named: whether the end is gone, or all is new, cannot be told.")
    answer = {"is_whole": not faults, "n_entries": n_entries, "n_lines": len(handed_on)}
    tell({**answer, "faults": faults}, said, as_json=as_json)
    if faults:
        raise click.exceptions.Exit(1)


def _read(path: Path) -> Iterable[tuple[int, str]]:
    """Find numbers and digests of the table's entries in collected lines."""
    with path.open(errors="replace") as lines:
        for line in lines:
            try:
                # A log host may have put a head before it.
                entry = json.loads(line[line.index("{") :])
                if entry["audit"] == "table":
                    yield int(entry["number"]), str(entry["sha256"])
            except (ValueError, KeyError, TypeError):
                continue


def _write(entries: Iterable[AuditEntry]) -> None:
    for entry in entries:
        click.echo(json.dumps(entry.line))


def _there(data_dir: Path | None) -> Path:
    return folder_with(data_dir, audit_path(Path()).as_posix(), "is no audit log")


def _entries(data_dir: Path | None) -> Iterable[AuditEntry]:
    return entries_of(audit_path(_there(data_dir)))
