"""What a file of images is read to: samples over time, and where they lie."""

from __future__ import annotations

import logging
import struct
import warnings
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import LimitError, MalformedFileError
from modalmotion.formats.parser.answer import Parsed
from modalmotion.limits import ReadLimits

BROKEN: Final = (
    *(
        ValueError,
        TypeError,
        KeyError,
        IndexError,
        OSError,
        EOFError,
        OverflowError,
        ArithmeticError,
    ),
    *(AttributeError, AssertionError, NotImplementedError, MemoryError, RecursionError, zlib.error),
    *(struct.error, StopIteration, SyntaxError, LookupError, UnicodeError),
)
"""What libraries raise on damaged files, beside errors of their own."""


@contextmanager
def unheard(*names: str) -> Iterator[None]:
    """Keep libraries from warning and logging: they quote headers, with names of patients."""
    loggers = [logging.getLogger(name) for name in names]
    before = [logger.disabled for logger in loggers]
    for logger in loggers:
        logger.disabled = True
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        for logger, was in zip(loggers, before, strict=True):
            logger.disabled = was


RAS_TO_LPS: Final = np.diag([-1.0, -1.0, 1.0])


def parsed(
    values: NDArray[Any],
    affine: NDArray[np.float64],
    times: Sequence[float] | None,
    notes: Sequence[str] = (),
) -> Parsed:
    """Put together the answer of a parser.

    Parameters
    ----------
    values : (frames, i, j, k) array
    affine : (3, 4) float64, mm
        To LPS.
    times : sequence of float, s, or None
    notes : sequence of str
    """
    info = {"times": None if times is None else list(map(float, times)), "notes": list(notes)}
    return info, {"values": values, "affine": np.asarray(affine, dtype=np.float64)[:3]}


def require_size(shape: Sequence[int], itemsize: int, limits: ReadLimits) -> None:
    """Refuse a declared size above the limits before anything is read of it."""
    n = itemsize
    for length in shape:
        if not 0 < int(length) < 2**31:
            raise MalformedFileError(
                f"The image has {length} samples along an axis.", remedy="Write the file again."
            )
        n *= int(length)
    limits.require("decompressed_bytes", n)


def inflated(data: bytes, limits: ReadLimits, wbits: int) -> bytes:
    """Unpack zlib (15) or gzip (31) data, up to the limit.

    Raises
    ------
    LimitError
        If it holds more.
    MalformedFileError
        If it is damaged.
    """
    most = min(limits.decompressed_bytes, limits.unfolded_bytes)
    parts: list[bytes] = []
    left = most + 1
    try:
        # Parallel writers leave several members of gzip behind one another.
        while left and (not parts or data[:2] == b"\x1f\x8b"):
            unpack = zlib.decompressobj(wbits)
            parts.append(unpack.decompress(data, left))
            left -= len(parts[-1])
            data = unpack.unused_data
    except zlib.error:
        raise MalformedFileError(
            "The compressed part of the image is damaged.", remedy="Write the file again."
        ) from None
    plain = b"".join(parts)
    if len(plain) > most:
        raise LimitError(
            f"The image unfolds to more than {most} bytes.",
            remedy="Send fewer frames, or a part of the volume around the object.",
            limit="decompressed_bytes",
            details={"most": most},
        )
    return plain


def scaled(values: NDArray[Any], slope: float, intercept: float) -> NDArray[Any]:
    """Apply slope and intercept; stored numbers stay as they are where these change nothing."""
    if slope == 1.0 and intercept == 0.0:
        return values
    return (values * np.float32(slope) + np.float32(intercept)).astype(np.float32)


def regular(interval: float, n: int) -> list[float] | None:
    """List times of so many frames, s; None where the interval says nothing."""
    if n < 2 or not (np.isfinite(interval) and interval > 0):
        return None
    return [k * interval for k in range(n)]
