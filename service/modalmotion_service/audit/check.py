"""Whether the audit log is whole: every file, and each beginning where the one before ends."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from modalmotion_service.audit.entry import BEGUN, GENESIS, AuditEntry, Place, chained
from modalmotion_service.audit.log import first_number
from modalmotion_service.audit.part import AuditPart


@dataclass(frozen=True)
class AuditReport:
    """Result of a check of the log.

    Parameters
    ----------
    start : Place
        Of the entry before the first one present.
    end : Place
        Of the last entry.
    faults : tuple of str
    """

    start: Place
    end: Place
    faults: tuple[str, ...]

    @property
    def n_entries(self) -> int:
        """From the first to the last."""
        return self.end.number - self.start.number


def check_audit(
    parts: Sequence[AuditPart], noted: Place | None = None, heads: Iterable[Place] = ()
) -> AuditReport:
    """Check the whole chain.

    Parameters
    ----------
    parts : sequence of AuditPart
        In order.
    noted : Place, optional
        As an earlier check gave it: nothing up to there may be gone but what was archived.
    heads : iterable of Place
        Noted while the log was written: each entry that is here must be the one that was noted,
        and the log must reach as far.

    Raises
    ------
    CorruptFileError, StoreError
        If a file cannot be read.
    """
    faults: list[str] = []
    digests: dict[int, set[str]] = {}
    for head in heads:
        digests.setdefault(head.number, set()).add(head.sha256)
    first = parts[0].start() if parts else GENESIS
    place = first
    # A digest holds all entries before its own: one that was noted, here or at the beginning,
    # vouches for files that lie elsewhere.
    is_noted = noted in (None, GENESIS, first)
    for part in parts:
        start = part.start()
        if start != place or first_number(part) != start.number + 1:
            faults.append(
                f"{part.path.name} follows entry {start.number}, and not entry "
                f"{place.number} as it is here"
            )
        place = start
        for entry in part.entries():
            if entry.number != place.number + 1:
                faults.append(f"entries {place.number + 1} to {entry.number - 1} are missing")
            before = Place(entry.number - 1, place.sha256)
            if entry != chained(before, entry.time, entry.event):
                faults.append(f"entry {entry.number} is not what was written, or follows another")
            place = entry.place
            is_noted = is_noted or place == noted
            if digests.get(place.number, {place.sha256}) != {place.sha256}:
                faults.append(f"entry {place.number} is not the one that was noted")
    if max(digests, default=0) > place.number:
        faults.append(
            f"the log ends with entry {place.number}, and entry {max(digests)} was noted: "
            "its end is gone"
        )
    if noted is not None and not is_noted:
        faults.append(f"entry {noted.number} with the digest that was noted is not there")
    elif first != GENESIS and (noted is None or noted.number < first.number):
        faults.append(
            f"entries 1 to {first.number} are not here: name the folder that they were archived "
            "in, or what was noted when they were"
        )
    return AuditReport(first, place, tuple(faults))


def unfinished(entries: Iterable[AuditEntry]) -> Iterator[AuditEntry]:
    """Pick the changes that were begun and have no end: under way, or cut off by a crash.

    Parameters
    ----------
    entries : iterable of AuditEntry
        In order.
    """
    begun: dict[tuple[str | None, ...], list[AuditEntry]] = {}
    for entry in entries:
        event = entry.event
        # A client may give one request id to several requests.
        same = begun.setdefault((event.request_id, event.key_id, event.method, event.route), [])
        if event.status == BEGUN:
            same.append(entry)
        elif same:
            same.pop(0)
        if not same:
            del begun[event.request_id, event.key_id, event.method, event.route]
    yield from sorted((one for same in begun.values() for one in same), key=lambda one: one.number)
