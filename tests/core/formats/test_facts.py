"""Facts in files, and over them."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
from facts_samples import FACTS
from hypothesis import given

from modalmotion import Facts, InputError, mesh_sequence, read_npz, simulate_ventricle, write_npz
from modalmotion.formats import ReadOptions, read_sequence, write_vtkhdf
from modalmotion.simulate import Acquisition

VERTICES = np.arange(24.0).reshape(2, 4, 3)


def _npz(**arrays: Any) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, vertices=VERTICES, **arrays)
    return buffer.getvalue()


@given(FACTS)
def test_facts_come_back_from_npz(facts: Facts) -> None:
    sequence = mesh_sequence(VERTICES, facts=facts)
    read = read_npz(write_npz(sequence))
    assert read.sequence.facts == facts
    assert read.sequence.id == sequence.id
    assert read.ignored == ()


def test_facts_are_read_as_a_sender_writes_them() -> None:
    read = read_npz(
        _npz(
            tracking="normal_displacement",
            handedness="right",
            coordinates="RAS",
            period=0.8,
            cavity="lv",
            modality="US",
            landmarks='{"apex": 1, "base": [0, 0.5, 2]}',
            covariates='{"age": 61, "sex": "f"}',
            meta="something else",
        )
    )
    assert read.ignored == ("meta",)
    assert read.sequence.facts == Facts(
        tracking="normal_displacement",
        handedness="right",
        coordinates="RAS",
        period=0.8,
        cavity="lv",
        modality="US",
        landmarks={"apex": 1, "base": (0, 0.5, 2)},
        covariates={"age": 61, "sex": "f"},
    )


@pytest.mark.parametrize(
    "arrays",
    [
        {"tracking": 1},
        {"tracking": "tissue"},
        {"tracking": ["material", "normal_displacement"]},
        {"period": "0.8"},
        {"period": np.nan},
        {"period": [0.8, 0.9]},
        {"period": -1},
        {"period": 0.4, "times": [0, 1]},
        {"coordinates": VERTICES},
        {"coordinates": "LPS", "handedness": "left"},
        {"landmarks": "{"},
        {"landmarks": '{"apex": 4}'},
        {"landmarks": '{"apex": [0, 0, NaN]}'},
        {"covariates": '{"age": 1, "age": 2}'},
        {"covariates": "[" * 100_000},
        {"modality": "x" * 41},
    ],
)
def test_a_bad_fact_is_refused_with_a_remedy(arrays: dict[str, Any]) -> None:
    with pytest.raises(InputError) as caught:
        read_npz(_npz(**arrays))
    assert caught.value.remedy


def test_options_go_over_the_file_and_say_so() -> None:
    data = _npz(tracking="normal_displacement", covariates='{"age": 61, "sex": "f"}')
    said = Facts(tracking="material", cavity="lv", covariates={"sex": "f"})
    read = read_sequence(data, ReadOptions(facts=said))
    assert read.sequence.facts == Facts(
        tracking="material", cavity="lv", covariates={"age": 61, "sex": "f"}
    )
    assert [note for note in read.notes if "another tracking" in note]
    assert not [note for note in read.notes if "covariates" in note]


def test_a_period_is_compared_with_the_times_that_are_stated() -> None:
    with pytest.raises(InputError, match="period"):
        read_sequence(_npz(period=0.8), ReadOptions(frame_interval=1.0))


def test_a_coordinate_system_that_a_file_names_is_a_fact() -> None:
    text = b"# SPACE=LPS\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
    read = read_sequence(text)
    assert read.coordinate_system == read.sequence.facts.coordinates == "LPS"


def test_formats_without_a_place_for_facts_lose_them() -> None:
    sequence = mesh_sequence(VERTICES, [[0, 1, 2]], facts=Facts(tracking="material"))
    assert read_sequence(write_vtkhdf(sequence)).sequence.facts == Facts()


def test_the_simulator_states_its_own() -> None:
    for is_closed in (False, True):
        beat = simulate_ventricle(
            grid=(6, 12), acquisition=Acquisition(n_frames=5, is_closed=is_closed)
        )
        assert beat.facts == Facts(
            tracking="material",
            handedness="right",
            period=beat.facts.period,
            cavity="lv",
            modality="simulated",
        )
        assert beat.facts.period is not None
        assert beat.span is not None
        assert beat.facts.period >= beat.span
