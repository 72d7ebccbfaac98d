"""How many requests a minute: of one key, of one address without a key, and failed ones."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

from limits import RateLimitItemPerMinute
from limits.storage import MemoryStorage
from limits.strategies import MovingWindowRateLimiter

from modalmotion_service.errors import RateLimitedError


@dataclass(frozen=True)
class Allowance:
    """What is left of a limit.

    Parameters
    ----------
    most : int
        Requests a minute.
    remaining : int
    reset_seconds : int
        Until there is room for another one.
    """

    most: int
    remaining: int
    reset_seconds: int

    @property
    def headers(self) -> dict[str, str]:
        """As an answer tells it."""
        return {
            "RateLimit-Limit": str(self.most),
            "RateLimit-Remaining": str(self.remaining),
            "RateLimit-Reset": str(self.reset_seconds),
        }


class Rates:
    """Counts requests over the last minute, in memory.

    Parameters
    ----------
    of_key, of_address, of_failures : int
        Most requests a minute: with one key, from one address without a key to what is open to
        everybody, and from one address with no key or a wrong one where one is needed.
    """

    def __init__(self, of_key: int, of_address: int, of_failures: int) -> None:
        self._limiter = MovingWindowRateLimiter(MemoryStorage())
        self._limits = {
            "requests_per_minute": RateLimitItemPerMinute(of_key),
            "anonymous_per_minute": RateLimitItemPerMinute(of_address),
            "failures_per_minute": RateLimitItemPerMinute(of_failures),
        }

    def key(self, key_id: str) -> Allowance:
        """Count a request with a key.

        Raises
        ------
        RateLimitedError
            If it is one too many, as the two others do.
        """
        return self._count("requests_per_minute", key_id)

    def address(self, client: str) -> Allowance:
        """Count a request without a key to what is open to everybody."""
        return self._count("anonymous_per_minute", client)

    def failure(self, client: str) -> Allowance:
        """Count a request without the key that it needs."""
        return self._count("failures_per_minute", client)

    def _count(self, limit: str, who: str) -> Allowance:
        item = self._limits[limit]
        has_room = self._limiter.hit(item, limit, who)
        window = self._limiter.get_window_stats(item, limit, who)
        wait = max(1, math.ceil(window.reset_time - time.time()))
        if has_room:
            return Allowance(item.amount, window.remaining, wait)
        raise RateLimitedError(
            f"{item.amount} requests came within a minute, as many as may.",
            remedy=f"Wait {wait} s and send it again; ask for many signatures in one request.",
            limit=limit,
            details={"most": item.amount, "retry_after_seconds": wait},
        )
