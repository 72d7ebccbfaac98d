"""Commands for the audit log; a server may be writing it."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable
from dataclasses import asdict, replace
from datetime import datetime
from pathlib import Path

import click

from modalmotion.cli.options import example, json_option, tell
from modalmotion.cli.outputs import OutputFolder
from modalmotion_service.audit.archive import archive_audit
from modalmotion_service.audit.check import check_audit, unfinished
from modalmotion_service.audit.entry import AuditEntry, Place, place_from
from modalmotion_service.audit.heads import has_heads, heads_of, note_head, places_in
from modalmotion_service.audit.key_events import of_command
from modalmotion_service.audit.log import AuditLog, audit_folder, audit_page, head_of, parts_in
from modalmotion_service.audit.part import AuditPart
from modalmotion_service.commands.options import DATA_DIR, Moment, folder_of

_MOST_PRINTED = 20
_ARCHIVE = click.option(
    "--archive",
    type=click.Path(file_okay=False, exists=True, path_type=Path),
    help="Folder that older files of this log were archived in.",
)


@click.group()
def audit() -> None:
    """Read, check and archive the record of who did what."""


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
    _parts(data_dir, None)
    _write(audit_page(audit_folder(folder_of(data_dir)), limit=limit, owner=owner))


@audit.command("unfinished", epilog=example("audit unfinished --data-dir results"))
@_ARCHIVE
@DATA_DIR
def list_unfinished(archive: Path | None, data_dir: Path | None) -> None:
    """Write the changes that were begun and have no end, as JSON lines.

    They are under way, or a crash cut them off: the store tells whether they were made.
    """
    _write(unfinished(entry for part in _parts(data_dir, archive) for entry in part.entries()))


@audit.command(epilog=example("audit verify --notes heads.txt"))
@click.option(
    "--noted",
    metavar="NUMBER:SHA256",
    help="Output of an earlier check, kept elsewhere: nothing up to there may be gone.",
)
@click.option(
    "--notes",
    multiple=True,
    type=click.Path(exists=True, path_type=Path),
    help="Text with heads, such as the service's log or the output of `audit note`; or a backup.",
)
@_ARCHIVE
@json_option
@DATA_DIR
def verify(
    noted: str | None,
    notes: tuple[Path, ...],
    archive: Path | None,
    as_json: bool,
    data_dir: Path | None,
) -> None:
    """Check that no entry was changed, taken out or put in; ends with 1 if one was.

    What is there is compared with the heads that were noted beside the log, and in NOTES.
    """
    place = None
    if noted is not None:
        try:
            place = place_from(noted)
        except ValueError as error:
            raise click.UsageError(
                "--noted is NUMBER:SHA256, as this command prints it."
            ) from error
    parts, folder = _parts(data_dir, archive), audit_folder(folder_of(data_dir))
    own = heads_of(folder)
    heads = [*own, *(head for path in notes for head in _noted_in(path))]
    report = check_audit(parts, place, heads)
    if not own and (has_heads(folder) or not (report.n_entries or heads or noted)):
        # Every log notes its head when it is begun.
        fault = "the heads beside the log are gone: its entries may be, too"
        report = replace(report, faults=(*report.faults, fault))
    said = list(map(str, report.faults[:_MOST_PRINTED]))
    if not heads and noted is None:
        said.append("No head was noted: whether the end is gone, or all is new, cannot be told.")
    verdict = "whole" if not report.faults else f"{len(report.faults)} faults"
    since = f" after {report.start.number}" if report.start.number else ""
    said += [f"{report.n_entries} entries{since}: {verdict}", str(report.end)]
    answer = {
        "is_whole": not report.faults,
        "n_entries": report.n_entries,
        "after": report.start.number,
        "head": str(report.end),
        "n_noted": len(heads) + (noted is not None),
        "faults": list(map(str, report.faults)),
    }
    tell(answer, said, as_json=as_json)
    if report.faults:
        raise click.exceptions.Exit(1)


@audit.command(epilog=example("audit note >> heads.txt"))
@json_option
@DATA_DIR
def note(as_json: bool, data_dir: Path | None) -> None:
    """Note number and digest of the last entry beside the log, and print them.

    Kept elsewhere, as in the journal, they show with `audit verify --notes` what is gone.
    """
    _parts(data_dir, None)
    folder = audit_folder(folder_of(data_dir))
    head = head_of(folder)
    note_head(folder, head)
    tell({"head": str(head)}, [str(head)], as_json=as_json)


@audit.command("archive", epilog=example("audit archive old-entries --older-than 365d"))
@click.argument("folder", type=OutputFolder())
@click.option(
    "--older-than",
    type=Moment("time", -1),
    help="Only files that were closed before, such as 365d or 2030-12-31 (UTC).",
)
@json_option
@DATA_DIR
def move_away(
    folder: Path, older_than: datetime | None, as_json: bool, data_dir: Path | None
) -> None:
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
        said = ["Nothing to archive: no such file is closed yet."]
        tell({"n_files": 0, "head": None}, said, as_json=as_json)
        return
    with AuditLog(data) as log:
        log.append([of_command("audit archive", None, moved[-1].sha256)])
    head = str(moved[-1])
    said = [f"{len(moved)} files with the entries up to {moved[-1].number}", head]
    tell({"n_files": len(moved), "head": head}, said, as_json=as_json)


def _noted_in(path: Path) -> list[Place]:
    """Find the heads in a text, or those of a backup and the ends of its log."""
    if not path.is_dir():
        return places_in(path)
    folder = audit_folder(path)
    found = [*heads_of(folder), head_of(folder)]
    if not folder.is_dir():
        raise click.BadParameter(f"{path} holds no audit log.", param_hint="--notes")
    return found


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
