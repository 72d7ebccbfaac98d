"""Keys made and taken back, with their entries in the audit log."""

from __future__ import annotations

import os
from collections.abc import Collection
from datetime import datetime
from pathlib import Path

from modalmotion_service.access.keys import Key, KeyRing
from modalmotion_service.access.scopes import Scope
from modalmotion_service.audit.entry import Event
from modalmotion_service.audit.log import AuditLog, Notes


def make_key(
    data_dir: Path,
    owner: str,
    scopes: Collection[Scope],
    *,
    note: str = "",
    expires: datetime | None = None,
) -> tuple[Key, str]:
    """Make a key as `KeyRing.create` does, and note it; one that cannot be noted is taken back."""
    with KeyRing(data_dir) as ring, AuditLog(data_dir) as log:
        return note_key(ring.create(owner, scopes, note=note, expires=expires), ring, log)


def note_key(made: tuple[Key, str], ring: KeyRing, log: Notes) -> tuple[Key, str]:
    """Note a key that was just made; one that cannot be noted is taken back."""
    key, _ = made
    try:
        log.append([of_command("keys create", key.owner, key.id)])
    except BaseException:
        ring.revoke(key.id)
        raise
    return made


def take_back_key(data_dir: Path, key_id: str) -> Key:
    """Take a key back as `KeyRing.revoke` does, and note it."""
    with KeyRing(data_dir) as ring, AuditLog(data_dir) as log:
        key = ring.revoke(key_id)
        log.append([of_command("keys revoke", key.owner, key.id)])
    return key


def of_command(command: str, owner: str | None, about: str, status: int = 200) -> Event:
    """Make the entry of a command, by the user of the system who gave it."""
    return Event(
        request_id="",
        owner=owner,
        key_id=None,
        client=f"command line, uid {os.getuid()}",
        method="COMMAND",
        route=command,
        ids=about,
        status=status,
    )
