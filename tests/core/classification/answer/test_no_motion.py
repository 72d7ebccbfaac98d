"""Models that read no motion: they say so, and nothing of how it would have been read."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from classify_samples import TWO, small_model

from modalmotion.classification import Model, TrainingCase, TrainingOptions, classify, train
from modalmotion.classification.model.markdown import card_markdown
from modalmotion.cli.model_texts import card_lines
from modalmotion.simulate import simulate_cohort

ALONE = "The model reads the volume alone, not the motion of the surface."


@cache
def beats() -> tuple[TrainingCase, ...]:
    drawn = simulate_cohort(
        5, rng=np.random.default_rng(3), classes=TWO, n_frames=(8, 8), triangle_share=0.0
    )
    return tuple(TrainingCase(c.sequence, str(c.label), str(k)) for k, c in enumerate(drawn))


@cache
def volume_model() -> Model:
    return train(beats(), "volume", TrainingOptions(modes=7, repetitions=1, card="quick", folds=3))


def test_the_card_says_what_is_read_and_not_how_motion_would_have_been() -> None:
    model = volume_model()
    assert not model.reads_motion
    assert ALONE in model.card.notes
    assert not any("Both kinds of signature" in note for note in model.card.notes)
    assert model.notes == {"": ()}
    said = card_lines(model.name, model.id, model.card)
    assert "\nReads: volume (weight 1.00)\n" in said
    page = card_markdown(model.name, model.id, model.card)
    assert "\nReads: volume (weight 1.00)\n" in page

    both = tuple((name, 0.25) for name in "abcd")
    several = replace(model.card, options={"features": both}).reads
    assert several == (
        "a (weight 0.25) and b (weight 0.25) and c (weight 0.25) and "
        "1 further choice of features, each of less weight"
    )


def test_an_answer_says_why_no_mode_explains_it() -> None:
    answer = classify(beats()[0].motion, volume_model())
    assert answer.label is not None
    assert answer.explanation == ()
    place = answer.notes.index(ALONE)
    assert answer.notes[place + 1] == "So no mode of the surface explains the answer."
    assert not any("Walls" in note for note in answer.notes)


def test_an_abstention_says_what_is_read_too() -> None:
    still = replace(volume_model().domain, least_motion=2.0)
    answer = classify(beats()[0].motion, replace(volume_model(), domain=still))
    assert answer.flags == ("no motion",)
    assert ALONE in answer.notes


def test_models_of_motion_say_nothing_of_it() -> None:
    model = small_model()
    assert model.reads_motion
    assert model.no_motion_note == ""
