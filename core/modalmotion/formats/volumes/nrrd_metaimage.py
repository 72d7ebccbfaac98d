"""NRRD, Slicer's .seq.nrrd and MetaImage (.mha): a header of text, then samples.

NRRD is read by pynrrd, its space directions turned to LPS once. MetaImage is read from its
documentation: raw or zlib, LPS as in ITK.
"""

from __future__ import annotations

import io
import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import InputError, MalformedFileError, needs_extra
from modalmotion.formats.result import Parsed
from modalmotion.formats.volumes.stack import (
    BROKEN,
    declared_bytes,
    parsed,
    regular,
    scaled,
    timed,
    unheard,
)
from modalmotion.limits import ReadLimits
from modalmotion.numeric.unpacking import unpacked

# Signs that turn a space's coordinates to LPS.
_SPACES: Final = {
    "left-posterior-superior": (1, 1, 1),
    "lps": (1, 1, 1),
    "right-anterior-superior": (-1, -1, 1),
    "ras": (-1, -1, 1),
    "left-anterior-superior": (1, -1, 1),
    "las": (1, -1, 1),
}
# Kinds of axes that are time, or say nothing of what they are.
_TIMES: Final = ("time", "list")
_PLAIN: Final = ("domain", "space", "none", "???", "scalar", "stub")

_MM: Final = {
    "": 1.0,
    "mm": 1.0,
    "millimeter": 1.0,
    "millimeters": 1.0,
    "cm": 10.0,
    "m": 1e3,
    "meter": 1e3,
    "um": 1e-3,
    "\u00b5m": 1e-3,
    "micrometer": 1e-3,
    "nm": 1e-6,
}

# Names of the field of samples that are elsewhere.
_DETACHED: Final = ("data file", "datafile")

_GZIP: Final = ("gzip", "gz")

# Lines or bytes to be left out before the samples.
_SKIPS: Final = ("line skip", "lineskip", "byte skip", "byteskip")

_NRRD_TYPES: Final = {
    **dict.fromkeys(("signed char", "int8", "int8_t"), "i1"),
    **dict.fromkeys(("uchar", "unsigned char", "uint8", "uint8_t"), "u1"),
    **{
        f"{sign}{name}": f"{kind}{n}"
        for n, names in (
            (2, ("short", "short int", "int16", "int16_t")),
            (4, ("int", "int32", "int32_t")),
            (8, ("longlong", "long long", "long long int", "int64", "int64_t")),
        )
        for name in names
        for sign, kind in (("", "i"), ("signed ", "i"), ("unsigned ", "u"), ("u", "u"))
    },
    "float": "f4",
    "double": "f8",
}
_ORDERS: Final = {"little": "<", "big": ">"}

_NRRD_REMEDY: Final = (
    "Write it as one .nrrd with its data inside, of a volume or a Slicer sequence."
)


def parse_nrrd(data: bytes, limits: ReadLimits) -> Parsed:
    """Read a .nrrd or .seq.nrrd from bytes.

    Raises
    ------
    MalformedFileError
        If it is no such image.
    """
    with needs_extra("images"):
        from nrrd.errors import NRRDError
    try:
        with unheard("nrrd"):
            header, start = _nrrd_header(data)
            return _of(header, _samples(header, data, start, limits), limits)
    except InputError:
        raise
    except (*BROKEN, NRRDError):
        raise MalformedFileError("The NRRD file is damaged.", remedy=_NRRD_REMEDY) from None


def _nrrd_header(data: bytes) -> tuple[Any, int]:
    """Read the fields, whose names are in any case, and where the samples begin."""
    import nrrd

    stream, lines = io.BytesIO(data), []
    for line in stream:
        if not line.strip():
            break
        field, colon, value = line.partition(b":")
        is_own = colon and not value.startswith(b"=")
        lines.append(field.lower() + colon + value if is_own else line)
    return nrrd.read_header(lines), stream.tell()


