"""Which answers are files: bytes that a client keeps, and does not read as text."""

from __future__ import annotations

from typing import Final

OCTETS: Final = "application/octet-stream"
"""Media type that any file may be taken as."""


def is_file(media_type: str) -> bool:
    """Tell whether a media type is neither text nor JSON."""
    return not (media_type.startswith("text/") or media_type.endswith("json"))
