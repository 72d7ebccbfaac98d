"""Which controls make a norm."""

from __future__ import annotations

from dataclasses import replace

import pytest
from norm_controls import beat

from modalmotion.classification import TrainingCase
from modalmotion.errors import ModalMotionError, ParameterError
from modalmotion.norm import Norm, train_norm
from modalmotion.progress import Progress
from modalmotion.simulate import MotionClass

BEATS = [beat(seed) for seed in range(9)]


def test_any_form_of_a_recording_is_a_control() -> None:
    plain = train_norm(BEATS, "volunteers")
    named = train_norm(
        [TrainingCase(one, "", f"S{k}", f"{k}.npz") for k, one in enumerate(BEATS)], "named"
    )
    assert isinstance(plain, Norm)
    assert [c.subject for c in named.controls] == [f"S{k}" for k in range(9)]
    assert plain.as_json()["groups"] == named.as_json()["groups"]
    assert plain.as_json()["has_volumes"]
    assert "With 9 controls no p-value is below 1/10" in plain.notes[0]


def test_too_few_or_one_person_twice_are_refused() -> None:
    with pytest.raises(ParameterError, match="A norm of 8 controls") as few:
        train_norm(BEATS[:8], "few")
    assert "at least 9" in few.value.remedy
    with pytest.raises(ParameterError, match="case 9 and case 0 are recordings of one"):
        train_norm([*BEATS, BEATS[0]], "twice")
    twice = [TrainingCase(one, "", f"S{k // 2}") for k, one in enumerate(BEATS)]
    with pytest.raises(ParameterError, match="case 1 and case 0"):
        train_norm(twice, "twice")


def test_what_is_no_recording_is_named() -> None:
    with pytest.raises(ParameterError, match="Case 3 is a str"):
        train_norm([*BEATS[:3], "beat.npz"], "words")
    with pytest.raises(ParameterError, match="cannot be called"):
        train_norm(BEATS, "Our Norm")
    still = replace(BEATS[0], vertices=BEATS[0].vertices[:1], times=None)
    with pytest.raises(ModalMotionError, match="one frame"):
        train_norm([*BEATS, still], "still")


def test_points_that_slide_are_read_by_normal_displacements() -> None:
    sliding = [
        replace(one, facts=replace(one.facts, tracking="normal_displacement")) for one in BEATS
    ]
    norm = train_norm(sliding, "contours")
    assert norm.readable.parameters.kind == "normal_displacement"
    own = beat(52, MotionClass.HYPOKINESIA)
    own = replace(own, facts=replace(own.facts, tracking="normal_displacement"))
    assert norm.deviation(own, level=0.1).p <= 0.2


def test_progress_is_told() -> None:
    told: list[Progress] = []
    train_norm(BEATS, "told", progress=told.append)
    assert told == [Progress(k + 1, 9) for k in range(9)]
