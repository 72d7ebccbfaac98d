"""One line of the audit log, and the chain that ties it to those before."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from typing import Final

GENESIS: Final = "0" * 64
"""What stands in the first entry for the digest of the one before."""


@dataclass(frozen=True)
class Event:
    """Who asked for what.

    Parameters
    ----------
    request_id : str
    owner, key_id : str or None
        None where nobody was recognised; the key is None for this machine without keys.
    client : str
        Address.
    method, route : str
        The route by its template.
    ids : str
        What it was about, separated by blanks.
    status : int
        Of the answer.
    """

    request_id: str
    owner: str | None
    key_id: str | None
    client: str
    method: str
    route: str
    ids: str
    status: int


@dataclass(frozen=True)
class AuditEntry:
    """An event as it stands in the log.

    Parameters
    ----------
    number : int
        Counted from 1, without gaps.
    time : str
        UTC, ISO 8601 with microseconds.
    event : Event
    sha256 : str
        Of this entry and of the digest of the one before.
    """

    number: int
    time: str
    event: Event
    sha256: str


def chained(previous: str, number: int, time: str, event: Event) -> AuditEntry:
    """Tie an event to the entry before.

    Parameters
    ----------
    previous : str
        The digest of that entry.
    number : int
    time : str
    event : Event
    """
    # JSON, and not the values one after another: no two events are written alike.
    text = json.dumps([previous, number, time, asdict(event)], sort_keys=True)
    return AuditEntry(number, time, event, hashlib.sha256(text.encode()).hexdigest())
