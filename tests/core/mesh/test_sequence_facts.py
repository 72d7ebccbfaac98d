"""Facts ride with a sequence and are no part of what it is."""

from __future__ import annotations

import numpy as np
import pytest
from facts_samples import FACTS
from hypothesis import given

from modalmotion import Facts, MeshSequence, ParameterError, mesh_sequence
from modalmotion.mesh import NO_FACTS
from modalmotion.mesh.sequence import sequence_from_hdf5, sequence_to_hdf5

VERTICES = np.arange(24.0).reshape(2, 4, 3)

# Ids that 0.1.0 gave.
KNOWN_IDS = {
    "mesh": "c30c07f700f599a7b7ce1511021e08298250cebb0e07c6e9b4a4d7237048af3c",
    "lattice": "1a14782c85a356df16dd891401d10566c4455a891f23e1b891a0ce48b07e8afd",
}


def _samples() -> dict[str, MeshSequence]:
    faces = [[0, 1, 2], [0, 2, 3]]
    return {
        "mesh": mesh_sequence(VERTICES, faces, times=[0, 0.5], unit="mm"),
        "lattice": mesh_sequence(VERTICES + 0.1, grid=(2, 2), topology="plane"),
    }


def test_nothing_is_known_by_default_and_ids_are_those_of_before() -> None:
    for name, sequence in _samples().items():
        assert sequence.facts == NO_FACTS
        assert sequence.id == KNOWN_IDS[name]


@given(FACTS)
def test_an_id_does_not_depend_on_facts(facts: Facts) -> None:
    for name, sequence in _samples().items():
        stated = sequence.with_facts(facts)
        assert stated.facts == facts
        assert stated.id == KNOWN_IDS[name]
        assert stated.with_unit("cm").facts == facts


@given(FACTS)
def test_facts_come_back_from_hdf5(facts: Facts) -> None:
    sequence = _samples()["mesh"].with_facts(facts)
    again = sequence_from_hdf5(sequence_to_hdf5(sequence))
    assert again.facts == facts
    assert again.id == sequence.id


def test_facts_are_checked_against_the_arrays() -> None:
    sequence = _samples()["mesh"]
    for facts in (Facts(period=0.4), Facts(landmarks={"apex": 4})):
        with pytest.raises(ParameterError):
            sequence.with_facts(facts)
    with pytest.raises(ParameterError, match="vertex 4"):
        mesh_sequence(VERTICES, facts=Facts(landmarks={"apex": 4}))
