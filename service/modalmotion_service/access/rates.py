"""Rates of requests, and requests without a key: from this machine, and no page of another site.

A browser on this machine reaches the service too. A page of another site could have it ask, or
point a name of its own at this machine (DNS rebinding); the names in its headers give both away.
"""

import ipaddress
import math
import re
import time
from collections import deque
from collections.abc import Callable
from typing import Final

from starlette.datastructures import Headers
from starlette.types import Scope as Connection

from modalmotion_service.errors import ForbiddenError, RateLimitedError

_WINDOW_SECONDS: Final = 60.0


class Rates:
    """Counts requests over the last minute, in memory, on the thread of the event loop.

    Clients silent for a minute are forgotten: strangers have as many addresses as they like.

    Parameters
    ----------
    of_key, of_address, of_failures : int
        Most requests a minute: with one key, from one address without a key to what is open to
        everybody, and from one address with no key or a wrong one where one is needed.
    now : function
        Seconds of a clock that never goes back.
    is_replica : bool
        Whether other services answer the same clients, and count for themselves.
    """

    def __init__(
        self,
        of_key: int,
        of_address: int,
        of_failures: int,
        now: Callable[[], float] = time.monotonic,
        *,
        is_replica: bool = False,
    ) -> None:
        self._details = {"counted_by": "replica"} if is_replica else {}
        self._most = {
            "requests_per_minute": of_key,
            "anonymous_per_minute": of_address,
            "failures_per_minute": of_failures,
        }
        self._now = now
        # Times of the requests that were let through, the oldest first.
        self._seen: dict[tuple[str, str], deque[float]] = {}
        self._sweep_at = now() + _WINDOW_SECONDS

    def __len__(self) -> int:
        """Give how many keys and addresses are remembered."""
        return len(self._seen)

    def key(self, key_id: str) -> dict[str, str]:
        """Count a request with a key; gives headers that say how many may follow, and when.

        Raises
        ------
        RateLimitedError
            If it is one too many, as the two others do.
        """
        return self._count("requests_per_minute", key_id)

    def address(self, client: str) -> dict[str, str]:
        """Count a request without a key to what is open to everybody."""
        return self._count("anonymous_per_minute", _network(client))

    def failure(self, client: str) -> dict[str, str]:
        """Count a request without the key that it needs."""
        return self._count("failures_per_minute", _network(client))

    def _count(self, limit: str, who: str) -> dict[str, str]:
        now, most = self._now(), self._most[limit]
        if now >= self._sweep_at:
            self._sweep(now)
        seen = self._seen.setdefault((limit, who), deque())
        while seen and seen[0] <= now - _WINDOW_SECONDS:
            seen.popleft()
        has_room = len(seen) < most
        if has_room:
            seen.append(now)
        wait = max(1, math.ceil(seen[0] + _WINDOW_SECONDS - now))
        if has_room:
            left = most - len(seen)
            counts = {"Limit": most, "Remaining": left, "Reset": wait}
            return {f"RateLimit-{name}": str(number) for name, number in counts.items()}
        raise RateLimitedError(
            f"{most} requests came within a minute, as many as may.",
            remedy=f"Wait {wait} s and send it again; ask for many signatures in one request.",
            limit=limit,
            details={"most": most, "retry_after_seconds": wait, **self._details},
        )

    def _sweep(self, now: float) -> None:
        # Once a minute: each is looked at once for every request that it made, or less.
        self._sweep_at = now + _WINDOW_SECONDS
        self._seen = {
            who: seen for who, seen in self._seen.items() if seen[-1] > now - _WINDOW_SECONDS
        }


def _network(client: str) -> str:
    """Name what one client has: an IPv4 address, or the 2^64 of an IPv6 network."""
    try:
        address = ipaddress.ip_address(client)
    except ValueError:
        return client
    if address.version == 4:
        return client
    return str(ipaddress.ip_network((int(address), 64), strict=False))


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
