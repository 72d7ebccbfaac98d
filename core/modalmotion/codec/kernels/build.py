"""Compile the kernels of the codec. This needs numba; running them does not."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

from modalmotion.codec.machine.image import file_name, forget
from modalmotion.numeric.machine import building


def compile_kernels(folder: Path | None = None) -> Path:
    """Compile, and keep the image.

    Parameters
    ----------
    folder : Path, optional
        Where; by default the first of `folders` that can be written to.

    Returns
    -------
    Path
        Of the image, which is not made again if it is there.

    Raises
    ------
    ParameterError
        If this machine is not served, or no folder can be written to.
    MissingExtraError
        If numba is not installed.
    """
    path = building.keep_image(file_name(), _entries, folder)
    forget()
    return path


def make_image() -> bytes:
    """Compile all kernels and link them."""
    return building.make_image(_entries)


def _entries() -> building.Entries:
    """Entries, each with addresses of its memory, words, bits and tables."""
    return dict.fromkeys(import_module("modalmotion.codec.kernels.entries").ENTRIES, "LUBD")
