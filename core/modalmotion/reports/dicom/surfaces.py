"""Surfaces as Encapsulated STL (PS3.3, A.85.3), in the space of the study."""

from __future__ import annotations

from typing import Any, Final

from modalmotion.formats.stl import write_stl
from modalmotion.reports.content import Report
from modalmotion.reports.dicom.identity import stamp, ucum, uid_of
from modalmotion.reports.dicom.measurements import SERIES_NUMBER
from modalmotion.reports.dicom.source import Study

_STL_STORAGE: Final = "1.2.840.10008.5.1.4.1.1.104.3"


def surface_instance(report: Report, study: Study, frame: int, name: str, number: int) -> Any:
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
    space = study.frame_of_reference or uid_of(report, study, "space")
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
