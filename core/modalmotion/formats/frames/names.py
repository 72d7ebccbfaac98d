"""Names of frames: their natural order, and names that stay inside their archive."""

from __future__ import annotations

import posixpath
import re
from typing import Final

from modalmotion.errors import MalformedFileError

FRAME_SUFFIXES: Final = (".stl", ".ply", ".obj", ".off", ".vtk", ".vtp", ".vtu")
"""Ends of the names of files that contain one frame each."""

SERIES_SUFFIXES: Final = (".pvd", ".series")
"""Ends of the names of files that list frames and their times."""

# Separators and drives of other systems, and control characters.
_UNSAFE: Final = re.compile(r"[\\:\x00-\x1f]")


def natural_key(name: str) -> tuple[tuple[str, int, str], ...]:
    """Sort key by which frame_2 comes before frame_10, and equal numbers by their writing."""
    # (text, digits, number) each; a number counts by its length first, however long it is.
    parts = [(text, number.lstrip("0")) for text, number in re.findall(r"(\D*)(\d*)", name)]
    return (*((text.casefold(), len(number), number) for text, number in parts), (name, 0, ""))


def require_safe_name(name: str) -> None:
    """Refuse a name that leads out of the archive it is in.

    Raises
    ------
    MalformedFileError
        If it is absolute, goes up, names a drive, or contains control characters.
    """
    if name.startswith("/") or ".." in name.split("/") or _UNSAFE.search(name):
        raise MalformedFileError(
            f"The name {name[:80]!r} leads out of the archive.",
            remedy="Pack the frames with plain relative names.",
            details={"name": name[:80]},
        )


def is_hidden(name: str) -> bool:
    """Return whether a name is one that systems leave behind, such as .DS_Store."""
    return any(part.startswith((".", "__MACOSX")) for part in name.split("/"))


def name_beside(series: str, name: str) -> str:
    """Resolve a name in a series file against that file's folder."""
    require_safe_name(name)
    return posixpath.normpath(posixpath.join(posixpath.dirname(series), name))
