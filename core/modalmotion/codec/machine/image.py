"""The compiled codec: the name of its file, and what is mapped of it."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Final

from modalmotion.numeric.machine.image import Image as Image
from modalmotion.numeric.machine.image import digest_of, find_image

_CODEC: Final = Path(__file__).parents[1]
# What the code is made from: the kernels, and the modules whose constants they share.
_SOURCES: Final = (
    "kernels/*.py",
    "machine/layout.py",
    "machine/places.py",
    "bits/entropy.py",
    "bits/matrix.py",
    "bits/mix*.py",
    "connectivity/numbering.py",
    "connectivity/rings.py",
    "connectivity/walk.py",
)
_SLOWER: Final = "The codec is not compiled, and slow. Once: modalmotion compile-codec"

_lock = threading.Lock()
_mapped: list[Image | None] = []


def file_name() -> str:
    """Name of the image of these sources."""
    return f"kernels-{digest_of(_CODEC, _SOURCES)}.bin"


def image() -> Image | None:
    """Give the mapped kernels, or None where the pure form answers.

    The reason for None is logged once.
    """
    with _lock:
        if not _mapped:
            _mapped.append(find_image(file_name(), _SLOWER))
        return _mapped[0]


def forget() -> None:
    """Look again at the next call, as after compiling."""
    with _lock:
        _mapped.clear()
