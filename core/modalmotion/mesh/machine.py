"""The compiled kernels of large meshes: the name of their file, what is mapped, and calls."""

from __future__ import annotations

import threading
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.numeric.machine.building import Entries, keep_image
from modalmotion.numeric.machine.image import Image, digest_of, find_image

LARGE: Final = 50_000
"""Vertices from which on the kernels are looked for."""

_SLOWER: Final = (
    "The kernels of large meshes are not compiled; the answers are the same, later. "
    "Once: modalmotion compile-codec"
)
_lock = threading.Lock()
_mapped: list[Image | None] = []


class Kernels:
    """Calls of mapped kernels with arrays."""

    def __init__(self, image: Image) -> None:
        self._image = image

    def run(self, name: str, *given: NDArray[Any] | float) -> int:
        """Run an entry.

        Parameters
        ----------
        name : str
        given : arrays and numbers
            As the entry has them; arrays C-contiguous, of its types, and kept by the caller.
        """
        return self._image.entries[name](
            *(x.ctypes.data if isinstance(x, np.ndarray) else x for x in given)
        )


def file_name() -> str:
    """Name of the image of these sources."""
    return f"meshes-{digest_of(Path(__file__).parent, ('kernels/*.py',))}.bin"


def is_large(n_vertices: int) -> bool:
    """Whether a mesh is numbered anew, and worked on by kernels where these are there."""
    # 32 bits count the sides of the largest.
    return LARGE <= n_vertices < 2**28


def kernels_for(n_vertices: int) -> Kernels | None:
    """Give the kernels for a mesh of so many vertices, or None where the pure form answers.

    Parameters
    ----------
    n_vertices : int
        Those that are not large have none.
    """
    if not is_large(n_vertices):
        return None
    with _lock:
        if not _mapped:
            _mapped.append(find_image(file_name(), _SLOWER))
        return None if _mapped[0] is None else Kernels(_mapped[0])


def compile_kernels(folder: Path | None = None) -> Path:
    """Compile the kernels of large meshes, and keep the image: see `keep_image`."""
    path = keep_image(file_name(), _entries, folder)
    with _lock:
        _mapped.clear()
    return path


def _entries() -> Entries:
    entries: Entries = import_module("modalmotion.mesh.kernels.entries").ENTRIES
    return entries
