"""Reports as DICOM objects: measurements and surfaces of a study."""

import io
import logging
import uuid
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from modalmotion import errors, formats, mesh
from modalmotion.formats import frame_files
from modalmotion.formats.parser_process import ParserProcess
from modalmotion.formats.text_meshes import write_stl
from modalmotion.formats.volumes.stack import unheard
from modalmotion.limits import DEFAULT_LIMITS
from modalmotion.reports import content
from modalmotion.representation import shown


@shown()
@dataclass(frozen=True)
class Study:
    """What is copied from an instance into objects of the same study.

    Its `repr` does not show it, because it names a patient.

    Parameters
    ----------
    header : mapping of str to str
        By DICOM's keywords.
    """

    header: Mapping[str, str]

    def dataset(self) -> Any:
        """Return the header as a pydicom Dataset."""
        from pydicom.dataset import Dataset

        found = Dataset()
        found.SpecificCharacterSet = "ISO_IR 192"
        for name, value in self.header.items():
            if name != "FrameOfReferenceUID" or value:
                setattr(found, name, value)
        return found


def read_study(source: bytes | Path, *, parser: formats.Parser | None = None) -> Study:
    """Read the header of an instance, in a disposable process.

    Parameters
    ----------
    source : bytes or Path
    parser : Parser, optional

    Raises
    ------
    MalformedFileError
        If it is not a DICOM instance; no value of it is named.
    MissingExtraError
        If pydicom is absent.
    """
    try:
        data = source.read_bytes() if isinstance(source, Path) else source
    except OSError as error:
        raise errors.MalformedFileError(
            f"The instance cannot be read: {error.strerror}.", remedy="Name a DICOM file."
        ) from error
    if parser is None:
        with ParserProcess(DEFAULT_LIMITS) as own:
            return Study(own.parse("study", data).info["header"])
    return Study(parser.parse("study", data).info["header"])


def dicom_instances(report: content.Report, study: Study) -> dict[str, bytes]:
    """Write a report as objects of the patient's study.

    Parameters
    ----------
    report : Report
        Of surfaces in LPS mm, in the frame of reference of the study's instance.
    study : Study

    Returns
    -------
    dict of str to bytes
        DICOM files by name: `report.dcm`, and of surfaces two frames, such as `end-diastole.dcm`
        and `end-systole.dcm`. The same for the same report and study.

    Raises
    ------
    ParameterError
        If the coordinates are not stated to be LPS mm.
    MissingExtraError
        If a package is absent.
    """
    require_space(report.sequence.facts, report.sequence.unit)
    with errors.needs_extra("dicom"):
        import highdicom  # noqa: F401 (its modules log from here on)
        import pydicom  # noqa: F401

    loggers = [name for name in logging.root.manager.loggerDict if name.startswith(_LIBRARIES)]
    # They log ids, and warn with the values of headers.
    with unheard(*loggers):
        written = {"report.dcm": structured_report(report, study)}
        # Points without triangles are not a surface.
        moments = content.moments_of(report) if len(report.sequence.faces) else []
        for number, (frame, name) in enumerate(moments, 1):
            file = f"{name.replace(' ', '-')}.dcm"
            written[file] = surface_instance(report, study, frame, name, number)
        files = {}
        for name, dataset in written.items():
            buffer = io.BytesIO()
            dataset.save_as(buffer, enforce_file_format=True)
            files[name] = buffer.getvalue()
    return files


def dicom_zip(report: content.Report, study: Study) -> bytes:
    """Write the objects of `dicom_instances` as one zip, the same bytes for the same objects."""
    return frame_files.stored_zip(dicom_instances(report, study), zipfile.ZIP_DEFLATED)


def require_space(facts: mesh.Facts, unit: str | None) -> None:
    """Check that coordinates are patient coordinates of DICOM.

    Raises
    ------
    ParameterError
        If they are not stated to be LPS, in mm.
    """
    if facts.coordinates != "LPS":
        stated = "are not stated" if facts.coordinates == "unknown" else f"are {facts.coordinates}"
        raise errors.ParameterError(
            f"The coordinates {stated}; an object of a study must be in LPS.",
            remedy="State coordinates=LPS if x goes to the patient's left, y to the back and z to "
            "the head, in the space of the study's images; otherwise convert the points first.",
            details={"fact": "coordinates"},
        )
    if unit != "mm":
        raise errors.ParameterError(
            f"The unit is {unit or 'unknown'}; an object of a study must be in mm.",
            remedy="State unit=mm, or send the points in mm.",
            details={"fact": "unit"},
        )


