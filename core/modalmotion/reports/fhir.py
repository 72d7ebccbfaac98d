"""A report as a bundle of FHIR R4 resources: plain dictionaries, the same bytes every time."""

import json
import uuid
from collections.abc import Sequence
from html import escape
from typing import Any, Final, NamedTuple

import numpy as np

from modalmotion import clinical, norm
from modalmotion.reports.content import (
    ABSENT,
    CATEGORY,
    OWN,
    SYSTEM,
    UCUM,
    Number,
    Report,
    concept,
    length_unit,
    numbers_of,
    quantities_of,
)
from modalmotion.representation import Floats, probability
from modalmotion.signature.mode_names import direction_names

_DECIMALS: Final = 17

# The extension that replaces an element.
_ABSENT_HERE: Final = "http://hl7.org/fhir/StructureDefinition/data-absent-reason"

Resource = dict[str, Any]


def resource(key: uuid.UUID, kind: str, name: str) -> Resource:
    """Begin a resource, whose id follows from the key of the report and its name."""
    return {"resourceType": kind, "id": str(uuid.uuid5(key, name))}


def reference(kind: str, key: uuid.UUID, name: str) -> Resource:
    """Refer to a resource of the same report."""
    return {"reference": f"urn:uuid:{uuid.uuid5(key, name)}", "type": kind}


def narrative(*lines: str) -> Resource:
    """Write lines as XHTML."""
    body = "".join(f"<p>{escape(line, quote=False)}</p>" for line in lines)
    return {
        "status": "generated",
        "div": f'<div xmlns="http://www.w3.org/1999/xhtml">{body}</div>',
    }


def unstated(reason: str) -> Resource:
    """Write the reason for a missing element."""
    return {"extension": [{"url": _ABSENT_HERE, "valueCode": reason}]}


def quantity(value: float, unit: str, ucum: str) -> Resource:
    """Write a number with its unit, in words and as UCUM."""
    # Validators warn of more decimals; what is smaller is written with an exponent.
    held = round(float(value), _DECIMALS) if 1e-4 <= abs(value) < 0.1 else float(value)
    return {"value": held, "unit": unit, "system": UCUM, "code": ucum}


def sampled(values: Floats, unit: str, ucum: str, times: Floats | None) -> Resource:
    """Write rows of numbers as SampledData; the period is in ms, or 1 if times are unknown."""
    n = len(values)
    period = 1.0
    if times is not None and n > 1 and times[-1] > times[0]:
        period = float(1000.0 * (times[-1] - times[0]) / (n - 1))
    table = values.reshape(n, -1)
    return {
        "origin": {"value": 0.0, "unit": unit, "system": UCUM, "code": ucum},
        "period": period,
        "dimensions": table.shape[1],
        "data": " ".join(
            np.format_float_positional(value, trim="-") for value in table.ravel().tolist()
        ),
    }


def absent(code: str, text: str) -> Resource:
    """Write the reason for a missing value."""
    return {"dataAbsentReason": {"coding": [{"system": ABSENT, "code": code}], "text": text}}


NOBODY: Final = "Not stated"
"""Instead of a subject's name."""
NO_PERSON: Final = "No person: computed by the device"
"""Instead of a performer's name."""

_NAMESPACE: Final = uuid.uuid5(uuid.NAMESPACE_OID, SYSTEM)

# Tolerance of even spacing of frames, as a share of the usual step.
_EVEN: Final = 1e-3


def fhir_bundle(report: Report) -> Resource:
    """Write a report as a Bundle of the type collection.

    DiagnosticReport, Observations, Device, Provenance. All are `preliminary`: a person must confirm
    them. No subject is named.

    Parameters
    ----------
    report : Report

    Returns
    -------
    dict
        JSON values, in a fixed order.
    """
    key = uuid.uuid5(_NAMESPACE, report.digest)
    found = _found(report)
    observations = [_observation(key, report, one) for one in found]
    said = [line for one in found for line in one.lines]
    main = _diagnostic_report(key, report, observations, said)
    resources = [
        main,
        *observations,
        {**resource(key, "Device", "device"), **_device(report)},
        _provenance(key, report, [main, *observations]),
    ]
    return {
        "resourceType": "Bundle",
        "id": str(key),
        "type": "collection",
        "timestamp": report.issued.isoformat(),
        "entry": [{"fullUrl": f"urn:uuid:{one['id']}", "resource": one} for one in resources],
    }


