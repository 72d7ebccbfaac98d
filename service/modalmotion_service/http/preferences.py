"""The Prefer header (RFC 7240): whether a client would rather not wait."""

from __future__ import annotations

import re
from dataclasses import dataclass

_WAIT = re.compile(r"wait\s*=\s*\"?(\d{1,6})\"?")


@dataclass(frozen=True)
class Preference:
    """How long a client wants to wait for an answer.

    Parameters
    ----------
    is_async : bool
        It wants a job at once.
    wait_seconds : float or None
        It wants an answer or a job after so long; None where it does not say.
    """

    is_async: bool
    wait_seconds: float | None


def parse_preference(header: str) -> Preference:
    """Read a Prefer header; unknown parts are ignored, as the standard requires."""
    is_async, wait = False, None
    for part in re.split("[,;]", header.lower()):
        word = part.strip()
        if word == "respond-async":
            is_async = True
        elif (match := _WAIT.fullmatch(word)) is not None:
            wait = float(match[1])
    return Preference(is_async, wait)
