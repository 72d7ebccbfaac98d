"""DICOM slices and the headers of studies, by pydicom: one file at a time.

Of slices only what places and times them is read; of a study's instance only its header.
"""

import hashlib
import io
import struct
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from modalmotion.errors import MalformedFileError, needs_extra
from modalmotion.formats.result import Parsed
from modalmotion.formats.volumes.stack import damaged, declared_bytes, scaled
from modalmotion.limits import ReadLimits
from modalmotion.representation import Floats

_PLAIN: Final = "Export it without compression (Explicit VR Little Endian)."

_RLE: Final = "1.2.840.10008.1.2.5"
_JPEG_2000: Final = ("1.2.840.10008.1.2.4.90", "1.2.840.10008.1.2.4.91")

# Start of a codestream, and of its sizes (ISO/IEC 15444-1, A.5.1): right, lower, left, upper end.
_START: Final = b"\xff\x4f\xff\x51"
_SIZES: Final = (8, 12, 16, 20)

# Bytes of the table of segments in front of RLE's own (DICOM PS3.5, G.5).
_TABLE: Final = 64
_NO_RUN: Final = 128


class _Stream(io.BytesIO):
    def read(self, size: int | None = -1, /) -> bytes:
        """Read so many bytes; all of the rest is what deflated data sets are inflated from."""
        if size is None or size < 0:
            raise MalformedFileError(
                "The DICOM file is deflated, which would unfold to any size.", remedy=_PLAIN
            )
        return super().read(size)


def read_dicom(data: bytes, tags: Sequence[str], *, has_pixels: bool = True) -> Any:
    """Read elements of a file, its pixels too if it `has_pixels` to be read.

    Raises
    ------
    MalformedFileError
        If it is deflated as a whole.
    pydicom.errors.InvalidDicomError, OSError, ValueError, ...
        What pydicom raises on other files.
    """
    import pydicom

    stream = _Stream(data)
    return pydicom.dcmread(stream, stop_before_pixels=not has_pixels, specific_tags=list(tags))


def require_decodable(dataset: Any, n: int, rows: int, columns: int) -> None:
    """Refuse compressed pixels that nothing here decodes, or that unfold to another size.

    RLE is decoded by pydicom alone, JPEG 2000 by Pillow.

    Raises
    ------
    MalformedFileError
        It names the compression, and the package that is missing.
    """
    from pydicom.encaps import generate_frames
    from pydicom.pixels import get_decoder

    syntax = dataset.file_meta.TransferSyntaxUID
    if syntax != _RLE and syntax not in _JPEG_2000:
        raise MalformedFileError(
            f"The pixels of the DICOM file are compressed as {syntax.name}; RLE and JPEG 2000 are "
            "read.",
            remedy=_PLAIN,
        )
    if not get_decoder(syntax).is_available:
        raise MalformedFileError(
            f"The pixels of the DICOM file are compressed as {syntax.name}, which Pillow decodes.",
            remedy=f"Run: pip install pillow. Or: {_PLAIN[0].lower()}{_PLAIN[1:]}",
        )
    unfolds = _unfolds_by_runs if syntax == _RLE else _is_codestream
    frames = generate_frames(dataset.PixelData, number_of_frames=n)
    if not all(unfolds(frame, rows, columns) for frame in frames):
        raise MalformedFileError(
            f"The compressed pixels of the DICOM file are not {rows} x {columns} samples.",
            remedy=_PLAIN,
        )


def _is_codestream(frame: bytes, rows: int, columns: int) -> bool:
    """Whether a codestream of JPEG 2000 declares so many samples."""
    at = frame.find(_START)
    right, lower, left, upper = (int.from_bytes(frame[at + i : at + i + 4], "big") for i in _SIZES)
    return at >= 0 and (lower - upper, right - left) == (rows, columns)


def _unfolds_by_runs(frame: bytes, rows: int, columns: int) -> bool:
    """Whether no segment of RLE, one byte of each sample, unfolds to more than so many samples."""
    n, *table = struct.unpack("<16L", frame[:_TABLE])
    ends = [*table[1:n], len(frame)]
    pairs = zip(table[:n], ends, strict=True)
    return all(_unfolds_to(frame[start:end], rows * columns) for start, end in pairs)


