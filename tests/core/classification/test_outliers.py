"""What speaks against an answer: each flag where it is due, and none of sound recordings."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from altered_beats import without_systole
from classify_samples import curve, curves_model

import modalmotion as mm
from modalmotion.classification import Model, classify, load_model
from modalmotion.classification.motion import Motion
from modalmotion.classification.outliers import CHECKS, KNOWN_SHARE, with_limits
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.simulate import MotionClass, simulate_cohort

TWO = (MotionClass.NORMAL, MotionClass.DYSSYNCHRONY)


@cache
def beats(n: int, seed: int) -> list[tuple[MeshSequence, str]]:
    drawn = simulate_cohort(n, rng=np.random.default_rng(seed), classes=TWO, triangle_share=0.0)
    return [(case.sequence, str(case.label)) for case in drawn]


def model() -> Model:
    return load_model()


def share_flagged(change: object, *flags: str) -> float:
    found = [classify(change(beat), model()).flags for beat, _ in beats(6, 2)]  # type: ignore[operator]
    return float(np.mean([bool(set(flags) & set(one)) if flags else bool(one) for one in found]))


def about_mean(beat: MeshSequence, factor: float) -> MeshSequence:
    mean = beat.vertices.mean(axis=0)
    return replace(beat, vertices=mean + factor * (beat.vertices - mean))


def test_sound_recordings_are_answered() -> None:
    assert share_flagged(lambda beat: beat) <= 0.125


def test_what_was_altered_is_flagged_by_its_name() -> None:
    mirror = np.array([-1.0, 1.0, 1.0])
    image = share_flagged(lambda b: replace(b, vertices=b.vertices * mirror), "mirrored")
    assert image >= 0.75
    backwards = share_flagged(lambda b: replace(b, vertices=b.vertices[::-1]))
    assert backwards >= 0.75
    half = share_flagged(
        lambda b: replace(
            b,
            vertices=b.vertices[: b.n_frames // 2],
            times=np.asarray(b.times)[: b.n_frames // 2],
        )
    )
    assert half >= 0.9
    assert share_flagged(lambda b: replace(b, vertices=3.0 * b.vertices), "other size") == 1.0
    assert share_flagged(lambda b: about_mean(b, 0.2)) >= 0.9


def test_a_mirror_image_that_states_its_hand_is_sound() -> None:
    def left(beat: MeshSequence) -> MeshSequence:
        facts = replace(beat.facts, handedness="left")
        return replace(beat, vertices=beat.vertices * np.array([1.0, -1.0, 1.0]), facts=facts)

    for beat, _ in beats(3, 5):
        one, other = classify(beat, model()), classify(left(beat), model())
        assert one.probabilities == pytest.approx(other.probabilities, abs=1e-4)


def test_rest_and_noise_are_no_class() -> None:
    rng = np.random.default_rng(3)
    beat = beats(1, 4)[0][0]
    shape = beat.vertices.mean(axis=0)
    still = replace(beat, vertices=np.repeat(shape[None], beat.n_frames, axis=0))
    assert classify(still, model()).flags == ("no motion",)
    noisy = replace(beat, vertices=shape + rng.normal(0.0, 3.0, beat.vertices.shape))
    found = classify(noisy, model())
    assert found.flags in (("noise",), ("no motion",))
    assert found.label is None
    assert found.probabilities == pytest.approx(np.full(5, 0.2))
    assert found.notes[0].text.startswith("No class: ")


def test_a_trained_model_knows_what_its_cases_were_like() -> None:
    own, rng = curves_model(), np.random.default_rng(9)
    drawn = [curve(label, rng) for label in ("tip", "back") * 4]
    assert np.isfinite(own.outliers.limits[:2]).all()
    assert sum(bool(classify(one, own).flags) for one in drawn) <= 1
    large = [replace(one, vertices=3.0 * one.vertices) for one in drawn]
    assert all("other size" in classify(one, own).flags for one in large)


def test_limits_hold_the_stated_share_of_new_cases() -> None:
    rng, beyond = np.random.default_rng(7), []
    detector = model().outliers
    for _ in range(40):
        own = with_limits(detector, rng.normal(size=(200, len(CHECKS))), np.arange(200))
        beyond.append((rng.normal(size=(2000, len(CHECKS))) > own.limits).any(axis=1).mean())
    assert float(np.mean(beyond)) == pytest.approx(1.0 - KNOWN_SHARE, abs=0.008)


def test_frames_missing_within_a_cycle_are_noticed() -> None:
    rng = np.random.default_rng(4)
    assert share_flagged(lambda b: without_systole(b, rng), "incomplete cycle") >= 0.9
    every_second = share_flagged(lambda b: replace(b, vertices=b.vertices[::2], times=None))
    assert every_second <= 0.125


def test_a_time_course_that_is_nearly_symmetric_is_not_reversed() -> None:
    detector, asked = model().outliers, model().signature_parameters
    for beat, _ in beats(1, seed=3):
        inputs = detector.read(Motion(mm.modal_signature(beat, asked)))
        for share, is_reversed in ((1.0, False), (-0.05, False), (-0.2, True), (-1.0, True)):
            kinds = inputs.kinds * np.where(detector.signs[1] < 0, share, 1.0)
            scores = detector.scores(inputs._replace(kinds=kinds))[0]
            assert (scores > detector.limits)[CHECKS.index("reversed")] == is_reversed


def test_classes_that_are_images_of_one_another_are_no_sign_of_an_image() -> None:
    scores = np.random.default_rng(8).normal(size=(400, len(CHECKS)))
    detector = model().outliers
    backwards = np.stack([detector.means[0], detector.means[0] * detector.signs[1]])
    for means, is_told in ((detector.means, True), (backwards, False)):
        own = replace(detector, means=means)
        limits = with_limits(own, scores, np.arange(400)).limits
        assert np.isfinite(limits[:-1]).all()
        assert np.isfinite(limits[-1]) == is_told


def test_of_cases_of_one_subject_only_the_strangest_counts() -> None:
    scores = np.random.default_rng(8).normal(size=(400, len(CHECKS)))
    alone = with_limits(model().outliers, scores, np.arange(400))
    together = with_limits(model().outliers, scores, np.arange(400) // 8)
    assert together.limits.mean() > alone.limits.mean()


def test_a_signature_of_undetermined_amplitudes_is_flagged() -> None:
    beat = beats(1, 4)[0][0]
    signature = mm.modal_signature(beat, model().signature_parameters)
    unsure = replace(signature, amplitude_deviations=2.0 * np.abs(signature.amplitudes))
    assert classify(unsure, model()).flags == ("undetermined",)
