"""The form in which numbers travel to the viewer: a header and aligned arrays.

::

    8 bytes      b"MMVIEW1" and a line feed
    4 bytes      length of the header, little-endian
    header       JSON, padded with spaces; its "arrays" name dtype, shape and place of each
    arrays       raw, little-endian, each at a multiple of 8 bytes from the start

A browser reads an array in place, without a copy: hence the alignment.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import MalformedFileError

MAGIC: Final = b"MMVIEW1\n"
_ALIGNMENT: Final = 8
_LENGTH: Final = 4
_TYPES: Final = ("<f8", "<f4", "<f2", "<u4", "<u2", "|u1")


def write_container(header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """Write a header and arrays.

    Parameters
    ----------
    header : mapping
        Ready for JSON; it has no "arrays" of its own.
    arrays : mapping of str to array
        float64, float32, float16, uint32, uint16 or uint8.
    """
    pieces, table, place = [], {}, 0
    for name, array in arrays.items():
        plain = np.ascontiguousarray(array)
        plain = plain.astype(plain.dtype.newbyteorder("<"), copy=False)
        if plain.dtype.str not in _TYPES:
            raise TypeError(f"{name} is {plain.dtype}, which the viewer does not read")
        table[name] = {"dtype": plain.dtype.str, "shape": list(array.shape), "place": place}
        padded = -(-plain.nbytes // _ALIGNMENT) * _ALIGNMENT
        pieces.append(plain.tobytes().ljust(padded, b"\0"))
        place += padded
    text = json.dumps({**header, "arrays": table}, separators=(",", ":"), allow_nan=False).encode()
    before = len(MAGIC) + _LENGTH
    text = text.ljust(-(-(before + len(text)) // _ALIGNMENT) * _ALIGNMENT - before)
    return b"".join([MAGIC, len(text).to_bytes(_LENGTH, "little"), text, *pieces])


def read_container(data: bytes) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Read a header and its arrays, as the viewer does.

    Raises
    ------
    MalformedFileError
        If the bytes are something else, or cut.
    """
    before = len(MAGIC) + _LENGTH
    try:
        start = before + int.from_bytes(data[len(MAGIC) : before], "little")
        header = json.loads(data[before:start] if data.startswith(MAGIC) else b"")
        arrays = {}
        for name, entry in header.pop("arrays").items():
            count = int(np.prod(entry["shape"], dtype=np.int64))
            flat = np.frombuffer(data, entry["dtype"], count, start + entry["place"])
            arrays[name] = flat.reshape(entry["shape"])
    except (ValueError, KeyError, TypeError) as error:
        raise MalformedFileError(
            "The bytes are not what a viewer reads.",
            remedy="Use what `view_payload` or GET /v1/sequences/{id}/view gives.",
        ) from error
    return header, arrays
