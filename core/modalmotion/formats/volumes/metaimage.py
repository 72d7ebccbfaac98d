"""MetaImage (.mha) from its documentation: raw or zlib, LPS as in ITK."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from modalmotion.errors import InputError, MalformedFileError
from modalmotion.formats.parser.answer import Parsed
from modalmotion.formats.volumes.stack import (
    BROKEN,
    declared_bytes,
    parsed,
    regular,
    scaled,
    timed,
)
from modalmotion.limits import ReadLimits
from modalmotion.numeric.unpacking import unpacked

_TYPES: Final = {
    "MET_CHAR": "i1",
    "MET_UCHAR": "u1",
    "MET_SHORT": "i2",
    "MET_USHORT": "u2",
    "MET_INT": "i4",
    "MET_UINT": "u4",
    "MET_LONG": "i4",
    "MET_ULONG": "u4",
    "MET_LONG_LONG": "i8",
    "MET_ULONG_LONG": "u8",
    "MET_FLOAT": "f4",
    "MET_DOUBLE": "f8",
}
_LONGEST_HEADER: Final = 20_000
_REMEDY: Final = "Write it as one .mha with its data inside (ElementDataFile = LOCAL)."


def parse_metaimage(data: bytes, limits: ReadLimits) -> Parsed:
    """Read a .mha of three axes, or four with time the last.

    Raises
    ------
    MalformedFileError
        If it is no such image.
    """
    try:
        return _parse(data, limits)
    except InputError:
        raise
    except BROKEN:
        raise MalformedFileError("The MetaImage file is damaged.", remedy=_REMEDY) from None


def _parse(data: bytes, limits: ReadLimits) -> Parsed:
    keys, start = _header(data)
    if keys.get("ElementDataFile") != "LOCAL":
        raise MalformedFileError("The samples are in another file.", remedy=_REMEDY)
    if keys.get("BinaryData", "True").lower() not in ("true", "1"):
        raise MalformedFileError(
            "The samples of the MetaImage file are words.",
            remedy="Write it with BinaryData = True.",
        )
    if keys["ElementType"] not in _TYPES:
        raise MalformedFileError(
            "The samples of the MetaImage file are no single numbers of a known type.",
            remedy=f"Write one of these: {', '.join(_TYPES)}.",
        )
    size = [int(word) for word in keys["DimSize"].split()]
    n = len(size)
    if n not in (3, 4) or int(keys.get("ElementNumberOfChannels", "1")) != 1:
        raise MalformedFileError(
            f"The image has {n} axes, or several numbers a voxel.", remedy=_REMEDY
        )
    is_big = keys.get("ElementByteOrderMSB", keys.get("BinaryDataByteOrderMSB", "False"))
    kind = np.dtype((">" if is_big.lower() in ("true", "1") else "<") + _TYPES[keys["ElementType"]])
    slope = _numbers(keys, ("ElementToIntensityFunctionSlope",), [1.0])[0]
    intercept = _numbers(keys, ("ElementToIntensityFunctionOffset",), [0.0])[0]
    is_scaled = (slope, intercept) != (1.0, 0.0)
    n_bytes = declared_bytes(size, kind.itemsize, limits, is_scaled=is_scaled)
    if keys.get("CompressedData", "False").lower() in ("true", "1"):
        body, start = unpacked(data, "zlib", n_bytes, start).data, 0
    else:
        body = memoryview(data)
    if len(body) - start < n_bytes:
        raise MalformedFileError("The MetaImage file ends before its samples do.", remedy=_REMEDY)
    values = np.frombuffer(body, kind, n_bytes // kind.itemsize, start).reshape(size, order="F")
    spacing = _numbers(keys, ("ElementSpacing", "ElementSize"), [1.0] * n)
    origin = _numbers(keys, ("Offset", "Position", "Origin"), [0.0] * n)
    turn = _numbers(keys, ("TransformMatrix", "Rotation", "Orientation"), list(np.eye(n).ravel()))
    # Row k of the matrix is the direction of axis k.
    axes = np.array(turn).reshape(n, n).T[:3, :3] * np.array(spacing[:3])
    affine = np.column_stack([axes, origin[:3]])
    frames = np.moveaxis(values, 3, 0) if n == 4 else values[None]
    limits.require("frames", len(frames))
    frames = scaled(frames, slope, intercept)
    # The format has no field for a unit of time.
    notes: list[str] = []
    times = timed(regular(spacing[3] if n == 4 else 0.0, len(frames)), None, "MetaImage", notes)
    return parsed(frames, affine, times, notes)


def _header(data: bytes) -> tuple[dict[str, str], int]:
    keys: dict[str, str] = {}
    start = 0
    while start < _LONGEST_HEADER:
        end = data.index(b"\n", start)
        name, _, value = data[start:end].decode("latin-1").partition("=")
        keys[name.strip()] = value.strip()
        start = end + 1
        if name.strip() == "ElementDataFile":
            return keys, start
    raise MalformedFileError("The header of the MetaImage file has no end.", remedy=_REMEDY)


def _numbers(keys: dict[str, str], names: tuple[str, ...], otherwise: list[float]) -> list[float]:
    for name in names:
        if name in keys:
            numbers = [float(word) for word in keys[name].split()]
            if not all(map(math.isfinite, numbers)):
                raise MalformedFileError(f"{name} is not finite.", remedy=_REMEDY)
            if len(numbers) != len(otherwise):
                raise MalformedFileError(
                    f"{name} has {len(numbers)} numbers, not {len(otherwise)}.", remedy=_REMEDY
                )
            return numbers
    return otherwise
