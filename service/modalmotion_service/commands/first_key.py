"""The first key: read or made when a service that others can reach starts without any."""

from __future__ import annotations

from pathlib import Path

import click

from modalmotion.errors import ParameterError
from modalmotion_service.access.keys import KeyRing, parts_of
from modalmotion_service.access.principal import LOCAL
from modalmotion_service.access.scopes import Scope
from modalmotion_service.access.site import is_loopback
from modalmotion_service.audit.key_events import note_key
from modalmotion_service.audit.log import Notes
from modalmotion_service.settings import Settings


def secured(settings: Settings, host: str) -> Settings:
    """Demand keys where the address to listen on can be reached from other machines."""
    if is_loopback(host):
        return settings
    return settings.model_copy(update={"require_keys": True})


def offer_first_key(settings: Settings, ring: KeyRing, log: Notes) -> None:
    """Make a key with every scope where keys are needed and none was ever made.

    It is shown, unless it was read from a file that the settings name. Keys and audit log are those
    that the process has open: a file that it opened and closed once more would lose SQLite's locks.

    Raises
    ------
    ParameterError
        As of `stated_key`.
    """
    if not settings.require_keys or ring.all():
        return
    stated = stated_key(settings.first_key_file)
    made = ring.create(LOCAL, frozenset(Scope), note="first key", token=stated)
    key, token = note_key(made, ring, log)
    if stated:
        return
    # To standard output, apart from the log, which goes to standard error.
    click.echo(
        "\n  This service needs keys, and there was none. The first one, with every scope;\n"
        "  it is shown this once and kept as a hash only:\n\n"
        f"      {token}\n\n"
        f"  Make others with `modalmotion keys create`; take it back with "
        f"`modalmotion keys revoke {key.id}`.\n"
    )


def stated_key(file: Path | None) -> str:
    """Read a key from a file's first line; empty where no file is named.

    Raises
    ------
    ParameterError
        If the file cannot be read, or begins with no key.
    """
    if file is None:
        return ""
    try:
        # A little more than a key: whatever else the file has stays unread.
        with file.open(encoding="ascii") as text:
            stated = text.readline(200).strip()
        parts_of(stated)
    except (OSError, ValueError, ParameterError) as error:
        raise ParameterError(
            f"MODALMOTION_FIRST_KEY_FILE names {str(file)!r}, which has no key: {error}.",
            remedy="Mount the secret there, readable by the service's user. "
            + getattr(error, "remedy", ""),
        ) from None
    return stated
