"""A part of a file that was sent: one of many sequences."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from modalmotion.facts import NO_FACTS, Facts, facts_as_json, facts_from_json


@dataclass(frozen=True)
class Part:
    """One file of many that lie in one, one after the other.

    Parameters
    ----------
    name : str
        As the sender calls it.
    start, length : int, bytes
    subject, label : str or None
    facts : Facts
    """

    name: str
    start: int
    length: int
    subject: str | None = None
    label: str | None = None
    facts: Facts = NO_FACTS


def parts_as_json(parts: Iterable[Part]) -> list[dict[str, Any]]:
    """Write parts as a job remembers them."""
    return [{**vars(part), "facts": facts_as_json(part.facts)} for part in parts]


def parts_from_json(values: Iterable[Mapping[str, Any]]) -> tuple[Part, ...]:
    """Read what `parts_as_json` gave."""
    return tuple(Part(**{**one, "facts": facts_from_json(one["facts"])}) for one in values)
