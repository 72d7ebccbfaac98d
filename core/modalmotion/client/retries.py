"""When to send a request again, and how long to wait before."""

from __future__ import annotations

import email.utils
import time
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from modalmotion.errors import ParameterError
from modalmotion.representation import shown

# The service is busy or restarting, or a proxy lost it.
_PASSING: Final = frozenset({408, 425, 429, 502, 503, 504})


@shown("attempts", "first_wait", "longest_wait", "deadline")
@dataclass(frozen=True)
class Retries:
    """How often a request is sent again, and after how long.

    Only requests that may be repeated are: those that change nothing, that leave the same
    state however often they come, or that carry an idempotency key.

    Parameters
    ----------
    attempts : int
        How often a request is sent at most; 1 never sends one again.
    first_wait, longest_wait : float, s
        Before the second attempt, doubled before each further one up to the longest. The
        service may ask for more (Retry-After).
    deadline : float, s
        For a call with all its attempts; no wait extends beyond it.
    rng : numpy.random.Generator
        Spreads the waits, so that clients that failed together do not come back together.

    Notes
    -----
    Brooker, Exponential backoff and jitter, AWS Architecture Blog, 2015.
    """

    attempts: int = 5
    first_wait: float = 0.2
    longest_wait: float = 20.0
    deadline: float = 600.0
    rng: np.random.Generator = field(default_factory=np.random.default_rng, compare=False)

    def __post_init__(self) -> None:
        if self.attempts < 1 or not 0 <= self.first_wait <= self.longest_wait:
            raise ParameterError(
                f"{self.attempts} attempts with waits of {self.first_wait} to "
                f"{self.longest_wait} s do not make a schedule of retries.",
                remedy="Use at least one attempt, and a first wait not above the longest.",
            )

    def wait(self, attempt: int, requested: float | None = None) -> float:
        """Seconds to wait after an attempt has failed.

        Parameters
        ----------
        attempt : int
            Counted from 0.
        requested : float, s, optional
            Wait that the service requested.
        """
        longest = min(self.longest_wait, self.first_wait * 2.0**attempt)
        own = float(self.rng.uniform(0.5, 1.0)) * longest
        return own if requested is None else requested + 0.1 * own


def is_passing(status: int) -> bool:
    """Return whether the same request may succeed later."""
    return status in _PASSING


def retry_after(header: str | None) -> float | None:
    """Read a Retry-After header (RFC 9110, 10.2.3): seconds, or a date.

    Returns
    -------
    float, s, or None
        None if absent or not readable.
    """
    if header is None:
        return None
    text = header.strip()
    if text.isascii() and text.isdigit() and len(text) < 10:
        return float(text)
    try:
        end = email.utils.parsedate_to_datetime(text).timestamp()
    except (TypeError, ValueError, OverflowError):
        return None
    return max(0.0, end - time.time())