def _unfolds_to(segment: bytes, most: int) -> bool:
    """Whether runs unfold to no more than so many bytes."""
    n, at = 0, 0
    # What is left of a row is padded by one byte.
    while at < len(segment) - 1 and n <= most:
        head = segment[at]
        if head < _NO_RUN:
            n += head + 1
            at += head + 2
        elif head > _NO_RUN:
            n += 257 - head
            at += 2
        else:
            at += 1
    return n <= most


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


@damaged("The DICOM file is damaged.", _REMEDY, "pydicom")
def parse_dicom(data: bytes, limits: ReadLimits) -> Parsed:
    """Read one DICOM file: its samples (n, i, j), and where and when each slice was taken.

    An enhanced object has several slices, each with functional groups of its own or shared ones.

    Raises
    ------
    MalformedFileError
        If it is no slice in space.
    """
    with needs_extra("images"):
        from pydicom.pixels import pixel_array
    dataset = read_dicom(data, _TAGS)
    n = int(dataset.get("NumberOfFrames") or 1)
    frames = dataset.get("PerFrameFunctionalGroupsSequence") or [{}]
    if n > 1 and len(frames) != n:
        raise MalformedFileError(
            f"The DICOM file contains {n} frames without the position of each one.",
            remedy="Export it as one file for each slice and phase, or as NIfTI.",
        )
    shared = (dataset.get("SharedFunctionalGroupsSequence") or [{}])[0]
    slices = [_slice(k, dataset, frame, shared) for k, frame in enumerate(frames)]
    if "PixelData" not in dataset:
        raise _no_slice()
    rows, columns = int(dataset.Rows), int(dataset.Columns)
    declared_bytes((n, rows, columns), int(dataset.get("BitsAllocated") or 16) // 8 or 1, limits)
    shade = str(dataset.get("PhotometricInterpretation") or "")
    if int(dataset.get("SamplesPerPixel") or 1) != 1 or shade == "PALETTE COLOR":
        raise MalformedFileError("The pixels of the DICOM file are colours.", remedy=_REMEDY)
    if dataset.file_meta.TransferSyntaxUID.is_compressed:
        require_decodable(dataset, n, rows, columns)
    # Pixels run along the row first: index i goes down the rows, j along a row.
    pixels = np.asarray(pixel_array(dataset, view_only=True)).reshape(n, rows, columns)
    if shade == "MONOCHROME1":
        # The least is white: turned, so that slices of one series are alike.
        is_signed = bool(dataset.get("PixelRepresentation"))
        pixels = ~pixels if is_signed else 2 ** int(dataset.BitsStored) - 1 - pixels
    if len(scales := {own.scale for own in slices}) == 1:
        pixels = scaled(pixels, *scales.pop())
    else:
        pairs = zip(pixels, slices, strict=True)
        pixels = np.stack([np.float32(one) * own.scale[0] + own.scale[1] for one, own in pairs])
    info: dict[str, Any] = {
        "times": None,
        "notes": [],
        "series": _sealed(dataset.get("SeriesInstanceUID")),
        "patient": _sealed(dataset.get("PatientID")),
        "space": _sealed(dataset.get("FrameOfReferenceUID")),
        "slices": [own.info for own in slices],
    }
    return info, {"values": pixels, "affine": np.stack([own.affine for own in slices])}


class _Slice(NamedTuple):
    affine: Floats
    # Slope and intercept.
    scale: tuple[float, float]
    info: dict[str, Any]


def _slice(k: int, dataset: Any, frame: Any, shared: Any) -> _Slice:
    """Where and when slice k was taken: by its own functional groups, shared ones, or the file."""

    def of(group: str, name: str, otherwise: str = "") -> Any:
        items = (item for one in (frame, shared) for item in one.get(group) or ())
        found = (item.get(name) for item in items)
        stated = next((value for value in found if value is not None), None)
        return dataset.get(otherwise or name) if stated is None else stated

    orientation = of("PlaneOrientationSequence", "ImageOrientationPatient")
    position = of("PlanePositionSequence", "ImagePositionPatient")
    spacing = of("PixelMeasuresSequence", "PixelSpacing")
    if not (orientation and position and spacing):
        raise _no_slice()
    thickness = float(of("PixelMeasuresSequence", "SliceThickness") or 0) or 1.0
    # Directions alone: the length of a step is stated elsewhere.
    along, down = (
        row / max(float(np.linalg.norm(row)), 1e-300)
        for row in _vector(orientation, 6).reshape(2, 3)
    )
    step_down, step_along = _vector(spacing, 2)
    across = thickness * np.cross(along, down)
    affine = [step_down * down, step_along * along, across, _vector(position, 3)]
    slope, intercept = (
        of("PixelValueTransformationSequence", f"Rescale{name}") for name in ("Slope", "Intercept")
    )
    beat, number = "CardiacSynchronizationSequence", _number(dataset.get("InstanceNumber"))
    info = {
        "trigger_ms": _number(of(beat, "NominalCardiacTriggerDelayTime", "TriggerTime")),
        "interval_ms": _number(of(beat, "RRIntervalTimeNominal", "NominalInterval")),
        "number": k if number is None else number + k,
        "thickness": thickness,
    }
    return _Slice(np.column_stack(affine), (float(slope or 1), float(intercept or 0)), info)


def _no_slice() -> MalformedFileError:
    return MalformedFileError(
        "The DICOM file is not a slice with a position (a secondary capture, or a report).",
        remedy="Leave it out. " + _REMEDY,
    )


def _vector(values: Any, n: int) -> Floats:
    found = np.array([float(v) for v in values], dtype=np.float64)
    if len(found) != n or not np.isfinite(found).all():
        raise MalformedFileError(
            "The DICOM file states no valid position and orientation.", remedy=_REMEDY
        )
    return found


def _number(value: Any) -> float | None:
    try:
        return float(value)
    except (TypeError, ValueError):
        return None


def _sealed(value: Any) -> str:
    """Return a digest: equal values have equal ones, and nothing else can be read from it."""
    return hashlib.sha256(f"{value}".encode()).hexdigest()[:16]


_SEND_AGAIN: Final = "Send one instance of the study as the archive has it."

# Without these nothing can be filed beside it.
_NEEDED: Final = ("StudyInstanceUID", "SeriesInstanceUID", "SOPInstanceUID", "SOPClassUID")
# What an archive files by, as sent; a value that is none is refused.
_KEPT: Final = (
    *("PatientName", "PatientID", "IssuerOfPatientID", "PatientSex"),
    *("StudyID", "AccessionNumber", "ReferringPhysicianName", "StudyDescription"),
    "FrameOfReferenceUID",
)
# Left out where they are no date or time, which archives forgive.
_MOMENTS: Final = ("PatientBirthDate", "StudyDate", "StudyTime")
_SEXES: Final = ("", "F", "M", "O")


@damaged("These bytes are no DICOM instance, or a damaged one.", _SEND_AGAIN, "pydicom")
def parse_study(data: bytes, _: ReadLimits) -> Parsed:
    """Read whose an instance is, and of which study: text by DICOM's keywords.

    Raises
    ------
    MalformedFileError
        If it is no DICOM instance, or a value cannot be written again; it names no value.
    """
    with needs_extra("dicom"):
        import pydicom  # noqa: F401
    names = (*_NEEDED, *_KEPT, *_MOMENTS, "SpecificCharacterSet")
    dataset = read_dicom(data, names, has_pixels=False)
    header = {name: str(dataset.get(name) or "") for name in (*_NEEDED, *_KEPT)}
    missing = [name for name in _NEEDED if not header[name]]
    if missing:
        raise MalformedFileError(
            f"The instance states no {' and no '.join(missing)}.", remedy=_SEND_AGAIN
        )
    for name, value in header.items():
        if not _is_valid(name, value) or (name == "PatientSex" and value not in _SEXES):
            raise MalformedFileError(
                f"The instance's {name} is none that DICOM allows.",
                remedy="Correct it in the archive, and send the instance again.",
            )
    for name in _MOMENTS:
        value = str(dataset.get(name) or "")
        header[name] = value if _is_valid(name, value) else ""
    return {"header": header}, {}


def _is_valid(name: str, value: str) -> bool:
    from pydicom.config import RAISE
    from pydicom.datadict import dictionary_VR
    from pydicom.valuerep import DA, TM, validate_value

    kind = dictionary_VR(name)
    try:
        validate_value(kind, value, RAISE)
        if name in _MOMENTS:
            {"DA": DA, "TM": TM}[kind](value)
    except ValueError:
        return False
    return True