SCHEME: Final = "99MODALMOTION"
"""Of our own codes; DICOM requires 99 before unregistered ones."""

_NAMESPACE: Final = uuid.uuid5(uuid.NAMESPACE_OID, f"{content.SYSTEM}:dicom")
_LIBRARIES: Final = ("highdicom", "pydicom")
# Longest code and longest meaning.
_MEANING: Final = 64


def uid_of(report: content.Report, study: Study, name: str) -> str:
    """Return the UID of an object: of the report, the study and the object's name.

    Of the form 2.25 (PS3.5, B.2), which needs no registered root.
    """
    text = f"{report.digest} {study.header['StudyInstanceUID']} {name}"
    return f"2.25.{uuid.uuid5(_NAMESPACE, text).int}"


def own_code(code: str, meaning: str | None = None) -> Any:
    """Return a code of our own table."""
    from highdicom import sr

    said = content.OWN[code] if meaning is None else meaning
    return sr.CodedConcept(code.replace("_", "-")[:_MEANING], SCHEME, said[:_MEANING])


def measured(one: content.Number, facts: mesh.Facts) -> Any:
    """Write a number with DICOM's code, LOINC's as in the FHIR bundle, or our own."""
    from highdicom import sr

    name = own_code(one.code, one.text)
    if one.code in content.DICOM:
        name = sr.CodedConcept(content.DICOM[one.code][0], "DCM", content.DICOM[one.code][1])
    elif (first := content.concept(one.code, facts)["coding"][0])["system"] == content.LOINC:
        name = sr.CodedConcept(first["code"], "LN", first["display"])
    return sr.Measurement(name=name, value=one.value, unit=ucum(one.ucum))


def ucum(code: str) -> Any:
    """Give a unit."""
    from highdicom import sr

    return sr.CodedConcept(code, "UCUM", {"1": "no units", "%": "percent"}.get(code, code))


def stamp(dataset: Any, report: content.Report) -> None:
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


def version_of(report: content.Report) -> str:
    """Version that made the result."""
    return str(report.signature.provenance.get("modalmotion", "unknown"))


SERIES_NUMBER: Final = 9101
"""Of the structured report; surfaces have the next one."""


def structured_report(report: content.Report, study: Study) -> Any:
    """Write a report as a Comprehensive SR, preliminary and unverified.

    Parameters
    ----------
    report : Report
    study : Study

    Returns
    -------
    pydicom.Dataset

    Raises
    ------
    ParameterError
        If the instance that the study was read from is of an unknown kind.
    """
    from highdicom import sr
    from highdicom.coding_schemes import CodingSchemeIdentificationItem

    try:
        written = sr.ComprehensiveSR(
            evidence=[study.dataset()],
            content=_content(report, study)[0],
            series_instance_uid=uid_of(report, study, "SR series"),
            series_number=SERIES_NUMBER,
            sop_instance_uid=uid_of(report, study, "SR"),
            instance_number=1,
            manufacturer="modalmotion",
            is_complete=True,
            series_description="Motion analysis (no medical device)",
            coding_schemes=[
                CodingSchemeIdentificationItem(designator=SCHEME, name="modalmotion's own codes")
            ],
        )
    except KeyError:
        raise errors.ParameterError(
            "The kind of the instance is not supported.",
            remedy="Send an image of the study, such as one of MR, CT or US.",
        ) from None
    stamp(written, report)
    return written


def _content(report: content.Report, study: Study) -> Any:
    from highdicom import sr
    from pydicom.sr.codedict import codes

    version = version_of(report)
    device = sr.DeviceObserverIdentifyingAttributes(
        uid=uid_of(report, study, "device"),
        name="modalmotion",
        manufacturer_name="modalmotion",
        model_name=f"modalmotion {version}",
    )
    context = sr.ObservationContext(
        observer_device_context=sr.ObserverContext(codes.DCM.Device, device)
    )
    return sr.MeasurementReport(
        observation_context=context,
        procedure_reported=own_code("analysis"),
        imaging_measurements=list(_groups(report, study)),
    )


