"""UIDs, codes and times of objects: the same for the same report of the same study."""

from __future__ import annotations

import uuid
from typing import TYPE_CHECKING, Any, Final

from modalmotion.reports.codes import DICOM, LOINC, OWN, SYSTEM, concept
from modalmotion.reports.content import Report

if TYPE_CHECKING:
    from modalmotion.facts import Facts
    from modalmotion.reports.dicom.source import Study

SCHEME: Final = "99MODALMOTION"
"""Of our own codes; DICOM requires 99 before unregistered ones."""

_NAMESPACE: Final = uuid.uuid5(uuid.NAMESPACE_OID, f"{SYSTEM}:dicom")
# Longest code and longest meaning.
_MEANING: Final = 64


def uid_of(report: Report, study: Study, name: str) -> str:
    """Return the UID of an object: of the report, the study and the object's name.

    Of the form 2.25 (PS3.5, B.2), which needs no registered root.
    """
    text = f"{report.digest} {study.header['StudyInstanceUID']} {name}"
    return f"2.25.{uuid.uuid5(_NAMESPACE, text).int}"


def own_code(code: str, meaning: str | None = None) -> Any:
    """Return a code of our own table."""
    from highdicom.sr import CodedConcept

    said = OWN[code] if meaning is None else meaning
    return CodedConcept(code.replace("_", "-"), SCHEME, said[:_MEANING])


def code_of(code: str, facts: Facts) -> Any:
    """Return the code of a quantity: DICOM's, LOINC's as in the FHIR bundle, or our own."""
    from highdicom.sr import CodedConcept

    if code in DICOM:
        return CodedConcept(DICOM[code][0], "DCM", DICOM[code][1])
    first = concept(code, facts)["coding"][0]
    if first["system"] == LOINC:
        return CodedConcept(first["code"], "LN", first["display"])
    return own_code(code)


def ucum(code: str) -> Any:
    """Return a unit."""
    from highdicom.sr import CodedConcept

    return CodedConcept(code, "UCUM", {"1": "no units", "%": "percent"}.get(code, code))


def stamp(dataset: Any, report: Report) -> None:
    """Set all times of an object to that of the result, and its origin."""
    day, time = f"{report.issued:%Y%m%d}", f"{report.issued:%H%M%S}"
    for moment in ("InstanceCreation", "Content", "Series"):
        setattr(dataset, f"{moment}Date", day)
        setattr(dataset, f"{moment}Time", time)
    dataset.TimezoneOffsetFromUTC = "+0000"
    for equipment in dataset.get("ContributingEquipmentSequence", ()):
        equipment.ContributionDateTime = f"{day}{time}"
    dataset.Manufacturer = dataset.ManufacturerModelName = "modalmotion"
    dataset.DeviceSerialNumber = "none"
    dataset.SoftwareVersions = version_of(report)


def version_of(report: Report) -> str:
    """Version that made the result."""
    return str(report.signature.provenance.get("modalmotion", "unknown"))