def fhir_json(report: Report) -> bytes:
    """Write the bundle as UTF-8 JSON."""
    return json.dumps(fhir_bundle(report), ensure_ascii=False, indent=1, allow_nan=False).encode()


def _device(report: Report) -> Resource:
    version = report.signature.provenance.get("modalmotion", "unknown")
    return {
        "text": narrative(f"modalmotion {version}. {report.intended_use}"),
        "status": "active",
        "deviceName": [{"name": "modalmotion", "type": "model-name"}],
        "version": [{"value": version}],
        "note": [{"text": report.intended_use}],
    }


def _diagnostic_report(
    key: uuid.UUID, report: Report, results: Sequence[Resource], said: Sequence[str]
) -> Resource:
    return {
        **resource(key, "DiagnosticReport", "report"),
        "text": narrative(*said, *report.caveats, report.intended_use),
        "identifier": [{"system": f"{SYSTEM}:report", "value": report.digest}],
        "status": "preliminary",
        "code": concept("analysis"),
        "issued": report.issued.isoformat(),
        "result": [
            {"reference": f"urn:uuid:{one['id']}", "type": "Observation"} for one in results
        ],
        "conclusion": " ".join([*said, report.intended_use]),
    }


class Found(NamedTuple):
    """Content of one Observation.

    Parameters
    ----------
    name : str
        Code of `codes.OWN`.
    lines : list of str
        In words.
    content : dict
        Its value, components and notes.
    """

    name: str
    lines: list[str]
    content: Resource


def _found(report: Report) -> list[Found]:
    numbers = numbers_of(report)
    found = [_amplitudes(report), _fit(report, numbers["fit"])]
    if report.readouts is not None:
        found = [_volumes(report, numbers["volumes"]), *found, _volume_curve(report.readouts)]
    times = report.signature.times
    if times is not None and len(times) > 2:
        steps = np.diff(times)
        if np.ptp(steps) > _EVEN * np.median(steps):
            found.append(_times(times))
    found.append(_class(report, numbers.get("class", ())))
    if report.deviation is not None:
        found.append(_deviation(report, report.deviation, numbers["deviation"]))
    return found


def _observation(key: uuid.UUID, report: Report, found: Found) -> Resource:
    return {
        **resource(key, "Observation", found.name),
        "text": narrative(*found.lines),
        "status": "preliminary",
        "category": [{"coding": [{"system": CATEGORY, "code": "imaging", "display": "Imaging"}]}],
        "code": concept(found.name, report.sequence.facts),
        # Subject, time and performer are added by the receiver: no name or date is known here.
        "subject": {**unstated("unknown"), "display": NOBODY},
        "_effectiveDateTime": unstated("unknown"),
        "issued": report.issued.isoformat(),
        "performer": [{**unstated("not-applicable"), "display": NO_PERSON}],
        **found.content,
        "device": reference("Device", key, "device"),
    }


def _component(report: Report, one: Number) -> Resource:
    code = concept(one.code, report.sequence.facts, one.text)
    return {"code": code, "valueQuantity": quantity(one.value, one.unit, one.ucum)}


def _volumes(report: Report, numbers: Sequence[Number]) -> Found:
    lines = [
        f"{OWN[one.name]} {one.value:.1f} {one.unit} ({one.low:.1f} to {one.high:.1f})."
        for one in quantities_of(report)
    ]
    return Found("volumes", lines, {"component": [_component(report, one) for one in numbers]})


