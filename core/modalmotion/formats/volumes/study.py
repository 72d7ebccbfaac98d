"""The header of a DICOM instance: whose it is and of which study. Its pixels are not read."""

from __future__ import annotations

from typing import Any, Final

from modalmotion.errors import InputError, MalformedFileError, needs_extra
from modalmotion.formats.parser.answer import Parsed
from modalmotion.formats.volumes.dicom import read_dicom
from modalmotion.formats.volumes.stack import BROKEN, unheard
from modalmotion.limits import ReadLimits

_REMEDY: Final = "Send one instance of the study as the archive has it."

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


def parse_study(data: bytes, _: ReadLimits) -> Parsed:
    """Read whose an instance is, and of which study: text by DICOM's keywords.

    Raises
    ------
    MalformedFileError
        If it is no DICOM instance, or a value cannot be written again; it names no value.
    """
    with needs_extra("dicom"):
        import pydicom
    names = (*_NEEDED, *_KEPT, *_MOMENTS, "SpecificCharacterSet")
    try:
        with unheard("pydicom"):
            dataset = read_dicom(data, names, has_pixels=False)
            return {"header": _header(dataset)}, {}
    except InputError:
        raise
    except (*BROKEN, pydicom.errors.InvalidDicomError, pydicom.errors.BytesLengthException):
        raise MalformedFileError(
            "These bytes are no DICOM instance, or a damaged one.", remedy=_REMEDY
        ) from None


def _header(dataset: Any) -> dict[str, str]:
    header = {name: str(dataset.get(name) or "") for name in (*_NEEDED, *_KEPT)}
    missing = [name for name in _NEEDED if not header[name]]
    if missing:
        raise MalformedFileError(
            f"The instance states no {' and no '.join(missing)}.", remedy=_REMEDY
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
    return header


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
