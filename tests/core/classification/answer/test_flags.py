"""Each thing that is wrong with a recording has its flag, its words and its remedy."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from altered_beats import ALTERED
from classify_samples import curves, curves_model

from modalmotion.classification import FLAGS, classify
from modalmotion.errors import ModeCountError
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.signature.making import ModalSignature
from modalmotion.simulate import MotionClass, simulate_cohort, simulate_ventricle

ORDINARY = (MotionClass.NORMAL, MotionClass.AKINESIA)


@cache
def beats(n: int, seed: int, classes: tuple[MotionClass, ...]) -> list[MeshSequence]:
    rng = np.random.default_rng(seed)
    cases = simulate_cohort(-(-n // len(classes)), rng=rng, classes=classes)
    return [case.sequence for case in cases]


def rates(kind: str, n: int, seed: int, *, any_class: bool = False) -> tuple[float, float]:
    """Share of recordings that get no class, and of these with the flag that names it."""
    rng = np.random.default_rng(seed)
    alter, names = ALTERED[kind]
    classes = tuple(MotionClass) if any_class else ORDINARY
    flagged, named = [], []
    for beat in beats(n, seed, classes):
        answer = classify(alter(beat, rng))
        flagged.append(bool(answer.flags))
        assert set(answer.flags) <= set(FLAGS)
        if answer.flags:
            named.append(answer.flags[0] in names)
            assert answer.label is None
            assert len(answer.notes) >= len(answer.flags)
    return float(np.mean(flagged)), float(np.mean(named))


@pytest.mark.every(3)
@pytest.mark.parametrize("kind", ALTERED)
def test_what_is_wrong_is_named(kind: str) -> None:
    flagged, named = rates(kind, 8, 90)
    assert flagged >= 7 / 8
    assert named >= 6 / 8


@pytest.mark.soak
@pytest.mark.parametrize("kind", ALTERED)
def test_hundreds_of_each_kind_are_flagged(kind: str) -> None:
    flagged, named = rates(kind, 200, 91)
    assert flagged >= 0.95
    assert named >= 0.8


def test_a_flag_says_what_to_do() -> None:
    rng = np.random.default_rng(95)
    beat = next(simulate_cohort(1, rng=rng, classes=(MotionClass.NORMAL,))).sequence
    texts = {
        "size x1000": "Check the unit",
        "mirrored": "State the handedness",
        "time reversed": "Check the order",
        "two beats": "Cut out one cycle",
        "motion x3": "Check the scale",
    }
    for kind, text in texts.items():
        note = classify(ALTERED[kind][0](beat, rng)).notes[0]
        assert note.startswith("No class: ")
        assert text in note
        assert note.endswith(".")


def test_deviations_are_named_and_too_large_ones_refused() -> None:
    motion = curves(12)[0].motion
    assert isinstance(motion, ModalSignature)
    plain = classify(motion, curves_model())
    for share, text in ((0.05, "are 5% of them."), (0.5, "are 50% of them, which the prob")):
        sure = replace(motion, amplitude_deviations=share * np.abs(motion.amplitudes))
        answer = classify(sure, curves_model())
        assert any(text in note for note in answer.notes)
        assert answer.probabilities == pytest.approx(plain.probabilities)
    unsure = replace(motion, amplitude_deviations=1.5 * np.abs(motion.amplitudes))
    answer = classify(unsure, curves_model())
    assert (answer.flags, answer.label) == (("undetermined",), None)
    assert "1.5 times as large as they are" in answer.notes[0]
    assert not any("standard deviations" in note for note in plain.notes)


def test_training_cases_are_not_strange() -> None:
    answers = [classify(case.motion, curves_model()) for case in curves(12)]
    assert not any(answer.flags for answer in answers)


def test_a_size_without_a_unit_is_not_compared_with_one_in_mm() -> None:
    rng = np.random.default_rng(94)
    beat = next(simulate_cohort(1, rng=rng, classes=(MotionClass.NORMAL,))).sequence

    def sized(factor: float, unit: str | None) -> MeshSequence:
        return replace(beat, vertices=factor * beat.vertices, unit=unit)

    assert classify(sized(1000.0, "um")).label == classify(beat).label
    assert classify(sized(1000.0, "mm")).flags == ("other size",)
    assert classify(sized(1000.0, None)).label == classify(beat).label


def test_a_lattice_of_too_few_nodes_gets_no_class_or_a_way_to_one() -> None:
    coarse = classify(simulate_ventricle(grid=(4, 4)))
    assert coarse.flags == ("unreadable",)
    assert "too few nodes" in coarse.notes[0]
    with pytest.raises(ModeCountError, match="The model reads 13 modes") as caught:
        classify(simulate_ventricle(grid=(2, 4)))
    assert "finer mesh" in caught.value.remedy
