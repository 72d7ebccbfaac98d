"""Result files with something else in them, and a seal that is right."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Callable

import h5py

from modalmotion.hdf5.sealed import SEAL_LENGTH


def sealed(image: bytes) -> bytes:
    """An HDF5 image with the seal behind it."""
    return image + f"\nmodalmotion sha256 {hashlib.sha256(image).hexdigest()}\n".encode()


def changed(data: bytes, change: Callable[[h5py.File], object]) -> bytes:
    """A sealed file after a change by h5py, sealed again."""
    buffer = io.BytesIO(data[:-SEAL_LENGTH])
    with h5py.File(buffer, "r+") as file:
        change(file)
    return sealed(buffer.getvalue())


def put(name: str, value: object) -> Callable[[h5py.File], None]:
    """Change that puts a dataset in place of another, or adds it."""

    def change(file: h5py.File) -> None:
        if name in file:
            del file[name]
        file[name] = value

    return change
