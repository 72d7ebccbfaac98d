"""Tensors of the open inference protocol (KServe v2): JSON, and binary ones behind it."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator, Mapping, Sequence
from typing import Any, Final

import numpy as np

from modalmotion.errors import LimitError, MalformedFileError

HEADER: Final = "Inference-Header-Content-Length"
"""Header that says how many bytes of a body are JSON; binary tensors follow."""

MOST_JSON: Final = 256_000
"""Bytes of JSON: a file is sent as a binary tensor."""

# Before each element of a binary tensor of bytes: how long it is.
_PREFIX: Final = 4
_LENGTH: Final = "little"


def head_length(stated: str | None) -> int | None:
    """Read the header that says how many bytes are JSON; None where all are.

    Raises
    ------
    MalformedFileError
        If it is no number.
    LimitError
        If it is more than `MOST_JSON`.
    """
    if stated is None:
        return None
    if not (stated.isascii() and stated.isdigit() and len(stated) < 20):
        raise MalformedFileError(
            f"The header {HEADER} is {stated[:40]!r}, and no number.",
            remedy="State the number of bytes of JSON before the binary tensor.",
        )
    length = int(stated)
    _require_small(length)
    return length


async def split_head(pieces: AsyncIterator[bytes], length: int | None) -> tuple[bytes, bytes]:
    """Read the JSON of a body, and what came with its last piece.

    Parameters
    ----------
    pieces : async iterator of bytes
        Read as far as the JSON goes.
    length : int or None
        Of the JSON; None where it is the whole body.

    Raises
    ------
    MalformedFileError
        If the body is shorter.
    LimitError
        If it is more than `MOST_JSON`.
    """
    read = bytearray()
    async for piece in pieces:
        read += piece
        if length is None:
            _require_small(len(read))
        elif len(read) >= length:
            return bytes(read[:length]), bytes(read[length:])
    if length is not None and len(read) < length:
        raise MalformedFileError(
            f"The body has {len(read)} bytes, fewer than the {length} of its JSON.",
            remedy=f"State in {HEADER} how many bytes are JSON.",
        )
    return bytes(read), b""


async def element(first: bytes, rest: AsyncIterator[bytes], size: int) -> AsyncIterator[bytes]:
    """Yield the one element of a binary tensor of bytes, piece by piece.

    Parameters
    ----------
    first : bytes
        Beginning of the tensor.
    rest : async iterator of bytes
        What follows.
    size : int
        Bytes of the tensor: four that say how long the element is, and the element.

    Raises
    ------
    MalformedFileError
        If the sizes do not agree.
    """
    prefix = bytearray()
    n_read = 0
    pieces = _joined(first, rest)
    async for piece in pieces:
        n_read += len(piece)
        body = piece
        if len(prefix) < _PREFIX:
            missing = _PREFIX - len(prefix)
            prefix += piece[:missing]
            body = piece[missing:]
            if len(prefix) == _PREFIX and int.from_bytes(prefix, _LENGTH) != size - _PREFIX:
                raise _unequal(size, f"its element {int.from_bytes(prefix, _LENGTH)}")
        if n_read > size:
            raise _unequal(size, "more follow")
        if body:
            yield body
    if n_read != size:
        raise _unequal(size, f"{n_read} came")


def tensor_bytes(values: Sequence[str] | Sequence[float], datatype: str) -> bytes:
    """Write a tensor of texts (BYTES) or of numbers (FP64) in binary."""
    if datatype == "FP64":
        return np.asarray(values, dtype="<f8").tobytes()
    texts = [str(value).encode() for value in values]
    return b"".join(len(text).to_bytes(_PREFIX, _LENGTH) + text for text in texts)


def binary_body(
    head: Mapping[str, Any], outputs: Sequence[tuple[dict[str, Any], Any, bool]]
) -> tuple[bytes, int | None]:
    """Write an answer: JSON, and binary tensors behind it.

    Parameters
    ----------
    head : mapping
    outputs : sequence of (dict, values, bool)
        Name, datatype and shape of each; its values; whether they are binary.

    Returns
    -------
    bytes, int or None
        The body, and the number of bytes that are JSON; None where all are.
    """
    said, binary = [], b""
    for about, values, is_binary in outputs:
        if is_binary:
            data = tensor_bytes(values, about["datatype"])
            binary += data
            said.append({**about, "parameters": {"binary_data_size": len(data)}})
        else:
            said.append({**about, "data": list(values)})
    text = json.dumps({**head, "outputs": said}, allow_nan=False).encode()
    return text + binary, len(text) if any(is_binary for _, _, is_binary in outputs) else None


async def _joined(first: bytes, rest: AsyncIterator[bytes]) -> AsyncIterator[bytes]:
    if first:
        yield first
    async for piece in rest:
        yield piece


def _require_small(n_bytes: int) -> None:
    if n_bytes > MOST_JSON:
        raise LimitError(
            f"The JSON of the request has {n_bytes} bytes; the limit is {MOST_JSON}.",
            remedy=f"Send the file as a binary tensor behind the JSON, with {HEADER}.",
            limit="json_bytes",
            details={"most": MOST_JSON},
        )


def _unequal(size: int, what: str) -> MalformedFileError:
    return MalformedFileError(
        f"The binary tensor is stated to have {size} bytes; {what}.",
        remedy="State 4 bytes and the file in binary_data_size; the 4 say how long the file is, "
        "little-endian.",
    )
