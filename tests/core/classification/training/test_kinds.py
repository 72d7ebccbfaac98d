"""Which kind of signature a model of one's own reads."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any, cast

import numpy as np
import pytest
from classify_samples import curve

from modalmotion.classification import Model, TrainingCase, TrainingOptions, train
from modalmotion.classification.training.fold_fit import HeldOut, Losses
from modalmotion.classification.training.kinds import better, collect_kinds
from modalmotion.facts import facts_from_texts
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.signature.making import SignatureKind, modal_signature
from modalmotion.simulate import MotionClass, simulate_cohort

QUICK = TrainingOptions(
    modes=7, estimator="linear", repetitions=1, card="quick", further=False, folds=3
)
BOTH = [SignatureKind.MATERIAL, SignatureKind.OFFSET]


@cache
def beats(
    tracking: str = "unknown",
    n: int = 6,
    classes: tuple[MotionClass, ...] = (MotionClass.NORMAL, MotionClass.REDUCED_TORSION),
) -> tuple[TrainingCase, ...]:
    rng = np.random.default_rng(4)
    cases = simulate_cohort(
        n, rng=rng, classes=classes, noise=0.1, n_frames=(8, 8), triangle_share=0.0
    )
    return tuple(
        TrainingCase(
            case.sequence.with_facts(facts_from_texts({"tracking": tracking})),
            str(case.label),
            str(number),
        )
        for number, case in enumerate(cases)
    )


@cache
def twist_model() -> Model:
    return train(beats(), "twist", QUICK)


def turned_at_random(case: TrainingCase, rng: np.random.Generator) -> TrainingCase:
    """Name the vertices of each ring anew in every frame: the surface is the same."""
    sequence = case.motion
    assert isinstance(sequence, MeshSequence)
    assert sequence.grid is not None
    rows, columns = sequence.grid
    cells = sequence.vertices.astype(np.float64).reshape(-1, rows, columns, 3)
    # By a sixth of a turn at most, which leaves a mean shape that is narrower.
    most = columns // 6
    steps = rng.integers(-most, most + 1, size=(len(cells), rows))
    turned = [
        [np.roll(ring, step, axis=0) for ring, step in zip(frame, by_ring, strict=True)]
        for frame, by_ring in zip(cells, steps, strict=True)
    ]
    vertices = np.array(turned).reshape(sequence.vertices.shape)
    return replace(case, motion=replace(sequence, vertices=vertices))


def kinds(cases: tuple[TrainingCase, ...], options: TrainingOptions = QUICK) -> list[str]:
    return [str(table.example.kind) for table in collect_kinds(cases, None, options)]


def test_what_all_recordings_state_is_read() -> None:
    assert kinds(beats("material", 2)) == ["material"]
    assert kinds(beats("offset", 2)) == ["offset"]
    assert kinds(beats("unknown", 2)) == ["material", "offset"]
    for kind in BOTH:
        assert kinds(beats("unknown", 2), replace(QUICK, kind=kind)) == [kind]


def test_progress_counts_each_case_once_where_both_kinds_are_read() -> None:
    said: list[str] = []
    train(beats("unknown", 2), "heard", QUICK, lambda share, text: said.append(text))
    reading = list(dict.fromkeys(text for text in said if text.startswith("reading ")))
    expected = [f"reading case {k} of 4" for k in range(1, 5)]
    assert reading == [*expected, "reading the offsets of all cases"]


def test_shapes_without_offsets_are_read_as_displacements() -> None:
    rng = np.random.default_rng(1)
    cases = [TrainingCase(curve(label, rng), label) for label in ("tip", "back") * 4]
    assert kinds(tuple(cases)) == ["material"]


@pytest.mark.thorough
def test_the_kind_that_predicts_better_is_read_and_said() -> None:
    # Only displacements show twist.
    model = twist_model()
    assert model.signature_parameters.kind == SignatureKind.MATERIAL
    assert model.card.options["kind"] == "material"
    note = next(note for note in model.card.notes if "Both kinds of signature" in note)
    assert "model reads material" in note
    chosen = [name for fold in model.card.fold_choices for name, _ in fold["choices"]]
    assert all(name.startswith(("material: ", "offset: ")) for name in chosen)


def test_offsets_are_read_where_points_follow_nothing() -> None:
    rng = np.random.default_rng(2)
    cases = [
        turned_at_random(case, rng)
        for case in beats("unknown", 8, (MotionClass.NORMAL, MotionClass.HYPOKINESIA))
    ]
    model = train(cases, "sliding", QUICK)
    assert model.signature_parameters.kind == SignatureKind.OFFSET
    (note,) = (note for note in model.card.notes if "model reads offset" in note)
    assert "do not compare them with the card's log loss" in note
    assert model.card.auc is not None
    assert model.card.auc >= 0.7


@pytest.mark.thorough
def test_signatures_of_both_kinds_are_weighed_as_their_sequences_are() -> None:
    sets = []
    for kind in BOTH:
        parameters = replace(QUICK, kind=kind).signature_parameters
        sets.append(
            [
                replace(case, motion=modal_signature(case.motion, parameters))
                for case in beats()
                if isinstance(case.motion, MeshSequence)
            ]
        )
    own = train(sets[0], "twist", QUICK, offsets=sets[1])
    assert own.id == twist_model().id
    alone = train(sets[1], "offsets alone", QUICK)
    assert alone.signature_parameters.kind == SignatureKind.OFFSET


def test_there_is_a_kind_of_that_name() -> None:
    with pytest.raises(ValueError, match="kind"):
        TrainingOptions(kind="both")


@pytest.mark.parametrize(("gain", "place"), [(0.0, 0), (0.05, 0), (0.5, 1), (np.nan, 0)])
def test_offsets_must_gain_more_than_one_standard_error(gain: float, place: int) -> None:
    rng = np.random.default_rng(3)
    groups = np.arange(40) // 2
    first = rng.uniform(0.5, 1.0, 40)
    second = first - gain + 0.6 * np.repeat(rng.choice([-1.0, 1.0], 20), 2)
    second -= (second - first).mean() + gain
    answers = [
        HeldOut(np.zeros((0, 2)), cast("Any", None), (), Losses(losses, groups))
        for losses in (first, second)
    ]
    assert better(answers) == place
