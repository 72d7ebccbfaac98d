"""Commands for keys and for the audit log; a running server notices at once."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import click

from modalmotion_service.access.audit import AuditLog
from modalmotion_service.access.keys import Key, KeyRing
from modalmotion_service.access.scopes import Scope
from modalmotion_service.environment import read_settings

_DATA_DIR = click.option(
    "--data-dir",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder that results lie in  [default: MODALMOTION_DATA_DIR or modalmotion-data].",
)


class _Scopes(click.ParamType[frozenset[Scope]]):
    name = "scopes"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> frozenset[Scope]:
        try:
            return frozenset(Scope(part.strip()) for part in str(value).split(","))
        except ValueError:
            known = ", ".join(Scope)
            self.fail(f"{value!r} names a scope that is none of {known}", param, ctx)


class _Expiry(click.ParamType[datetime]):
    name = "expiry"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> datetime:
        text = str(value)
        try:
            if days := re.fullmatch(r"([1-9][0-9]{0,4})d", text):
                return datetime.now(UTC) + timedelta(days=int(days[1]))
            time = datetime.fromisoformat(text)
        except ValueError:
            self.fail(f"{text!r} is neither days such as 90d nor an ISO 8601 time", param, ctx)
        return time if time.tzinfo else time.replace(tzinfo=UTC)


@click.group()
def keys() -> None:
    """Make, list and take back the keys that open a service."""


@keys.command()
@click.option("--owner", required=True, help="Whose store it opens; 'local': the folder's own.")
@click.option(
    "--scopes",
    required=True,
    type=_Scopes(),
    help=f"Of {', '.join(Scope)}, separated by commas; none includes another.",
)
@click.option("--expires", type=_Expiry(), help="Such as 90d or 2030-12-31 (UTC); never if absent.")
@click.option("--note", default="", help="What it is for; at most 200 characters.")
@_DATA_DIR
def create(
    owner: str,
    scopes: frozenset[Scope],
    expires: datetime | None,
    note: str,
    data_dir: Path | None,
) -> None:
    """Make a key and show it, this once: only its hash is kept."""
    folder = _folder(data_dir)
    is_first = not _keys_of(folder).is_file()
    with KeyRing(folder) as ring:
        key, token = ring.create(owner, scopes, note=note, expires=expires)
    click.echo(_line(key), err=True)
    if is_first:
        # In a wrong folder it would open nothing, and nobody would know why.
        click.echo(f"It is the first key of {folder.absolute()}.", err=True)
    click.echo(token)


@keys.command("list")
@_DATA_DIR
def list_keys(data_dir: Path | None) -> None:
    """List all keys that were ever made, with what they may do."""
    with _ring(data_dir) as ring:
        for key in ring.all():
            click.echo(_line(key))


@keys.command()
@click.argument("key_id", metavar="ID")
@_DATA_DIR
def revoke(key_id: str, data_dir: Path | None) -> None:
    """Take the key with that ID back, at once and for good."""
    with _ring(data_dir) as ring:
        click.echo(_line(ring.revoke(key_id)))


@click.group()
def audit() -> None:
    """Read and check the record of who did what."""


@audit.command()
@click.option("--owner", help="Only what this owner did.")
@click.option("--limit", default=100, show_default=True, type=click.IntRange(1, 1_000_000))
@_DATA_DIR
def show(owner: str | None, limit: int, data_dir: Path | None) -> None:
    """Write the newest entries as JSON lines, the newest first."""
    with _log(data_dir) as log:
        for entry in log.page(limit=limit, owner=owner):
            line = {"number": entry.number, "time": entry.time, **asdict(entry.event)}
            click.echo(json.dumps({**line, "sha256": entry.sha256}))


@audit.command()
@click.option(
    "--noted",
    metavar="NUMBER:SHA256",
    help="What an earlier check printed and was kept elsewhere: nothing up to there is gone.",
)
@_DATA_DIR
def verify(noted: str | None, data_dir: Path | None) -> None:
    """Check that no entry was changed, taken out or put in; ends with 1 if one was."""
    anchor = None
    if noted is not None:
        parts = re.fullmatch(r"([0-9]{1,18}):([0-9a-f]{64})", noted)
        if parts is None:
            raise click.UsageError("--noted is NUMBER:SHA256, as this command prints it.")
        anchor = int(parts[1]), parts[2]
    with _log(data_dir) as log:
        report = log.verify(anchor)
    for fault in report.faults:
        click.echo(fault)
    verdict = "whole" if not report.faults else f"{len(report.faults)} faults"
    click.echo(f"{report.n_entries} entries: {verdict}")
    click.echo(f"{report.n_entries}:{report.head}")
    if report.faults:
        raise click.exceptions.Exit(1)


def _line(key: Key) -> str:
    end = f", until {key.expires}" if key.expires else ""
    note = f"  {key.note}" if key.note else ""
    scopes = ",".join(sorted(key.scopes))
    return f"{key.id}  {key.state:<8} {key.owner}  {scopes}  made {key.created}{end}{note}"


def _folder(data_dir: Path | None) -> Path:
    return read_settings().data_dir if data_dir is None else data_dir


def _keys_of(folder: Path) -> Path:
    return folder / "access" / "keys.sqlite"


def _ring(data_dir: Path | None) -> KeyRing:
    folder = _folder(data_dir)
    if not _keys_of(folder).is_file():
        raise click.ClickException(
            f"There are no keys in {folder.absolute()}. Name the service's data folder with "
            "--data-dir or MODALMOTION_DATA_DIR."
        )
    return KeyRing(folder)


@contextmanager
def _log(data_dir: Path | None) -> Iterator[AuditLog]:
    folder = _folder(data_dir)
    if not (folder / "access" / "audit.sqlite").is_file():
        raise click.ClickException(f"There is no audit log in {folder}.")
    with AuditLog(folder) as log:
        yield log
