"""NIfTI, by nibabel: the sform over the qform, units of length and time, RAS turned to LPS once."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from modalmotion.errors import InputError, MalformedFileError, needs_extra
from modalmotion.formats.parser.answer import Parsed
from modalmotion.formats.volumes.stack import (
    BROKEN,
    RAS_TO_LPS,
    declared_bytes,
    parsed,
    regular,
    scaled,
    timed,
    unheard,
)
from modalmotion.limits import ReadLimits
from modalmotion.numeric.unpacking import unpacked, unpacked_head

_MM: Final = {"mm": 1.0, "meter": 1e3, "micron": 1e-3, "unknown": 1.0}

# The longer header, of NIfTI-2.
_HEAD: Final = 540

_REMEDY: Final = "Write it again as one .nii or .nii.gz of a volume, or of volumes over time."


def parse_nifti(data: bytes, limits: ReadLimits) -> Parsed:
    """Read a .nii or .nii.gz from bytes.

    Raises
    ------
    MalformedFileError
        If it is no such image.
    """
    with needs_extra("images"):
        import nibabel
        from nibabel.filebasedimages import ImageFileError
        from nibabel.spatialimages import HeaderDataError
        from nibabel.wrapstruct import WrapStructError
    is_packed = data[:2] == b"\x1f\x8b"
    head = unpacked_head(data, "gzip", _HEAD) if is_packed else data[:_HEAD]
    kind = nibabel.Nifti2Header if head[4:7] == b"n+2" else nibabel.Nifti1Header
    try:
        with unheard("nibabel", "nibabel.global"):
            return _of(kind(head[: kind.template_dtype.itemsize]), data, limits, is_packed)
    except InputError:
        raise
    except (*BROKEN, ImageFileError, HeaderDataError, WrapStructError):
        raise MalformedFileError("The NIfTI file is damaged.", remedy=_REMEDY) from None


def _of(header: Any, data: bytes, limits: ReadLimits, is_packed: bool) -> Parsed:
    kind, shape = header.get_data_dtype(), header.get_data_shape()
    slope, intercept = header.get_slope_inter()
    slope, intercept = (1.0, 0.0) if slope is None else (float(slope), float(intercept))
    n_bytes = declared_bytes(
        shape, kind.itemsize, limits, is_scaled=(slope, intercept) != (1.0, 0.0)
    )
    if kind.names or kind.kind not in "iuf":
        raise MalformedFileError("The voxels are colours or complex numbers.", remedy=_REMEDY)
    full = (*shape, 1, 1, 1, 1)[: max(4, len(shape))]
    if any(n != 1 for n in full[4:]):
        raise MalformedFileError(
            f"The NIfTI file has {len(shape)} axes: more than space and time.", remedy=_REMEDY
        )
    n_frames = int(full[3])
    limits.require("frames", n_frames)
    offset = int(header.get_data_offset())
    limits.require("decompressed_bytes", offset + n_bytes)
    plain = unpacked(data, "gzip", offset + n_bytes) if is_packed else data
    raw = np.frombuffer(plain, kind, n_bytes // kind.itemsize, offset)
    values = scaled(np.moveaxis(raw.reshape(full[:4], order="F"), 3, 0), slope, intercept)
    length, duration = header.get_xyzt_units()
    affine = RAS_TO_LPS @ (
        np.asarray(header.get_best_affine(), dtype=np.float64)[:3] * _MM.get(length, 1.0)
    )
    notes: list[str] = []
    if not int(header["sform_code"]) and not int(header["qform_code"]):
        notes.append("The NIfTI file does not say where it lies in space; its axes count as RAS.")
    zooms = header.get_zooms()
    interval = float(zooms[3]) if len(zooms) > 3 else 0.0
    times = timed(regular(interval, n_frames), duration, "NIfTI", notes)
    return parsed(values, affine, times, notes)