def _amplitudes(report: Report) -> Found:
    signature = report.signature
    unit, ucum = length_unit(signature.unit)
    directions = direction_names(signature)
    n = signature.amplitudes.shape[1] * len(directions)
    labels = ", ".join(f"{label} {way}" for label in signature.modes.labels for way in directions)
    line = f"{n} modal amplitudes per frame, in {unit}, over {signature.n_frames} frames."
    text = "" if signature.times is not None else " Times are unknown: one period is one frame."
    return Found(
        "amplitudes",
        [line + text],
        {
            "valueSampledData": sampled(signature.amplitudes, unit, ucum, signature.times),
            "note": [{"text": f"Order within a frame: {labels}."}],
        },
    )


def _volume_curve(readouts: clinical.ClinicalReadouts) -> Found:
    unit, ucum = ("ml", "mL") if readouts.unit is not None else ("cubed length units", "1")
    volumes = readouts.stated.volumes * readouts.shown_in
    return Found(
        "volume_curve",
        [f"Volume in each of {len(volumes)} frames, in {unit}."],
        {"valueSampledData": sampled(volumes, unit, ucum, readouts.times)},
    )


def _times(times: Floats) -> Found:
    return Found(
        "times",
        ["The frames are uneven in time; their times are given here."],
        {"valueSampledData": sampled(1000.0 * times, "ms", "ms", times)},
    )


def _fit(report: Report, numbers: Sequence[Number]) -> Found:
    rms, most = numbers
    line = f"The error of the modes is {rms.value:.3g} {rms.unit} (RMS), at most {most.value:.3g}"
    components = [_component(report, one) for one in numbers]
    return Found("fit", [f"{line} {most.unit}."], {"component": components})


def _class(report: Report, numbers: Sequence[Number]) -> Found:
    answer = report.classification
    if answer is None:
        nothing = absent("not-asked", "No model was asked.")
        return Found("class", ["No class was asked for."], nothing)
    method = {"method": {"text": f"model {answer.model}, id {answer.model_id}"}}
    if answer.label is None:
        why = "; ".join(answer.flags) or "inconclusive"
        return Found("class", [f"No class of motion: {why}."], {**absent("unknown", why), **method})
    line = f"Class of motion: {answer.label} (probability {probability(answer.probability)})."
    code = "-".join(answer.label.split())
    coding = [{"system": f"{SYSTEM}:class", "code": code, "display": answer.label}]
    content = {
        "valueCodeableConcept": {"coding": coding, "text": answer.label},
        **method,
        "component": [_component(report, one) for one in numbers],
    }
    return Found("class", [line], content)


def _deviation(report: Report, one: norm.Deviation, numbers: Sequence[Number]) -> Found:
    content: Resource = {"valueQuantity": quantity(one.p, "1", "1")}
    if len(numbers) > 1:
        content["component"] = [_component(report, number) for number in numbers[1:]]
    content["method"] = {"text": f"norm {one.norm}, id {one.norm_id}"}
    verdict = "Deviates from" if one.deviates else "Lies within"
    line = f"{verdict} the {one.n_controls} controls of {one.norm}: p = {one.p:.3g}."
    return Found("deviation", [line], content)


def _provenance(key: uuid.UUID, report: Report, targets: Sequence[Resource]) -> Resource:
    signature = report.signature
    entities = [("sequence", signature.sequence_id), ("parameters", signature.parameters.key)]
    if report.classification is not None:
        entities.append(("model", report.classification.model_id))
    if report.deviation is not None:
        entities.append(("norm", report.deviation.norm_id))
    return {
        **resource(key, "Provenance", "provenance"),
        "text": narrative(f"Made by {report.versions}.", *(f"{a} {b}" for a, b in entities)),
        "target": [{"reference": f"urn:uuid:{one['id']}"} for one in targets],
        "recorded": report.issued.isoformat(),
        "agent": [{"who": reference("Device", key, "device")}],
        "entity": [
            {
                "role": "source",
                "what": {"identifier": {"system": f"{SYSTEM}:{name}", "value": value}},
            }
            for name, value in entities
        ],
    }
