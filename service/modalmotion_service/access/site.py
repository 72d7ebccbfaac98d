"""Requests without a key come from this machine, and from no page of another site.

A browser on this machine reaches the service too. A page of another site could have it ask, or
point a name of its own at this machine (DNS rebinding); the names in its headers give both away.
"""

from __future__ import annotations

import ipaddress
import re

from starlette.datastructures import Headers
from starlette.types import Scope as Connection

from modalmotion_service.errors import ForbiddenError

_AUTHORITY = re.compile(r"(\[[0-9A-Fa-f:.]+\]|[^:\[\]/@\s]+)(?::\d{1,5})?")


def is_loopback(host: str) -> bool:
    """Return whether an address can be reached from this machine only."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def comes_by_loopback(connection: Connection) -> bool:
    """Return whether a connection ends at a loopback address, or at none, as within a process."""
    server = connection.get("server")
    if server is None or server[1] is None:
        return True
    try:
        return ipaddress.ip_address(server[0]).is_loopback
    except ValueError:
        return True


def require_same_site(connection: Connection) -> None:
    """Refuse what a page of another site sends.

    Raises
    ------
    ForbiddenError
        If a header names another site.
    """
    headers = Headers(scope=connection)
    server = connection.get("server")
    host = headers.get("host", "")
    name = _name(host)
    if name is None or not (is_loopback(name) or (server is not None and name == server[0])):
        raise _foreign(f"The request is for {host[:80]!r}, which is not this machine.")
    origin = headers.get("origin")
    # A page of a file, or of none, has no host that could be this one: "file://", "null".
    if origin is not None and origin not in (f"http://{host}", f"https://{host}"):
        raise _foreign("The request comes from a page of another site.")
    if headers.get("sec-fetch-site", "none") not in ("none", "same-origin"):
        raise _foreign("The request comes from a page of another site.")


def _name(authority: str) -> str | None:
    match = _AUTHORITY.fullmatch(authority)
    return None if match is None else match[1].strip("[]").lower()


def _foreign(message: str) -> ForbiddenError:
    return ForbiddenError(
        message,
        remedy="Without a key, ask 127.0.0.1 or localhost, from this machine; elsewhere set "
        "MODALMOTION_REQUIRE_KEYS and send a key.",
    )
