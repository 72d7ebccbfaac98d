"""What a report gathers."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta, timezone

import pytest
from norm_controls import beat

import modalmotion as mm
from modalmotion.errors import ParameterError
from modalmotion.norm import train_norm
from modalmotion.reports import quantities_of, report_of

BEAT = beat(1)
SIGNATURE = mm.modal_signature(BEAT, mm.SignatureParameters(modes=7))


def test_a_time_without_a_zone_is_refused() -> None:
    with pytest.raises(ParameterError, match="no zone"):
        report_of(SIGNATURE, BEAT, issued=datetime(2026, 1, 31))  # noqa: DTZ001
    east = datetime(2026, 1, 31, 13, tzinfo=timezone(timedelta(hours=1)))
    assert report_of(SIGNATURE, BEAT, issued=east).issued == datetime(2026, 1, 31, 12, tzinfo=UTC)


def test_parts_of_another_recording_are_refused() -> None:
    other = train_norm([beat(k) for k in range(20, 39)], "ours").deviation(beat(2))
    with pytest.raises(ParameterError, match="The deviation is of the sequence"):
        report_of(SIGNATURE, BEAT, issued=datetime.now(UTC), deviation=other)


def test_quantities_lie_in_their_intervals() -> None:
    found = quantities_of(report_of(SIGNATURE, BEAT, issued=datetime.now(UTC)))
    assert [one.name for one in found] == [
        "ejection_fraction",
        "end_diastolic_volume",
        "end_systolic_volume",
        "stroke_volume",
        "gls",
        "gcs",
        "gas",
        "sdi",
    ]
    assert all(one.low <= one.value <= one.high for one in found)
    assert {one.ucum for one in found} == {"%", "mL"}


def test_caveats_have_no_words_of_interfaces() -> None:
    sequence = BEAT.with_facts(mm.Facts(tracking="unknown"))
    signature = mm.modal_signature(sequence, mm.SignatureParameters(modes=7))
    caveats = report_of(signature, sequence, issued=datetime.now(UTC)).caveats
    assert any(note.startswith("Torsion and shear need") for note in caveats)
    assert not any("tracking=" in note or "--" in note for note in caveats)
