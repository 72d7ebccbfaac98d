"""What a file of images is read to: samples over time, and where they are."""

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

from modalmotion.errors import MalformedFileError
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


_SECONDS: Final = {
    **dict.fromkeys(("s", "sec", "second", "seconds"), 1.0),
    **dict.fromkeys(("ms", "msec", "millisecond", "milliseconds"), 1e-3),
    **dict.fromkeys(("us", "usec", "microsecond", "microseconds"), 1e-6),
}

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


def declared_bytes(
    shape: Sequence[int], itemsize: int, limits: ReadLimits, *, is_scaled: bool = False
) -> int:
    """Count the bytes that a header declares, before anything is read of them.

    Parameters
    ----------
    shape : sequence of int
    itemsize : int
    limits : ReadLimits
        On these bytes, and on the float32 that they become where they `is_scaled`.
    is_scaled : bool

    Raises
    ------
    MalformedFileError
        If a length is none.
    LimitError
        If they are too many.
    """
    n = 1
    for length in shape:
        if not 0 < int(length) < 2**31:
            raise MalformedFileError(
                f"The image has {length} samples along an axis.", remedy="Write the file again."
            )
        n *= int(length)
    limits.require("decompressed_bytes", n * (max(4, itemsize) if is_scaled else itemsize))
    return n * itemsize


def scaled(values: NDArray[Any], slope: float, intercept: float) -> NDArray[Any]:
    """Apply slope and intercept; stored numbers stay as they are where these change nothing."""
    if slope == 1.0 and intercept == 0.0:
        return values
    plain: NDArray[np.float32] = np.multiply(values, np.float32(slope), dtype=np.float32)
    plain += np.float32(intercept)
    return plain


def regular(interval: float, n: int) -> list[float] | None:
    """List times of so many frames, s; None if the interval says nothing."""
    if n < 2 or not (np.isfinite(interval) and interval > 0):
        return None
    return [k * interval for k in range(n)]


def timed(
    times: list[float] | None, unit: str | None, form: str, notes: list[str]
) -> list[float] | None:
    """Turn times in a stated unit into seconds; without one they are not read, and noted."""
    scale = _SECONDS.get(str(unit).strip().lower())
    if times is not None and scale is None:
        notes.append(
            f"The {form} file states no unit for its interval of {times[1] - times[0]:g} between "
            "frames, which is therefore not read: state the interval in seconds."
        )
    return None if times is None or scale is None else [scale * time for time in times]
