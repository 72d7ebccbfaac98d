"""NRRD and Slicer's .seq.nrrd, by pynrrd: space directions turned to LPS once."""

from __future__ import annotations

import io
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import InputError, MalformedFileError, needs_extra
from modalmotion.formats.parser.answer import Parsed
from modalmotion.formats.volumes.stack import BROKEN, parsed, regular, require_size, unheard
from modalmotion.limits import ReadLimits

# Signs that turn a space's coordinates to LPS.
_SPACES: Final = {
    "left-posterior-superior": (1, 1, 1),
    "lps": (1, 1, 1),
    "right-anterior-superior": (-1, -1, 1),
    "ras": (-1, -1, 1),
    "left-anterior-superior": (1, -1, 1),
    "las": (1, -1, 1),
}
_REMEDY: Final = "Write it as one .nrrd with its data inside, of a volume or a Slicer sequence."


def parse_nrrd(data: bytes, limits: ReadLimits) -> Parsed:
    """Read a .nrrd or .seq.nrrd from bytes.

    Raises
    ------
    MalformedFileError
        If it is no such image.
    """
    with needs_extra("images"):
        import nrrd
        from nrrd.errors import NRRDError
    try:
        with unheard("nrrd"):
            stream = io.BytesIO(data)
            header = nrrd.read_header(stream)
            if "data file" in header or "datafile" in header:
                raise MalformedFileError("The samples lie in another file.", remedy=_REMEDY)
            sizes = [int(n) for n in header["sizes"]]
            require_size(sizes, 8 if header["type"] == "double" else 4, limits)
            if header["encoding"] in ("gzip", "gz", "bzip2", "bz2"):
                # What it holds is known; a stream that holds more is cut off by its size.
                limits.require("decompressed_bytes", len(data))
            values = nrrd.read_data(header, stream, None)
            return _of(header, values, limits)
    except InputError:
        raise
    except (*BROKEN, NRRDError):
        raise MalformedFileError("The NRRD file is damaged.", remedy=_REMEDY) from None


def _of(header: Any, values: NDArray[Any], limits: ReadLimits) -> Parsed:
    if values.ndim not in (3, 4) or values.dtype.kind not in "iuf":
        raise MalformedFileError(
            f"The NRRD file has {values.ndim} axes, not space and time.", remedy=_REMEDY
        )
    notes: list[str] = []
    directions = header.get("space directions")
    spacings = np.asarray(header.get("spacings", np.full(values.ndim, np.nan)), dtype=np.float64)
    if directions is not None:
        rows = np.asarray(directions, dtype=np.float64).reshape(-1, 3)
        spatial = [k for k in range(values.ndim) if np.isfinite(rows[k]).all()]
        steps = rows[spatial].T
    else:
        spatial = list(range(values.ndim))[-3:]
        steps = np.diag(np.where(np.isfinite(spacings[spatial]), spacings[spatial], 1.0))
    if len(spatial) != 3:
        raise MalformedFileError("The NRRD file has not three axes in space.", remedy=_REMEDY)
    space = str(header.get("space", "")).lower()
    if space not in _SPACES:
        notes.append("The NRRD file names no space that is known; its coordinates count as LPS.")
    signs = np.diag(_SPACES.get(space, (1, 1, 1))).astype(np.float64)
    origin = np.asarray(header.get("space origin", np.zeros(3)), dtype=np.float64)
    affine = signs @ np.column_stack([steps, origin])
    other = [k for k in range(values.ndim) if k not in spatial]
    frames = np.moveaxis(values, other[0], 0) if other else values[None]
    limits.require("frames", len(frames))
    return parsed(frames, affine, _times(header, other, spacings, len(frames)), notes)


def _times(header: Any, other: list[int], spacings: NDArray[np.float64], n: int) -> Any:
    """Read times as Slicer writes them, in its unit, or by the spacing of the axis."""
    scale = (
        1e-3
        if str(header.get("axis 0 index unit", header.get("axis 0 unit", "s"))) == "ms"
        else 1.0
    )
    listed = str(header.get("axis 0 index values", "")).split()
    if len(listed) == n > 1:
        return [scale * float(word) for word in listed]
    return regular(float(spacings[other[0]]) if other else 0.0, n)
