"""One entry of the audit log, the chain that ties it to those before, and its forms as a line."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from typing import Any, Final

BEGUN: Final = 102
"""Status of an entry that is written before something is changed; another one follows it."""

GENESIS: Final = "0" * 64
"""In place of the digest of the entry before the first one."""


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
    def line(self) -> dict[str, Any]:
        """All of it as JSON."""
        return {
            "number": self.number,
            "time": self.time,
            **asdict(self.event),
            "sha256": self.sha256,
        }

    @property
    def fhir(self) -> dict[str, Any]:
        """The same as an AuditEvent of FHIR R4."""
        event = self.event
        outcome = "0" if event.status < 400 else "4" if event.status < 500 else "8"
        agent = {"requestor": True, "network": {"address": event.client, "type": "2"}}
        if event.owner is not None:
            agent["who"] = {"identifier": {"value": event.owner}}
        if event.key_id is not None:
            agent["altId"] = event.key_id
        return {
            "resourceType": "AuditEvent",
            "id": self.sha256,
            "type": {
                "system": "http://terminology.hl7.org/CodeSystem/audit-event-type",
                "code": "rest",
            },
            "subtype": [{"display": f"{event.method} {event.route}"}],
            "action": _ACTIONS.get(event.method, "E"),
            "recorded": self.time,
            "outcome": outcome,
            "outcomeDesc": str(event.status),
            "agent": [agent],
            "source": {"observer": {"display": "modalmotion"}},
            "entity": [
                *({"what": {"identifier": {"value": one}}} for one in event.ids.split()),
                {"what": {"identifier": {"value": event.request_id}}, "name": "request"},
            ],
        }


_ACTIONS: Final = {"GET": "R", "HEAD": "R", "POST": "C", "PATCH": "U", "PUT": "U", "DELETE": "D"}


def chained(number: int, before: str, time: str, event: Event) -> AuditEntry:
    """Tie an event to the entry before.

    Parameters
    ----------
    number : int
    before : str
        Digest of the entry before.
    time : str
    event : Event
    """
    # JSON, and not the values one after another: no two events are written alike.
    text = json.dumps([before, number, time, asdict(event)], sort_keys=True)
    return AuditEntry(number, time, event, hashlib.sha256(text.encode()).hexdigest())
