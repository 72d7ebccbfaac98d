"""DICOM slices, by pydicom: one file at a time, and only what places and times it."""

from __future__ import annotations

import hashlib
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import InputError, MalformedFileError, needs_extra
from modalmotion.formats.parser.answer import Parsed
from modalmotion.formats.volumes.dicom_compressed import read_dicom, require_decodable
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
    *("SharedFunctionalGroupsSequence", "PerFrameFunctionalGroupsSequence"),
)


def parse_dicom(data: bytes, limits: ReadLimits) -> Parsed:
    """Read one DICOM file: its samples (n, i, j), and where and when each slice was taken.

    An enhanced object has several slices, each with functional groups of its own or shared ones.

    Raises
    ------
    MalformedFileError
        If it is no slice in space.
    """
    with needs_extra("images"):
        import pydicom
    try:
        with unheard("pydicom"):
            return _of(read_dicom(data, _TAGS), limits)
    except InputError:
        raise
    except (*BROKEN, pydicom.errors.InvalidDicomError, pydicom.errors.BytesLengthException):
        raise MalformedFileError("The DICOM file is damaged.", remedy=_REMEDY) from None


def _of(dataset: Any, limits: ReadLimits) -> Parsed:
    n = int(dataset.get("NumberOfFrames") or 1)
    frames = dataset.get("PerFrameFunctionalGroupsSequence") or [{}]
    if n > 1 and len(frames) != n:
        raise MalformedFileError(
            f"The DICOM file holds {n} frames, and does not say where each one lies.",
            remedy="Export it as one file for each slice and phase, or as NIfTI.",
        )
    shared = (dataset.get("SharedFunctionalGroupsSequence") or [{}])[0]
    groups = [_Groups(dataset, frame, shared) for frame in frames]
    if "PixelData" not in dataset or not all(own.is_placed for own in groups):
        raise MalformedFileError(
            "The DICOM file is no slice in space (a secondary capture, or a report).",
            remedy="Leave it out. " + _REMEDY,
        )
    rows, columns = int(dataset.Rows), int(dataset.Columns)
    declared_bytes((n, rows, columns), int(dataset.get("BitsAllocated") or 16) // 8 or 1, limits)
    shade = str(dataset.get("PhotometricInterpretation") or "")
    if int(dataset.get("SamplesPerPixel") or 1) != 1 or shade == "PALETTE COLOR":
        raise MalformedFileError("The pixels of the DICOM file are colours.", remedy=_REMEDY)
    if dataset.file_meta.TransferSyntaxUID.is_compressed:
        require_decodable(dataset, n, rows, columns)
    from pydicom.pixels import pixel_array

    # Pixels run along the row first: index i goes down the rows, j along a row.
    pixels = np.asarray(pixel_array(dataset, view_only=True)).reshape(n, rows, columns)
    if shade == "MONOCHROME1":
        # The least is white: turned, so that slices of one series are alike.
        is_signed = bool(dataset.get("PixelRepresentation"))
        pixels = ~pixels if is_signed else 2 ** int(dataset.BitsStored) - 1 - pixels
    scales = {own.scale for own in groups}
    if len(scales) == 1:
        pixels = scaled(pixels, *scales.pop())
    else:
        pairs = zip(pixels, groups, strict=True)
        pixels = np.stack([np.float32(one) * own.scale[0] + own.scale[1] for one, own in pairs])
    info: dict[str, Any] = {
        "times": None,
        "notes": [],
        "series": _sealed(dataset.get("SeriesInstanceUID")),
        "patient": _sealed(dataset.get("PatientID")),
        "space": _sealed(dataset.get("FrameOfReferenceUID")),
        "slices": [own.info(k) for k, own in enumerate(groups)],
    }
    return info, {"values": pixels, "affine": np.stack([own.affine for own in groups])}


class _Groups:
    """Where and when one slice was taken: of its own functional groups, shared ones, or the file.

    Parameters
    ----------
    dataset : pydicom.Dataset
    frame, shared : mapping
    """

    def __init__(self, dataset: Any, frame: Any, shared: Any) -> None:
        self._places = (dataset, frame, shared)

    def _of(self, group: str, name: str) -> Any:
        dataset, *groups = self._places
        for one in groups:
            for item in one.get(group) or ():
                if item.get(name) is not None:
                    return item.get(name)
        return dataset.get(name)

    @property
    def is_placed(self) -> bool:
        return bool(
            self._of("PlaneOrientationSequence", "ImageOrientationPatient")
            and self._of("PlanePositionSequence", "ImagePositionPatient")
            and self._of("PixelMeasuresSequence", "PixelSpacing")
        )

    @property
    def thickness(self) -> float:
        return float(self._of("PixelMeasuresSequence", "SliceThickness") or 0) or 1.0

    @property
    def scale(self) -> tuple[float, float]:
        """Slope and intercept."""
        group = "PixelValueTransformationSequence"
        slope, intercept = (self._of(group, f"Rescale{name}") for name in ("Slope", "Intercept"))
        return float(slope or 1), float(intercept or 0)

    @property
    def affine(self) -> NDArray[np.float64]:
        orientation = self._of("PlaneOrientationSequence", "ImageOrientationPatient")
        along, down = (_direction(row) for row in _vector(orientation, 6).reshape(2, 3))
        spacing = self._of("PixelMeasuresSequence", "PixelSpacing")
        step_down, step_along = _vector(spacing, 2)
        across = np.cross(along, down)
        position = _vector(self._of("PlanePositionSequence", "ImagePositionPatient"), 3)
        return np.column_stack(
            [step_down * down, step_along * along, self.thickness * across, position]
        )

    def info(self, k: int) -> dict[str, Any]:
        """Say when it was taken; k counts the slices of a file."""
        beat = "CardiacSynchronizationSequence"
        trigger = self._of(beat, "NominalCardiacTriggerDelayTime")
        interval = self._of(beat, "RRIntervalTimeNominal")
        number = _number(self._of("", "InstanceNumber"))
        dataset = self._places[0]
        return {
            "trigger_ms": _number(dataset.get("TriggerTime") if trigger is None else trigger),
            "interval_ms": _number(
                dataset.get("NominalInterval") if interval is None else interval
            ),
            "number": k if number is None else number + k,
            "thickness": self.thickness,
        }


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