def _samples(header: Any, data: bytes, start: int, limits: ReadLimits) -> NDArray[Any]:
    if any(name in header for name in _DETACHED):
        raise MalformedFileError("The samples are in another file.", remedy=_NRRD_REMEDY)
    encoding, name = (str(header[key]).lower() for key in ("encoding", "type"))
    if encoding not in ("raw", *_GZIP) or any(int(header.get(skip, 0)) for skip in _SKIPS):
        raise MalformedFileError(
            "The samples of the NRRD file are encoded, or begin, in a way that is not read.",
            remedy="Write it with encoding: raw or gzip, and skip nothing before them.",
        )
    kind = np.dtype(_NRRD_TYPES[name])
    if kind.itemsize > 1:
        kind = np.dtype(_ORDERS[str(header["endian"]).lower()] + _NRRD_TYPES[name])
    sizes = [int(n) for n in header["sizes"]]
    if len(sizes) != int(header["dimension"]):
        raise MalformedFileError("The NRRD file has other 'sizes' than axes.", remedy=_NRRD_REMEDY)
    n_bytes = declared_bytes(sizes, kind.itemsize, limits)
    held: bytes | NDArray[np.uint8] = data
    if encoding in _GZIP:
        held, start = unpacked(data, "gzip", n_bytes, start), 0
    if len(held) - start < n_bytes:
        raise MalformedFileError("The NRRD file ends before its samples do.", remedy=_NRRD_REMEDY)
    values = np.frombuffer(held, kind, n_bytes // kind.itemsize, start)
    return values.reshape(sizes, order="F")


def _of(header: Any, values: NDArray[Any], limits: ReadLimits) -> Parsed:
    if values.ndim not in (3, 4) or values.dtype.kind not in "iuf":
        raise MalformedFileError(
            f"The NRRD file has {values.ndim} axes, not space and time.", remedy=_NRRD_REMEDY
        )
    notes: list[str] = []
    kinds = [str(kind).lower() for kind in header.get("kinds", ["???"] * values.ndim)]
    directions = header.get("space directions")
    spacings = np.asarray(header.get("spacings", np.full(values.ndim, np.nan)), dtype=np.float64)
    space = str(header.get("space", "")).lower()
    interval = unit = None
    if directions is not None:
        rows = np.array([_row(row) for row in directions])
        if rows.shape[1] == 4:
            # Time as a fourth direction: an axis along it alone.
            along = np.abs(rows[:, 3]) > 0
            interval = float(rows[along, 3][0]) if along.any() else None
            rows[along] = np.nan
        spatial = [k for k in range(values.ndim) if np.isfinite(rows[k]).all()]
        steps = rows[spatial, :3].T
        units = header.get("space units")
        unit = units[3] if units is not None and len(units) == 4 else None
    else:
        lying = [k for k in range(values.ndim) if kinds[k] not in _TIMES]
        spatial = (lying if len(lying) == 3 else list(range(values.ndim)))[-3:]
        steps = np.diag(np.where(np.isfinite(spacings[spatial]), spacings[spatial], 1.0))
        units = [header["units"][k] for k in spatial] if "units" in header else None
    if len(spatial) != 3:
        raise MalformedFileError("The NRRD file has not three axes in space.", remedy=_NRRD_REMEDY)
    other = [k for k in range(values.ndim) if k not in spatial]
    for k in other:
        if kinds[k] not in (*_TIMES, *_PLAIN) and values.shape[k] > 1:
            raise MalformedFileError(
                f"Axis {k} of the NRRD file contains the parts of colours or vectors, not time.",
                remedy="Write one number for each voxel, and time as an axis of the kind list.",
            )
    space = space.removesuffix("-time")
    if space not in _SPACES:
        notes.append("The NRRD file names no space that is known; its coordinates count as LPS.")
    signs = np.diag(_SPACES.get(space, (1, 1, 1))).astype(np.float64)
    origin = np.asarray(header.get("space origin", np.zeros(3)), dtype=np.float64)[:3]
    affine = signs @ np.diag(_scales(units, notes)) @ np.column_stack([steps, origin])
    frames = np.moveaxis(values, other[0], 0) if other else values[None]
    limits.require("frames", len(frames))
    if interval is None:
        times, unit = _times(header, other, spacings, len(frames))
    else:
        times = regular(interval, len(frames))
    return parsed(frames, affine, timed(times, unit, "NRRD", notes), notes)


def _row(direction: Any) -> list[float]:
    """Step along one axis; none is NaN."""
    return [math.nan] * 3 if direction is None else [float(value) for value in direction]


def _scales(units: Any, notes: list[str]) -> list[float]:
    """Read mm for each unit of the three directions."""
    words = [str(unit).strip().lower() for unit in units][:3] if units is not None else [""] * 3
    if len(words) < 3 or not set(words) <= set(_MM):
        notes.append("The NRRD file's unit of length is unknown; its coordinates count as mm.")
        return [1.0] * 3
    return [_MM[word] for word in words]


def _times(
    header: Any, other: list[int], spacings: NDArray[np.float64], n: int
) -> tuple[list[float] | None, str | None]:
    """Read times as Slicer lists them, or by the spacing of the axis, and their unit."""
    unit = header.get("axis 0 index unit", header.get("axis 0 unit"))
    listed = str(header.get("axis 0 index values", "")).split()
    if len(listed) == n > 1:
        return [float(word) for word in listed], unit
    if unit is None and other and "units" in header:
        unit = header["units"][other[0]]
    return regular(float(spacings[other[0]]) if other else 0.0, n), unit


_METAIMAGE_TYPES: Final = {
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
_METAIMAGE_REMEDY: Final = "Write it as one .mha with its data inside (ElementDataFile = LOCAL)."


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
        raise MalformedFileError(
            "The MetaImage file is damaged.", remedy=_METAIMAGE_REMEDY
        ) from None


def _parse(data: bytes, limits: ReadLimits) -> Parsed:
    keys, start = _metaimage_header(data)
    if keys.get("ElementDataFile") != "LOCAL":
        raise MalformedFileError("The samples are in another file.", remedy=_METAIMAGE_REMEDY)
    if keys.get("BinaryData", "True").lower() not in ("true", "1"):
        raise MalformedFileError(
            "The samples of the MetaImage file are words.",
            remedy="Write it with BinaryData = True.",
        )
    if keys["ElementType"] not in _METAIMAGE_TYPES:
        raise MalformedFileError(
            "The samples of the MetaImage file are no single numbers of a known type.",
            remedy=f"Write one of these: {', '.join(_METAIMAGE_TYPES)}.",
        )
    size = [int(word) for word in keys["DimSize"].split()]
    n = len(size)
    if n not in (3, 4) or int(keys.get("ElementNumberOfChannels", "1")) != 1:
        raise MalformedFileError(
            f"The image has {n} axes, or several numbers a voxel.", remedy=_METAIMAGE_REMEDY
        )
    is_big = keys.get("ElementByteOrderMSB", keys.get("BinaryDataByteOrderMSB", "False"))
    kind = np.dtype(
        (">" if is_big.lower() in ("true", "1") else "<") + _METAIMAGE_TYPES[keys["ElementType"]]
    )
    slope = _numbers(keys, ("ElementToIntensityFunctionSlope",), [1.0])[0]
    intercept = _numbers(keys, ("ElementToIntensityFunctionOffset",), [0.0])[0]
    is_scaled = (slope, intercept) != (1.0, 0.0)
    n_bytes = declared_bytes(size, kind.itemsize, limits, is_scaled=is_scaled)
    if keys.get("CompressedData", "False").lower() in ("true", "1"):
        body, start = unpacked(data, "zlib", n_bytes, start).data, 0
    else:
        body = memoryview(data)
    if len(body) - start < n_bytes:
        raise MalformedFileError(
            "The MetaImage file ends before its samples do.", remedy=_METAIMAGE_REMEDY
        )
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


def _metaimage_header(data: bytes) -> tuple[dict[str, str], int]:
    keys: dict[str, str] = {}
    start = 0
    while start < _LONGEST_HEADER:
        end = data.index(b"\n", start)
        name, _, value = data[start:end].decode("latin-1").partition("=")
        keys[name.strip()] = value.strip()
        start = end + 1
        if name.strip() == "ElementDataFile":
            return keys, start
    raise MalformedFileError(
        "The header of the MetaImage file has no end.", remedy=_METAIMAGE_REMEDY
    )


def _numbers(keys: dict[str, str], names: tuple[str, ...], otherwise: list[float]) -> list[float]:
    for name in names:
        if name in keys:
            numbers = [float(word) for word in keys[name].split()]
            if not all(map(math.isfinite, numbers)):
                raise MalformedFileError(f"{name} is not finite.", remedy=_METAIMAGE_REMEDY)
            if len(numbers) != len(otherwise):
                raise MalformedFileError(
                    f"{name} has {len(numbers)} numbers, not {len(otherwise)}.",
                    remedy=_METAIMAGE_REMEDY,
                )
            return numbers
    return otherwise
