"""NIfTI, by nibabel: the sform over the qform, units of length and time, RAS turned to LPS once."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from modalmotion.errors import InputError, MalformedFileError, needs_extra
from modalmotion.formats.parser.answer import Parsed
from modalmotion.formats.volumes.stack import (
    BROKEN,
    RAS_TO_LPS,
    inflated,
    parsed,
    regular,
    require_size,
    scaled,
    unheard,
)
from modalmotion.limits import ReadLimits

_MM: Final = {"mm": 1.0, "meter": 1e3, "micron": 1e-3, "unknown": 1.0}
_SECONDS: Final = {"sec": 1.0, "msec": 1e-3, "usec": 1e-6}

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
    if data[:2] == b"\x1f\x8b":
        data = inflated(data, limits, 31)
    try:
        kind = nibabel.Nifti2Image if data[4:7] == b"n+2" else nibabel.Nifti1Image
        with unheard("nibabel", "nibabel.global"):
            return _of(kind.from_bytes(data), limits)
    except InputError:
        raise
    except (*BROKEN, ImageFileError, HeaderDataError, WrapStructError):
        raise MalformedFileError("The NIfTI file is damaged.", remedy=_REMEDY) from None


def _of(image: Any, limits: ReadLimits) -> Parsed:
    header, shape = image.header, image.shape
    require_size(shape, image.get_data_dtype().itemsize, limits)
    if image.get_data_dtype().names or image.get_data_dtype().kind not in "iuf":
        raise MalformedFileError("The voxels are colours or complex numbers.", remedy=_REMEDY)
    full = (*shape, 1, 1, 1, 1)[: max(4, len(shape))]
    if any(n != 1 for n in full[4:]):
        raise MalformedFileError(
            f"The NIfTI file has {len(shape)} axes: more than space and time.", remedy=_REMEDY
        )
    n_frames = int(full[3])
    limits.require("frames", n_frames)
    raw = np.asarray(image.dataobj.get_unscaled()).reshape(full[:4])
    # Of the file: the header in memory has forgotten them.
    slope, intercept = float(image.dataobj.slope), float(image.dataobj.inter)
    values = scaled(np.moveaxis(raw, 3, 0), slope, intercept)
    length, duration = header.get_xyzt_units()
    affine = RAS_TO_LPS @ (np.asarray(image.affine, dtype=np.float64)[:3] * _MM.get(length, 1.0))
    notes = []
    if not int(header["sform_code"]) and not int(header["qform_code"]):
        notes.append("The NIfTI file does not say where it lies in space; its axes count as RAS.")
    zooms = header.get_zooms()
    interval = float(zooms[3]) if len(zooms) > 3 else 0.0
    if n_frames > 1 and interval > 0 and duration not in _SECONDS:
        notes.append(
            f"The NIfTI file states no unit for its interval of {interval:g} between frames, which "
            "is therefore not read: state the interval in seconds."
        )
    interval *= _SECONDS.get(duration, 0.0)
    return parsed(values, affine, regular(interval, n_frames), notes)
