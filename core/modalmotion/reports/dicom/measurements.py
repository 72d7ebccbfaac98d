"""A report as a structured report of the template TID 1500 (PS3.16): Comprehensive SR."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from modalmotion.errors import ParameterError
from modalmotion.reports.codes import OWN
from modalmotion.reports.content import Report
from modalmotion.reports.dicom.identity import (
    SCHEME,
    code_of,
    own_code,
    stamp,
    ucum,
    uid_of,
    version_of,
)
from modalmotion.reports.dicom.source import Study
from modalmotion.reports.quantities import errors_of, quantities_of

SERIES_NUMBER: Final = 9101
"""Of the structured report; surfaces have the next one."""


def structured_report(report: Report, study: Study) -> Any:
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
    from highdicom.coding_schemes import CodingSchemeIdentificationItem
    from highdicom.sr import ComprehensiveSR

    try:
        written = ComprehensiveSR(
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
        raise ParameterError(
            "The kind of the instance is not supported.",
            remedy="Send an image of the study, such as one of MR, CT or US.",
        ) from None
    stamp(written, report)
    return written


def _content(report: Report, study: Study) -> Any:
    from highdicom.sr import (
        DeviceObserverIdentifyingAttributes,
        MeasurementReport,
        ObservationContext,
        ObserverContext,
    )
    from pydicom.sr.codedict import codes

    version = version_of(report)
    device = DeviceObserverIdentifyingAttributes(
        uid=uid_of(report, study, "device"),
        name="modalmotion",
        manufacturer_name="modalmotion",
        model_name=f"modalmotion {version}",
    )
    context = ObservationContext(observer_device_context=ObserverContext(codes.DCM.Device, device))
    return MeasurementReport(
        observation_context=context,
        procedure_reported=own_code("analysis"),
        imaging_measurements=list(_groups(report, study)),
    )


def _groups(report: Report, study: Study) -> Sequence[Any]:
    facts = report.sequence.facts
    groups = []
    quantities = quantities_of(report)
    if quantities:
        measured = []
        for one in quantities:
            measured.append(_measured(code_of(one.name, facts), one.value, one.ucum))
            for end, value in (("low", one.low), ("high", one.high)):
                meaning = f"{OWN[one.name]}: {OWN[end].lower()}"
                name = _own(f"{one.name}-{end}", meaning)
                measured.append(_measured(name, value, one.ucum))
        groups.append(_group(report, study, "volumes", measured))
    rms, largest = errors_of(report)
    fit = [
        _measured(own_code("rms_error"), rms, "mm"),
        _measured(own_code("max_error"), largest, "mm"),
    ]
    groups.append(_group(report, study, "fit", fit))
    groups.append(_class(report, study))
    if report.deviation is not None:
        p_values = [_measured(own_code("p"), report.deviation.p, "1")]
        p_values += [
            _measured(own_code("p", f"p-value of {one.name}, corrected"), one.p, "1")
            for one in report.deviation.groups
        ]
        groups.append(_group(report, study, "deviation", p_values))
    return groups


def _class(report: Report, study: Study) -> Any:
    from highdicom.sr import QualitativeEvaluation

    answer = report.classification
    if answer is None:
        said = _own("not-asked", "No model was asked")
        probabilities = []
    else:
        why = "; ".join(answer.flags) or "inconclusive"
        said = (
            _own("no-class", f"No class: {why}")
            if answer.label is None
            else _own("-".join(answer.label.split()), answer.label)
        )
        probabilities = [
            _measured(own_code("probability", f"Probability of {name}"), float(p), "1")
            for name, p in zip(answer.classes, answer.probabilities, strict=True)
        ]
    stated = [QualitativeEvaluation(own_code("class"), said)]
    return _group(report, study, "class", probabilities, stated)


def _own(code: str, meaning: str) -> Any:
    from highdicom.sr import CodedConcept

    return CodedConcept(code.replace("_", "-")[:64], SCHEME, meaning[:64])


def _measured(name: Any, value: float, unit: str) -> Any:
    from highdicom.sr import Measurement

    return Measurement(name=name, value=float(value), unit=ucum(unit))


def _group(
    report: Report, study: Study, name: str, measured: Sequence[Any], stated: Sequence[Any] = ()
) -> Any:
    from highdicom.sr import MeasurementsAndQualitativeEvaluations, TrackingIdentifier

    return MeasurementsAndQualitativeEvaluations(
        tracking_identifier=TrackingIdentifier(
            uid=uid_of(report, study, f"tracking {name}"),
            identifier=f"{report.sequence_id[:12]} {OWN[name]}",
        ),
        finding_type=own_code(name),
        measurements=list(measured) or None,
        qualitative_evaluations=list(stated) or None,
        source_images=_sources(study),
    )


def _sources(study: Study) -> list[Any] | None:
    from highdicom.sr import SourceImageForMeasurementGroup
    from pydicom.uid import UID

    kind = study.header["SOPClassUID"]
    if "Image Storage" not in UID(kind).name:
        return None
    return [
        SourceImageForMeasurementGroup(
            referenced_sop_class_uid=kind,
            referenced_sop_instance_uid=study.header["SOPInstanceUID"],
        )
    ]
