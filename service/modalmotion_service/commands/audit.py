"""Commands for the audit log; a server may be writing it."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterable
from dataclasses import asdict
from datetime import datetime
from pathlib import Path

import click

from modalmotion.cli.outputs import OutputFolder
from modalmotion_service.audit.archive import archive_audit
from modalmotion_service.audit.check import check_audit, unfinished
from modalmotion_service.audit.entry import AuditEntry, Place
from modalmotion_service.audit.key_events import of_command
from modalmotion_service.audit.log import AuditLog, audit_folder, audit_page, parts_in
from modalmotion_service.audit.part import AuditPart
from modalmotion_service.commands.options import DATA_DIR, Moment, folder_of

_ARCHIVE = click.option(
    "--archive",
    type=click.Path(file_okay=False, exists=True, path_type=Path),
    help="Folder that older files of this log were archived in.",
)


@click.group()
def audit() -> None:
    """Read, check and archive the record of who did what."""


@audit.command()
@click.option("--owner", help="Only what this owner did.")
@click.option("--limit", default=100, show_default=True, type=click.IntRange(1, 1_000_000))
@DATA_DIR
def show(owner: str | None, limit: int, data_dir: Path | None) -> None:
    """Write the newest entries as JSON lines, the newest first."""
    _parts(data_dir, None)
    _write(audit_page(audit_folder(folder_of(data_dir)), limit=limit, owner=owner))


@audit.command("unfinished")
@_ARCHIVE
@DATA_DIR
def list_unfinished(archive: Path | None, data_dir: Path | None) -> None:
    """Write the changes that were begun and have no end, as JSON lines.

    They are under way, or a crash cut them off: the store tells whether they were made.
    """
    _write(unfinished(entry for part in _parts(data_dir, archive) for entry in part.entries()))


@audit.command()
@click.option(
    "--noted",
    metavar="NUMBER:SHA256",
    help="Output of an earlier check, kept elsewhere: nothing up to there may be gone.",
)
@_ARCHIVE
@DATA_DIR
def verify(noted: str | None, archive: Path | None, data_dir: Path | None) -> None:
    """Check that no entry was changed, taken out or put in; ends with 1 if one was."""
    place = None
    if noted is not None:
        text = re.fullmatch(r"([0-9]{1,18}):([0-9a-f]{64})", noted)
        if text is None:
            raise click.UsageError("--noted is NUMBER:SHA256, as this command prints it.")
        place = Place(int(text[1]), text[2])
    report = check_audit(_parts(data_dir, archive), place)
    for fault in report.faults:
        click.echo(fault)
    verdict = "whole" if not report.faults else f"{len(report.faults)} faults"
    since = f" after {report.start.number}" if report.start.number else ""
    click.echo(f"{report.n_entries} entries{since}: {verdict}")
    click.echo(report.end)
    if report.faults:
        raise click.exceptions.Exit(1)


@audit.command("archive")
@click.argument("folder", type=OutputFolder())
@click.option(
    "--older-than",
    type=Moment("time", -1),
    help="Only files that were closed before, such as 365d or 2030-12-31 (UTC).",
)
@DATA_DIR
def move_away(folder: Path, older_than: datetime | None, data_dir: Path | None) -> None:
    """Move files that are closed to FOLDER, each checked and copied before it goes.

    A file is closed when it has `audit_entries_per_file` entries; the last one always stays.
    Prints number and digest of the last entry that was moved: note them elsewhere.
    """
    _parts(data_dir, None)
    data = folder_of(data_dir)
    with click.progressbar(length=1, label="archiving", file=sys.stderr) as bar:

        def progress(done: int, total: int) -> None:
            bar.length = total
            bar.update(done - bar.pos)

        moved = archive_audit(data, folder, older_than=older_than, progress=progress)
    if not moved:
        click.echo("Nothing to archive: no such file is closed yet.")
        return
    with AuditLog(data) as log:
        log.append([of_command("audit archive", None, moved[-1].sha256)])
    click.echo(f"{len(moved)} files with the entries up to {moved[-1].number}")
    click.echo(moved[-1])


def _write(entries: Iterable[AuditEntry]) -> None:
    for entry in entries:
        line = {"number": entry.number, "time": entry.time, **asdict(entry.event)}
        click.echo(json.dumps({**line, "sha256": entry.sha256}))


def _parts(data_dir: Path | None, archive: Path | None) -> list[AuditPart]:
    folder = folder_of(data_dir)
    parts = parts_in(audit_folder(folder))
    if not parts:
        raise click.ClickException(f"There is no audit log in {folder}.")
    # A file whose move was interrupted is in both.
    archived = [] if archive is None else parts_in(archive)
    both = {part.path.name: part for part in [*parts, *archived]}
    return [both[name] for name in sorted(both)]
