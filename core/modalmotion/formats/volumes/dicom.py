"""DICOM slices, by pydicom: one file at a time, and only what places and times it."""

from __future__ import annotations

import hashlib
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import InputError, MalformedFileError, needs_extra
from modalmotion.formats.parser.answer import Parsed
from modalmotion.formats.volumes.dicom_stream import read_dicom
from modalmotion.formats.volumes.stack import BROKEN, declared_bytes, scaled, unheard
from modalmotion.limits import ReadLimits

_REMEDY: Final = "Send the images of one cine series or more, one slice and phase in each file."

# Read of a file; no name leaves the parser.
_TAGS: Final = (
    *("ImageOrientationPatient", "ImagePositionPatient", "PixelSpacing", "SliceThickness"),
    *("TriggerTime", "InstanceNumber", "NominalInterval", "SeriesInstanceUID", "PatientID"),
    *("FrameOfReferenceUID", "NumberOfFrames", "Rows", "Columns", "BitsAllocated"),
    *("RescaleSlope", "RescaleIntercept", "SamplesPerPixel", "PixelRepresentation", "PixelData"),
    *("PhotometricInterpretation", "BitsStored", "HighBit", "PlanarConfiguration"),
)


def parse_dicom(data: bytes, limits: ReadLimits) -> Parsed:
    """Read one DICOM file: its samples (1, i, j, 1) and where and when they were taken.

    Raises
    ------
    MalformedFileError
        If it is no slice in space.
    """
    with needs_extra("images"):
        import pydicom
    try:
        with unheard("pydicom"):
            return _of(read_dicom(data, _TAGS, limits), limits)
    except InputError:
        raise
    except (*BROKEN, pydicom.errors.InvalidDicomError, pydicom.errors.BytesLengthException):
        raise MalformedFileError("The DICOM file is damaged.", remedy=_REMEDY) from None


def _of(dataset: Any, limits: ReadLimits) -> Parsed:
    if int(dataset.get("NumberOfFrames") or 1) > 1:
        raise MalformedFileError(
            "The DICOM file holds several frames.",
            remedy="Export it as one file for each slice and phase, or as NIfTI.",
        )
    orientation = dataset.get("ImageOrientationPatient")
    position = dataset.get("ImagePositionPatient")
    spacing = dataset.get("PixelSpacing")
    if not (orientation and position and spacing and "PixelData" in dataset):
        raise MalformedFileError(
            "The DICOM file is no slice in space (a secondary capture, or a report).",
            remedy="Leave it out. " + _REMEDY,
        )
    rows, columns = int(dataset.Rows), int(dataset.Columns)
    declared_bytes((rows, columns), int(dataset.get("BitsAllocated") or 16) // 8 or 1, limits)
    shade = str(dataset.get("PhotometricInterpretation") or "")
    if int(dataset.get("SamplesPerPixel") or 1) != 1 or shade == "PALETTE COLOR":
        raise MalformedFileError("The pixels of the DICOM file are colours.", remedy=_REMEDY)
    if dataset.file_meta.TransferSyntaxUID.is_compressed:
        raise MalformedFileError(
            "The pixels of the DICOM file are compressed.",
            remedy="Export it without compression (Explicit VR Little Endian).",
        )
    from pydicom.pixels import pixel_array

    slope = float(dataset.get("RescaleSlope", 1) or 1)
    intercept = float(dataset.get("RescaleIntercept", 0) or 0)
    # Pixels run along the row first: index i goes down the rows, j along a row.
    pixels = np.asarray(pixel_array(dataset, view_only=True))
    if shade == "MONOCHROME1":
        # The least is white: turned, so that slices of one series are alike.
        is_signed = bool(dataset.get("PixelRepresentation"))
        pixels = ~pixels if is_signed else 2 ** int(dataset.BitsStored) - 1 - pixels
    pixels = scaled(pixels, slope, intercept)
    along, down = (_direction(row) for row in _vector(orientation, 6).reshape(2, 3))
    step_down, step_along = _vector(spacing, 2)
    across = np.cross(along, down)
    thickness = float(dataset.get("SliceThickness") or 0) or 1.0
    affine = np.column_stack(
        [step_down * down, step_along * along, thickness * across, _vector(position, 3)]
    )
    info: dict[str, Any] = {
        "times": None,
        "notes": [],
        "series": _sealed(dataset.get("SeriesInstanceUID")),
        "patient": _sealed(dataset.get("PatientID")),
        "space": _sealed(dataset.get("FrameOfReferenceUID")),
        "trigger_ms": _number(dataset.get("TriggerTime")),
        "interval_ms": _number(dataset.get("NominalInterval")),
        "number": _number(dataset.get("InstanceNumber")),
        "thickness": thickness,
    }
    return info, {"values": pixels.reshape(1, rows, columns, 1), "affine": affine}


def _vector(values: Any, n: int) -> NDArray[np.float64]:
    found = np.array([float(v) for v in values], dtype=np.float64)
    if len(found) != n or not np.isfinite(found).all():
        raise MalformedFileError("The DICOM file does not say where it lies.", remedy=_REMEDY)
    return found


def _direction(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Take the direction alone: the length of a step is stated elsewhere."""
    unit: NDArray[np.float64] = vector / max(float(np.linalg.norm(vector)), 1e-300)
    return unit


def _number(value: Any) -> float | None:
    try:
        return float(value)
    except (TypeError, ValueError):
        return None


def _sealed(value: Any) -> str:
    """Tell equal from different, and nothing else."""
    return hashlib.sha256(f"{value}".encode()).hexdigest()[:16]
