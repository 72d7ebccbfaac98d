"""All objects of a report, as files and as one zip. Needs pydicom and highdicom (extra `dicom`)."""

from __future__ import annotations

import io
import logging
import zipfile
from typing import Final

from modalmotion.errors import ParameterError, needs_extra
from modalmotion.facts import Facts
from modalmotion.formats.volumes.stack import unheard
from modalmotion.reports.content import Report
from modalmotion.reports.dicom.source import Study
from modalmotion.reports.moments import moments_of

# The earliest time in a zip.
_NO_DATE: Final = (1980, 1, 1, 0, 0, 0)


def dicom_instances(report: Report, study: Study) -> dict[str, bytes]:
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
    with needs_extra("dicom"):
        import highdicom  # noqa: F401 (its modules log from here on)
        import pydicom  # noqa: F401
    from modalmotion.reports.dicom.measurements import structured_report
    from modalmotion.reports.dicom.surfaces import surface_instance

    loggers = [name for name in logging.root.manager.loggerDict if name.startswith(_LIBRARIES)]
    # They log ids, and warn with the values of headers.
    with unheard(*loggers):
        written = {"report.dcm": structured_report(report, study)}
        # Points without triangles are not a surface.
        moments = moments_of(report) if len(report.sequence.faces) else []
        for number, (frame, name) in enumerate(moments, 1):
            file = f"{name.replace(' ', '-')}.dcm"
            written[file] = surface_instance(report, study, frame, name, number)
        files = {}
        for name, dataset in written.items():
            buffer = io.BytesIO()
            dataset.save_as(buffer, enforce_file_format=True)
            files[name] = buffer.getvalue()
    return files


def dicom_zip(report: Report, study: Study) -> bytes:
    """Write the objects of `dicom_instances` as one zip, the same bytes for the same objects."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in dicom_instances(report, study).items():
            archive.writestr(
                zipfile.ZipInfo(name, _NO_DATE), data, compress_type=zipfile.ZIP_DEFLATED
            )
    return buffer.getvalue()


def require_space(facts: Facts, unit: str | None) -> None:
    """Check that coordinates are patient coordinates of DICOM.

    Raises
    ------
    ParameterError
        If they are not stated to be LPS, in mm.
    """
    if facts.coordinates != "LPS":
        stated = "are not stated" if facts.coordinates == "unknown" else f"are {facts.coordinates}"
        raise ParameterError(
            f"The coordinates {stated}; an object of a study must be in LPS.",
            remedy="State coordinates=LPS if x goes to the patient's left, y to the back and z to "
            "the head, in the space of the study's images; otherwise convert the points first.",
            details={"fact": "coordinates"},
        )
    if unit != "mm":
        raise ParameterError(
            f"The unit is {unit or 'unknown'}; an object of a study must be in mm.",
            remedy="State unit=mm, or send the points in mm.",
            details={"fact": "unit"},
        )


_LIBRARIES: Final = ("highdicom", "pydicom")