def _groups(report: content.Report, study: Study) -> Iterator[Any]:
    from highdicom import sr

    numbers, facts = content.numbers_of(report), report.sequence.facts
    for name in ("volumes", "fit", "class", "deviation"):
        of_group = [measured(one, facts) for one in numbers.get(name, ())]
        said = [sr.QualitativeEvaluation(own_code("class"), _class(report))] * (name == "class")
        if of_group or said:
            yield sr.MeasurementsAndQualitativeEvaluations(
                tracking_identifier=sr.TrackingIdentifier(
                    uid=uid_of(report, study, f"tracking {name}"),
                    identifier=f"{report.sequence_id[:12]} {content.OWN[name]}",
                ),
                finding_type=own_code(name),
                measurements=of_group or None,
                qualitative_evaluations=said or None,
                source_images=_sources(study),
            )


def _class(report: content.Report) -> Any:
    answer = report.classification
    if answer is None:
        return own_code("not-asked", "No model was asked")
    if answer.label is None:
        return own_code("no-class", f"No class: {'; '.join(answer.flags) or 'inconclusive'}")
    return own_code("-".join(answer.label.split()), answer.label)


def _sources(study: Study) -> list[Any] | None:
    from highdicom import sr
    from pydicom.uid import UID

    kind = study.header["SOPClassUID"]
    if "Image Storage" not in UID(kind).name:
        return None
    return [
        sr.SourceImageForMeasurementGroup(
            referenced_sop_class_uid=kind,
            referenced_sop_instance_uid=study.header["SOPInstanceUID"],
        )
    ]


_STL_STORAGE: Final = "1.2.840.10008.5.1.4.1.1.104.3"


def surface_instance(
    report: content.Report, study: Study, frame: int, name: str, number: int
) -> Any:
    """Write the surface of a frame, as sent.

    Parameters
    ----------
    report : Report
        Whose coordinates are LPS mm: see `require_space`.
    study : Study
    frame : int
    name : str
        Such as "End diastole".
    number : int
        Of the instance in its series.

    Returns
    -------
    pydicom.Dataset
    """
    from pydicom.dataset import Dataset, FileDataset, FileMetaDataset
    from pydicom.uid import ExplicitVRLittleEndian

    uid = uid_of(report, study, f"STL {name}")
    meta = FileMetaDataset()
    meta.MediaStorageSOPClassUID = _STL_STORAGE
    meta.MediaStorageSOPInstanceUID = uid
    meta.TransferSyntaxUID = ExplicitVRLittleEndian
    meta.ImplementationClassUID = "2.25.247361850291147352840137524918603258176"
    written = FileDataset("", {}, file_meta=meta, preamble=b"\0" * 128)
    written.update(study.dataset())
    written.SOPClassUID, written.SOPInstanceUID = _STL_STORAGE, uid
    written.Modality = "M3D"
    written.SeriesInstanceUID = uid_of(report, study, "STL series")
    written.SeriesNumber, written.InstanceNumber = SERIES_NUMBER + 1, number
    written.SeriesDescription = "Surfaces of a motion analysis (no medical device)"
    space = study.header["FrameOfReferenceUID"] or uid_of(report, study, "space")
    written.FrameOfReferenceUID, written.PositionReferenceIndicator = space, ""
    stamp(written, report)
    written.AcquisitionDateTime = ""
    written.BurnedInAnnotation = "NO"
    written.DocumentTitle = f"{name.capitalize()}, frame {frame}"
    written.ConceptNameCodeSequence = []
    written.MIMETypeOfEncapsulatedDocument = "model/stl"
    source = Dataset()
    source.ReferencedSOPClassUID = study.header["SOPClassUID"]
    source.ReferencedSOPInstanceUID = study.header["SOPInstanceUID"]
    written.SourceInstanceSequence = [source]
    series = Dataset()
    series.SeriesInstanceUID = study.header["SeriesInstanceUID"]
    series.ReferencedInstanceSequence = [source]
    written.ReferencedSeriesSequence = [series]
    stl = write_stl(report.sequence.vertices[frame], report.sequence.faces, written.DocumentTitle)
    written.EncapsulatedDocumentLength = len(stl)
    written.EncapsulatedDocument = stl + b"\0" * (len(stl) % 2)
    written.MeasurementUnitsCodeSequence = [ucum("mm")]
    written.ModelModification = "NO"
    written.ModelMirroring = "NO"
    return written
