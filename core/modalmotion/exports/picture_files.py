"""Pictures as files; without what draws them, which few commands need."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Final

from modalmotion.errors import ParameterError
from modalmotion.store.disk import write_atomic

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PICTURES: Final = (".png", ".svg", ".pdf")
"""Suffixes of pictures."""


def picture_bytes(figure: Figure, kind: str) -> bytes:
    """Write a picture as png, svg or pdf."""
    picture = io.BytesIO()
    figure.savefig(picture, format=kind)
    return picture.getvalue()


def write_picture(figure: Figure, path: Path) -> None:
    """Write a picture to a file, in the format of its suffix.

    Raises
    ------
    ParameterError
        If the suffix is another.
    StoreError
        If it cannot be written.
    """
    if path.suffix.lower() not in PICTURES:
        raise ParameterError(
            f"{path.name!r} does not have the suffix of a picture.",
            remedy=f"Use a name that ends with {', '.join(PICTURES)}.",
        )
    write_atomic(path, picture_bytes(figure, path.suffix[1:].lower()))
