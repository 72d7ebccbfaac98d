"""Commands for keys; a running server notices at once."""

import re
from dataclasses import asdict
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

import click

from modalmotion.cli.shared import aligned, example, json_option, tell
from modalmotion_service.access.audit import AuditLog, note_key, take_back_key
from modalmotion_service.access.keys import KEYS, Key, KeyRing
from modalmotion_service.access.scopes import Scope
from modalmotion_service.commands.options import DATA_DIR, folder_of, folder_with, tell_rows

_DAYS: Final = re.compile(r"([1-9][0-9]{0,4})d")
_HEAD: Final = ("key", "state", "owner", "scopes", "made", "until", "note")


def _scopes(text: str) -> frozenset[Scope]:
    try:
        return frozenset(Scope(part.strip()) for part in text.split(","))
    except ValueError:
        raise click.BadParameter(
            f"{text!r} names a scope that is not one of {', '.join(Scope)}"
        ) from None


def _moment(text: str) -> datetime:
    """Read days from now such as 90d, or a time; without a time zone it is UTC."""
    try:
        if days := _DAYS.fullmatch(text):
            return datetime.now(UTC) + timedelta(days=int(days[1]))
        time = datetime.fromisoformat(text)
        return time.astimezone(UTC) if time.tzinfo else time.replace(tzinfo=UTC)
    except (ValueError, OverflowError):
        raise click.BadParameter(
            f"{text!r} is neither days such as 90d nor an ISO 8601 time"
        ) from None


@click.group()
def keys() -> None:
    """Create, list and revoke the keys of a service."""


@keys.command(epilog=example("keys create --owner lab --scopes read,write --expires 90d"))
@click.option("--owner", required=True, help="Whose store it opens; 'local': the folder's own.")
@click.option(
    "--scopes",
    required=True,
    type=_scopes,
    metavar="SCOPES",
    help=f"Of {', '.join(Scope)}, separated by commas; none includes another.",
)
@click.option(
    "--expires",
    type=_moment,
    metavar="EXPIRY",
    help="Such as 90d or 2030-12-31 (UTC); never if absent.",
)
@click.option("--note", default="", help="Its purpose; at most 200 characters.")
@json_option
@DATA_DIR
def create(
    owner: str,
    scopes: frozenset[Scope],
    expires: datetime | None,
    note: str,
    as_json: bool,
    data_dir: Path | None,
) -> None:
    """Create a key and show it once: only its hash is stored."""
    folder = folder_of(data_dir)
    is_first = not (folder / KEYS).is_file()
    with KeyRing(folder) as ring, AuditLog(folder) as log:
        made = ring.create(owner, scopes, note=note, expires=expires)
        key, token = note_key(made, ring, log)
    click.echo(aligned([_HEAD, _row(key)]), err=True)
    if is_first:
        # In a wrong folder it would open nothing, and nobody would know why.
        click.echo(f"It is the first key of {folder.absolute()}.", err=True)
    tell({"token": token, **_told(key)}, [token], as_json=as_json)


@keys.command("list", epilog=example("keys list --json"))
@json_option
@DATA_DIR
def list_keys(as_json: bool, data_dir: Path | None) -> None:
    """List all keys ever created, with their scopes."""
    with KeyRing(folder_with(data_dir, KEYS, "are no keys")) as ring:
        known = list(ring.all())
    tell_rows(_HEAD, map(_row, known), list(map(_told, known)), as_json=as_json)


@keys.command(epilog=example("keys revoke ID"))
@click.argument("key_id", metavar="ID")
@json_option
@DATA_DIR
def revoke(key_id: str, as_json: bool, data_dir: Path | None) -> None:
    """Revoke the key with that ID, at once and for good."""
    key = take_back_key(folder_with(data_dir, KEYS, "are no keys"), key_id)
    tell(_told(key), [aligned([_HEAD, _row(key)])], as_json=as_json)


def _told(key: Key) -> dict[str, object]:
    return asdict(key) | {"scopes": sorted(key.scopes), "state": key.state}


def _row(key: Key) -> tuple[str, ...]:
    scopes = ",".join(sorted(key.scopes))
    return (key.id, key.state, key.owner, scopes, key.created, key.expires or "-", key.note)
