"""One line of the audit log, and the chain that ties it to those before."""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import asdict, dataclass
from typing import Final

BEGUN: Final = 102
"""Status of an entry that is written before something is changed; another one follows it."""


@dataclass(frozen=True)
class Place:
    """An entry's number and digest: noted elsewhere, they show later that nothing before is gone.

    Parameters
    ----------
    number : int
    sha256 : str
    """

    number: int
    sha256: str

    def __str__(self) -> str:
        return f"{self.number}:{self.sha256}"


def place_from(text: str) -> Place:
    """Read a place as it is printed.

    Raises
    ------
    ValueError
        If it is not one.
    """
    match = re.fullmatch(r"([0-9]{1,18}):([0-9a-f]{64})", text)
    if match is None:
        raise ValueError(f"{text[:100]!r} is not NUMBER:SHA256")
    return Place(int(match[1]), match[2])


GENESIS: Final = Place(0, "0" * 64)
"""Placeholder for the entry before the first one."""


@dataclass(frozen=True)
class Event:
    """Who requested what.

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
        Ids that it concerned, separated by blanks.
    status : int
        Of the answer, or `BEGUN`.
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

    @property
    def place(self) -> Place:
        """Where it stands."""
        return Place(self.number, self.sha256)


def chained(previous: Place, time: str, event: Event) -> AuditEntry:
    """Tie an event to the entry before.

    Parameters
    ----------
    previous : Place
    time : str
    event : Event
    """
    number = previous.number + 1
    # JSON, and not the values one after another: no two events are written alike.
    text = json.dumps([previous.sha256, number, time, asdict(event)], sort_keys=True)
    return AuditEntry(number, time, event, hashlib.sha256(text.encode()).hexdigest())
