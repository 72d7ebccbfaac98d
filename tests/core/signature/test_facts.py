"""A fact that is read is part of a result's key, and one that is not read is no part of it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from modalmotion import (
    Facts,
    ParameterError,
    SignatureParameters,
    make_template,
    modal_signature,
    reconstruct,
    simulate_ventricle,
)
from modalmotion.mesh import NO_FACTS
from modalmotion.signature.hdf5 import signature_from_hdf5, signature_to_hdf5
from modalmotion.signature.making import resolve_parameters
from modalmotion.simulate import Acquisition
from modalmotion.template import GivenLandmarks, template_id

BEAT = simulate_ventricle(grid=(8, 16), acquisition=Acquisition(n_frames=4))
LATTICE = BEAT.with_facts(NO_FACTS)
MESH = replace(LATTICE, grid=None)

# Those that the template of a cup reads, and all others.
READ: dict[str, Any] = {"apex": 0, "theta_zero": (30.0, 0.0, 0.0)}
NOT_READ = Facts(
    tracking="normal_displacement",
    handedness="right",
    coordinates="RAS",
    period=9.0,
    cavity="rv",
    modality="US",
    landmarks={"corners": (0, 1, 2, 3), "RV insertion": 5},
    covariates={"age": 61},
)


def _key(facts: Facts, sequence: Any = MESH, **asked: Any) -> str:
    return resolve_parameters(sequence.with_facts(facts), SignatureParameters(**asked)).key


def test_facts_that_nothing_reads_leave_key_and_template_as_they_were() -> None:
    assert _key(NOT_READ) == _key(NO_FACTS) == SignatureParameters().key
    stated = MESH.with_facts(NOT_READ)
    assert make_template(stated).id == make_template(MESH).id
    one, other = modal_signature(stated), modal_signature(MESH)
    assert np.array_equal(one.amplitudes, other.amplitudes)
    assert one.parameters == other.parameters
    assert (one.facts, other.facts) == (NOT_READ, NO_FACTS)


@pytest.mark.parametrize("name", READ)
def test_a_landmark_is_read_and_part_of_the_key(name: str) -> None:
    facts = Facts(landmarks={name: READ[name]})
    given = GivenLandmarks(**{name: READ[name]})
    assert _key(facts) == SignatureParameters(landmarks=given).key != _key(NO_FACTS)
    stated = MESH.with_facts(facts)
    as_fact, as_asked = make_template(stated), make_template(MESH, landmarks=given)
    assert as_fact.id == template_id(stated) == as_asked.id != make_template(MESH).id
    one = modal_signature(stated)
    other = modal_signature(MESH, SignatureParameters(landmarks=given))
    assert np.array_equal(one.amplitudes, other.amplitudes)
    assert (one.parameters, one.template_id) == (other.parameters, other.template_id)
    assert one.landmarks is not None
    assert one.landmarks.given == (name,)


def test_a_landmark_that_is_asked_for_goes_over_the_stated_one() -> None:
    asked = GivenLandmarks(apex=3)
    assert (
        _key(Facts(landmarks={"apex": 0}), landmarks=asked)
        == SignatureParameters(landmarks=asked).key
    )


@pytest.mark.parametrize(
    ("sequence", "asked"),
    [
        (LATTICE, {}),
        (MESH, {"topology": "mesh"}),
        (MESH, {"template": "0" * 64}),
        (MESH, {"topology": "plane"}),
    ],
    ids=["lattice", "spring modes", "named template", "another topology"],
)
def test_what_reads_no_landmark_keeps_its_key(sequence: Any, asked: dict[str, Any]) -> None:
    facts = Facts(landmarks=READ)
    assert _key(facts, sequence, **asked) == SignatureParameters(**asked).key


def test_what_a_found_topology_has_no_use_for_is_refused_with_a_remedy_that_works() -> None:
    unnamed = replace(MESH, topology=None)
    facts = Facts(landmarks={"corners": (0, 1, 2, 3)})
    with pytest.raises(ParameterError, match="'corners' means nothing on a c") as caught:
        modal_signature(unnamed.with_facts(facts))
    assert "remove it there" in caught.value.remedy
    modal_signature(unnamed.with_facts(NO_FACTS))


def test_surfaces_come_back_whatever_the_facts_say_by_now() -> None:
    signature = modal_signature(MESH.with_facts(Facts(landmarks=READ)))
    again = reconstruct(signature, MESH)
    assert np.array_equal(again, reconstruct(signature, MESH.with_facts(Facts(landmarks=READ))))
    assert np.array_equal(
        again, reconstruct(signature, MESH.with_facts(Facts(landmarks={"base": 9})))
    )


def test_facts_ride_in_the_file_of_a_signature() -> None:
    for facts in (NO_FACTS, NOT_READ):
        signature = modal_signature(MESH.with_facts(facts))
        assert signature_from_hdf5(signature_to_hdf5(signature)).facts == facts
