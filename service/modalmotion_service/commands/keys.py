"""Commands for keys; a running server notices at once."""

from __future__ import annotations

from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import Any, Final

import click

from modalmotion.cli.options import aligned, example, json_option, tell
from modalmotion_service.access.keys import Key, KeyRing
from modalmotion_service.access.scopes import Scope
from modalmotion_service.audit.log import make_key, take_back_key
from modalmotion_service.commands.options import DATA_DIR, Moment, folder_of, tell_rows

_HEAD: Final = ("key", "state", "owner", "scopes", "made", "until", "note")


class _Scopes(click.ParamType[frozenset[Scope]]):
    name = "scopes"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> frozenset[Scope]:
        try:
            return frozenset(Scope(part.strip()) for part in str(value).split(","))
        except ValueError:
            known = ", ".join(Scope)
            self.fail(f"{value!r} names a scope that is not one of {known}", param, ctx)


@click.group()
def keys() -> None:
    """Make, list and take back the keys that open a service."""


@keys.command(epilog=example("keys create --owner lab --scopes read,write --expires 90d"))
@click.option("--owner", required=True, help="Whose store it opens; 'local': the folder's own.")
@click.option(
    "--scopes",
    required=True,
    type=_Scopes(),
    help=f"Of {', '.join(Scope)}, separated by commas; none includes another.",
)
@click.option(
    "--expires", type=Moment("expiry", 1), help="Such as 90d or 2030-12-31 (UTC); never if absent."
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
    """Make a key and show it, this once: only its hash is stored."""
    folder = folder_of(data_dir)
    is_first = not _keys_of(folder).is_file()
    key, token = make_key(folder, owner, scopes, note=note, expires=expires)
    click.echo(aligned([_HEAD, _row(key)]), err=True)
    if is_first:
        # In a wrong folder it would open nothing, and nobody would know why.
        click.echo(f"It is the first key of {folder.absolute()}.", err=True)
    tell({"token": token, **_told(key)}, [token], as_json=as_json)


@keys.command("list", epilog=example("keys list --json"))
@json_option
@DATA_DIR
def list_keys(as_json: bool, data_dir: Path | None) -> None:
    """List all keys that were ever made, with their scopes."""
    with KeyRing(_folder_with_keys(data_dir)) as ring:
        known = list(ring.all())
    tell_rows(_HEAD, map(_row, known), list(map(_told, known)), as_json=as_json)


@keys.command(epilog=example("keys revoke ID"))
@click.argument("key_id", metavar="ID")
@json_option
@DATA_DIR
def revoke(key_id: str, as_json: bool, data_dir: Path | None) -> None:
    """Take the key with that ID back, at once and for good."""
    key = take_back_key(_folder_with_keys(data_dir), key_id)
    tell(_told(key), [aligned([_HEAD, _row(key)])], as_json=as_json)


def _told(key: Key) -> dict[str, object]:
    return asdict(key) | {"scopes": sorted(key.scopes), "state": key.state}


def _row(key: Key) -> tuple[str, ...]:
    scopes = ",".join(sorted(key.scopes))
    return (key.id, key.state, key.owner, scopes, key.created, key.expires or "-", key.note)


def _keys_of(folder: Path) -> Path:
    return folder / "access" / "keys.sqlite"


def _folder_with_keys(data_dir: Path | None) -> Path:
    folder = folder_of(data_dir)
    if not _keys_of(folder).is_file():
        raise click.ClickException(
            f"There are no keys in {folder.absolute()}. Name the service's data folder with "
            "--data-dir or MODALMOTION_DATA_DIR."
        )
    return folder
