"""Reports as FHIR R4: of our profile, the same bytes, the same numbers as everywhere."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import jsonschema
import numpy as np
import pytest
from fhir_profile import PROFILE
from norm_controls import beat

import modalmotion as mm
from modalmotion.classification import classify
from modalmotion.clinical import clinical_readouts
from modalmotion.norm import train_norm
from modalmotion.reports import Report, fhir_bundle, fhir_json, quantities_of, report_of
from modalmotion.reports.content import LOINC, SYSTEM, code_systems
from modalmotion.reports.fhir import quantity
from modalmotion.simulate import MotionClass

ISSUED = datetime(2026, 1, 31, 12, tzinfo=UTC)


def report(sequence: mm.MeshSequence, **parts: Any) -> Report:
    signature = mm.modal_signature(sequence, mm.SignatureParameters(modes=7))
    return report_of(signature, sequence, issued=ISSUED, **parts)


def check(bundle: dict[str, Any]) -> None:
    jsonschema.validate(bundle, PROFILE)
    urls = {entry["fullUrl"] for entry in bundle["entry"]}
    assert len(urls) == len(bundle["entry"])
    for reference in _references(bundle):
        assert reference in urls, reference


def _references(value: Any) -> list[str]:
    if isinstance(value, dict):
        own = [value["reference"]] if "reference" in value else []
        return own + [r for one in value.values() for r in _references(one)]
    return [r for one in value for r in _references(one)] if isinstance(value, list) else []


def observations(bundle: dict[str, Any]) -> dict[str, dict[str, Any]]:
    found = [entry["resource"] for entry in bundle["entry"]]
    return {
        one["code"]["coding"][-1]["code"]: one
        for one in found
        if one["resourceType"] == "Observation"
    }


@pytest.fixture(scope="module")
def whole() -> Report:
    sequence = beat(5, MotionClass.HYPOKINESIA)
    facts = replace(sequence.facts, cavity="lv", modality="MR")
    sequence = replace(sequence, facts=facts)
    norm = train_norm([beat(seed) for seed in range(19)], "volunteers")
    return report(sequence, classification=classify(sequence), deviation=norm.deviation(sequence))


def unitless(sequence: mm.MeshSequence) -> mm.MeshSequence:
    return replace(sequence, unit=None)


def untimed(sequence: mm.MeshSequence) -> mm.MeshSequence:
    return replace(sequence, times=None, facts=replace(sequence.facts, period=None))


def uneven(sequence: mm.MeshSequence) -> mm.MeshSequence:
    assert sequence.times is not None
    return replace(sequence, times=sequence.times * (1 + 0.1 * sequence.times))


def flat(sequence: mm.MeshSequence) -> mm.MeshSequence:
    x, y = np.meshgrid(np.arange(6.0), np.arange(5.0), indexing="ij")
    z = np.sin(np.arange(8.0))[:, None, None] * np.cos(x)
    frames = np.stack([np.broadcast_to(x, z.shape), np.broadcast_to(y, z.shape), z], axis=-1)
    return mm.mesh_sequence(frames.reshape(8, 30, 3), grid=(6, 5), topology="plane")


@pytest.mark.parametrize("change", [None, unitless, untimed, uneven, flat])
def test_every_kind_of_result_is_of_the_profile(
    change: Callable[[mm.MeshSequence], mm.MeshSequence] | None,
) -> None:
    sequence = beat(5)
    bundle = fhir_bundle(report(sequence if change is None else change(sequence)))
    check(bundle)
    found = observations(bundle)
    assert ("volumes" in found) == (change is not flat)
    assert ("times" in found) == (change is uneven)
    assert "dataAbsentReason" in found["class"]


def test_a_whole_report_is_of_the_profile(whole: Report) -> None:
    bundle = fhir_bundle(whole)
    check(bundle)
    found = observations(bundle)
    assert {"volumes", "amplitudes", "fit", "volume-curve", "class", "deviation"} <= found.keys()
    # LOINC stands where cavity and modality are stated, and nowhere else.
    assert "http://loinc.org" in json.dumps(bundle)
    assert "http://loinc.org" not in json.dumps(fhir_bundle(report(beat(5))))
    assert "Not a medical device" in json.dumps(bundle)


def test_every_code_of_a_report_is_in_a_code_system(whole: Report) -> None:
    known = {
        (system["url"], one["code"]): one["display"]
        for system in code_systems()
        for one in system["concept"]
    }
    used = [one for one in _codings(fhir_bundle(whole)) if one["system"] in (SYSTEM, LOINC)]
    assert len(used) > 20
    for one in used:
        assert known[one["system"], one["code"]] == one["display"]


def _codings(value: Any) -> list[dict[str, str]]:
    if isinstance(value, dict):
        own = list(value["coding"]) if "coding" in value else []
        return own + [one for part in value.values() for one in _codings(part)]
    return [one for part in value for one in _codings(part)] if isinstance(value, list) else []


def test_the_same_report_is_the_same_bytes(whole: Report) -> None:
    assert fhir_json(whole) == fhir_json(whole)
    later = replace(whole, issued=datetime(2026, 2, 1, tzinfo=UTC))
    assert fhir_bundle(later)["id"] != fhir_bundle(whole)["id"]


def test_numbers_are_those_of_the_library(whole: Report) -> None:
    readouts = clinical_readouts(whole.signature, whole.sequence)
    found = observations(fhir_bundle(whole))
    values = {
        part["code"]["coding"][-1]["code"]: part["valueQuantity"]["value"]
        for part in found["volumes"]["component"]
    }
    assert values["ejection-fraction"] == readouts.curve.share
    assert values["end-systolic-volume"] == readouts.curve.end_systolic_volume * readouts.shown_in
    low, high = readouts.curve.share_range or (0, 0)
    assert (values["ejection-fraction-low"], values["ejection-fraction-high"]) == (low, high)
    data = found["amplitudes"]["valueSampledData"]
    numbers = np.array(data["data"].split(), dtype=np.float64)
    np.testing.assert_array_equal(numbers, whole.signature.amplitudes.ravel())
    assert data["dimensions"] == 21
    times = whole.signature.times
    assert times is not None
    assert data["period"] == pytest.approx(1000 * (times[1] - times[0]))
    assert {one.name for one in quantities_of(whole)} <= {key.replace("-", "_") for key in values}


@pytest.mark.parametrize("value", [0.00013600483273016104, 0.012345678901234567, 1.36e-7, 58.7])
def test_no_number_has_more_decimals_than_validators_read(value: float) -> None:
    held = quantity(value, "%", "%")["value"]
    assert held == pytest.approx(value, rel=1e-12)
    text = json.dumps(held)
    assert "e" in text or len(text.partition(".")[2]) <= 17


def spoil(bundle: dict[str, Any], name: str, **fields: Any) -> dict[str, Any]:
    spoilt = copy.deepcopy(bundle)
    observations(spoilt)[name].update(fields)
    return spoilt


def test_wrong_bundles_are_refused_by_the_same_check(whole: Report) -> None:
    bundle = fhir_bundle(whole)
    wrong = [
        spoil(bundle, "volumes", status="final"),
        spoil(bundle, "volumes", subject={"display": "Jane"}),
        spoil(bundle, "deviation", dataAbsentReason={"text": "none"}),
        spoil(bundle, "fit", component=[]),
        spoil(bundle, "amplitudes", valueSampledData={"data": "1 2"}),
        spoil(bundle, "class", issued="2026-01-31"),
        spoil(bundle, "fit", device={"reference": "Device/1"}),
        {**bundle, "type": "document"},
        {**bundle, "entry": []},
    ]
    for one in wrong:
        with pytest.raises(jsonschema.ValidationError):
            check(one)
    lost = copy.deepcopy(bundle)
    del lost["entry"][-2]
    with pytest.raises(AssertionError):
        check(lost)
