"""Cursors: where a page of a list ended, in a text that says nothing else."""

from __future__ import annotations

import base64
import binascii
from datetime import UTC, datetime
from typing import Final

from modalmotion.errors import ParameterError

LARGEST_PAGE: Final = 1000


def now() -> str:
    """Time in UTC as ISO 8601 with microseconds, which sorts as text."""
    return to_text(datetime.now(UTC).timestamp())


def to_text(seconds: float) -> str:
    """Write a time in s since 1970 as `now` does."""
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")


def to_cursor(created: str, row_id: str) -> str:
    """Cursor behind a row."""
    return base64.urlsafe_b64encode(f"{created} {row_id}".encode()).decode().rstrip("=")


def from_cursor(cursor: str | None) -> tuple[str, str]:
    """Time and id of the row that a page ended with; behind every row for the first page.

    Raises
    ------
    ParameterError
        If no list gave this cursor.
    """
    if cursor is None:
        return "~", ""
    try:
        padded = cursor.encode("ascii") + b"=" * (-len(cursor) % 4)
        created, row_id = base64.b64decode(padded, altchars=b"-_", validate=True).decode().split()
    except (binascii.Error, ValueError):
        raise ParameterError(
            f"{cursor[:40]!r} is not a cursor.",
            remedy="Use the cursor of the page before, unchanged, or none for the first page.",
        ) from None
    return created, row_id


def require_limit(limit: int) -> int:
    """Check the length of a page.

    Raises
    ------
    ParameterError
        If it is not between 1 and 1000.
    """
    if not 1 <= limit <= LARGEST_PAGE:
        raise ParameterError(
            f"A page of {limit} was asked for; one has 1 to {LARGEST_PAGE}.",
            remedy=f"Ask for 1 to {LARGEST_PAGE}, and for further pages by cursor.",
            details={"limit": limit, "largest": LARGEST_PAGE},
        )
    return limit
