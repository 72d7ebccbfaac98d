"""What is read of a ventricle beside its volume."""

from __future__ import annotations

import json

import pytest
from viewed_surfaces import viewed

from modalmotion.clinical import clinical_readouts
from modalmotion.clinical.ventricle import VentricleReadouts, ventricle_json, ventricle_readouts
from modalmotion.mesh import Facts


def read(name: str, facts: Facts) -> VentricleReadouts:
    sequence, signature = viewed(name)
    readouts = clinical_readouts(signature, sequence)
    return ventricle_readouts(signature, sequence.with_facts(facts), readouts)


def test_a_tracked_ventricle_has_all_and_json_takes_it() -> None:
    result = read("cup", Facts(tracking="material", period=1.0))
    assert result.reasons == ()
    plain = json.loads(json.dumps(ventricle_json(result), allow_nan=False))
    assert plain["rates"]["heart_rate"] == pytest.approx(60.0)
    assert len(plain["segments"]["percent"][0]) == 4
    assert [one["name"] for one in plain["strain"]["figures"][:3]] == ["GLS", "GCS", "GAS"]
    assert plain["strain"]["figures"][0]["end_systolic"]["low"] <= 0.0
    assert plain["per_mode"]["names"][3] == "GLS"


def test_what_is_not_there_is_null_and_has_a_reason() -> None:
    result = read("torus", Facts())
    assert (result.regions, result.strain) == (None, None)
    assert result.rates is not None
    assert any("torus" in reason for reason in result.reasons)
    assert any("topology=cup" in reason for reason in result.reasons)
    assert ventricle_json(result)["strain"] is None
