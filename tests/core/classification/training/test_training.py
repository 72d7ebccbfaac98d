"""Training: reproducible, honest about what it met, and refused where it makes no sense."""

from __future__ import annotations

import tracemalloc
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from classify_samples import QUICK_CARD, cohort, curve, curves, curves_model, small_model

from modalmotion.classification import (
    TrainingCase,
    TrainingOptions,
    classify,
    evaluate,
    model_to_hdf5,
    only_modes,
    train,
)
from modalmotion.classification.model.domain import OF_CLASS
from modalmotion.errors import ParameterError
from modalmotion.signature.making import ModalSignature, SignatureParameters, modal_signature
from modalmotion.signature.reconstruction import reconstruct
from modalmotion.simulate import Acquisition, MotionClass, draw_parameters, simulate_ventricle

# Where the law is not about how scores come about: the quickest estimator.
QUICK = replace(QUICK_CARD, estimator="linear")


def test_training_again_gives_the_same_model_to_the_byte() -> None:
    assert model_to_hdf5(train(cohort(6), "small", QUICK_CARD)) == model_to_hdf5(small_model())
    first, other = (train(cases, "small", QUICK) for cases in (cohort(6), cohort(6)[1:]))
    assert first.id != other.id


def test_a_model_tells_new_curves_apart_whatever_their_pose() -> None:
    model = curves_model()
    assert model.readable.topologies == ("open curve",)
    found = evaluate(model, curves(10, seed=4))
    assert found.accuracy >= 0.9
    assert found.n_cases == sum(map(sum, found.confusion)) == 20
    assert model.card.accuracy is not None
    assert model.card.accuracy >= 0.9


def test_the_pose_of_a_curve_changes_nothing() -> None:
    model = curves_model()
    a, b = curve("tip", np.random.default_rng(1)), curve("tip", np.random.default_rng(1))
    turn = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    b = replace(b, vertices=b.vertices @ turn.T + [5.0, -8.0, 100.0])
    one, other = (classify(modal_signature(sequence), model) for sequence in (a, b))
    assert one.label == other.label == "tip"
    assert one.probabilities == pytest.approx(other.probabilities, abs=1e-6)


@pytest.mark.thorough
def test_spring_modes_of_one_mesh_can_be_learned_and_another_mesh_is_refused() -> None:
    asked = SignatureParameters(closed_form=False)

    def case(number: int, label: str, grid: tuple[int, int] = (8, 12)) -> TrainingCase:
        rng = np.random.default_rng(number)
        beat = simulate_ventricle(grid=grid)
        moved = beat.vertices + 0.1 * rng.standard_normal(beat.vertices.shape)
        if label == "late":
            moved[:, ::2, 2] += 3.0 * np.sin(np.linspace(0.0, 6.28, len(moved)))[:, None]
        return TrainingCase(modal_signature(replace(beat, vertices=moved), asked), label)

    cases = [case(n, label) for n in range(6) for label in ("plain", "late")]
    model = train(cases, "springs", QUICK_CARD)
    assert model.readable.topologies == ("mesh",)
    assert model.signature_parameters.closed_form is False
    assert evaluate(model, [case(50, "plain"), case(51, "late")]).accuracy == 1.0
    other = case(1, "plain", (8, 14))
    assert classify(other.signature, model).flags == ("out of domain",)
    with pytest.raises(ParameterError, match="another mesh"):
        train([*cases, other], "mixed")


def test_one_class_missing_labels_and_no_cases_are_refused() -> None:
    cases = cohort(6)
    with pytest.raises(ParameterError, match="1 class"):
        train([c for c in cases if c.label == "normal"], "one")
    with pytest.raises(ParameterError, match="0 class"):
        train([], "none")
    for label in ("", "  "):
        with pytest.raises(ParameterError, match="case 1 has no label"):
            train([cases[0], replace(cases[1], label=label), *cases[2:]], "unlabelled")


def test_one_recording_of_two_classes_is_refused() -> None:
    cases = cohort(6)
    with pytest.raises(ParameterError, match="two classes"):
        train([*cases, replace(cases[0], label="other")], "torn")


def test_a_recording_that_came_twice_counts_once() -> None:
    cases = cohort(6)
    model = train([*cases, cases[0], cases[3]], "small", QUICK_CARD)
    assert model.card.n_cases == dict.fromkeys(model.classes, 6)
    assert any("came twice" in note for note in model.card.notes)
    assert model.id == small_model().id


def test_no_subject_is_on_both_sides_of_a_split() -> None:
    from modalmotion.classification.training.collection import collect
    from modalmotion.classification.training.splits import split_cases

    # Three recordings of each subject, and one recording that is said to be of two.
    cases = [replace(c, subject=f"s{n // 6}-{c.label}") for n, c in enumerate(cohort(12))]
    cases.append(replace(cases[0], subject=cases[6].subject))
    options = TrainingOptions()
    table = collect(cases, options)
    splits, is_grouped, _ = split_cases(table, options)
    assert is_grouped
    for inner, outer in splits:
        assert not set(table.groups[inner]) & set(table.groups[outer])
        inside = {table.subjects[i] for i in inner}
        assert not inside & {table.subjects[i] for i in outer}
    model = train(cases, "grouped", QUICK)
    assert model.card.is_grouped
    assert max(model.card.n_subjects.values()) <= 5


def test_a_class_of_one_subject_is_said_to_be_unknown_beyond_it() -> None:
    cases = [replace(c, subject="only" if c.label == "normal" else c.subject) for c in cohort(6)]
    model = train(cases, "alone", QUICK)
    assert not model.card.is_grouped
    assert any("one subject only" in note for note in model.card.notes)


def test_cases_of_different_modes_are_refused() -> None:
    signature = modal_signature(simulate_ventricle(grid=(12, 24)), SignatureParameters(modes=18))
    with pytest.raises(ParameterError, match="modes"):
        train([*cohort(6), TrainingCase(signature, "normal")], "mixed")


def test_what_is_measured_from_a_frame_and_from_the_mean_shape_is_not_mixed() -> None:
    beat = simulate_ventricle(grid=(12, 24))
    other = modal_signature(beat, TrainingOptions().signature_parameters)
    with pytest.raises(ParameterError, match="reference mean"):
        train([*cohort(6), TrainingCase(other, "normal")], "mixed")
    about = [
        TrainingCase(replace(c.signature, parameters=other.parameters), c.label, c.subject)
        for c in cohort(6)
    ]
    found = train(about, "mean", QUICK).signature_parameters
    assert found == replace(other.parameters, modes=len(about[0].signature.modes))
    assert small_model().signature_parameters.reference == 0


def test_one_frame_is_refused() -> None:
    still = modal_signature(simulate_ventricle(grid=(12, 24)))
    still = replace(still, amplitudes=still.amplitudes[:1], times=None)
    with pytest.raises(ParameterError, match="one frame"):
        train([*cohort(6), TrainingCase(still, "normal")], "still")


def test_a_class_with_few_cases_is_in_every_set_and_that_is_said() -> None:
    found = classify(cohort(2, seed=5)[0].signature, small_model())
    assert found.class_set == small_model().classes
    assert any("Too few cases" in note for note in found.notes)


def test_figures_of_few_cases_are_said_to_say_little() -> None:
    def of_few(cases: list[TrainingCase]) -> list[str]:
        notes = train(cases, "few", QUICK).card.notes
        return [note for note in notes if note.startswith("Figures of ")]

    (note,) = of_few(cohort(4))
    assert note.startswith("Figures of 8 cases say little: ")
    (note,) = of_few(cohort(6)[:9])
    assert note.startswith("Figures of 9 cases say little: ")
    normal = [case for case in cohort(9) if case.label == "normal"]
    others = [case for case in cohort(9) if case.label != "normal"]
    (note,) = of_few([*normal[:3], *others])
    assert note.startswith("Figures of 12 cases, 3 of normal, say little: ")
    assert of_few(cohort(6)) == []


def test_progress_rises_to_one() -> None:
    heard: list[float] = []
    said: list[str] = []

    def hear(share: float, text: str) -> None:
        heard.append(share)
        said.append(text)

    train(cohort(6), "heard", QUICK, hear)
    assert heard == sorted(heard)
    assert heard[-1] == 1.0
    reading = [text for text in said if text.startswith("reading ")]
    assert reading == [f"reading case {k} of 12" for k in range(1, 13)]


def test_weights_of_a_class_that_no_case_has_are_refused_with_the_names_that_there_are() -> None:
    options = TrainingOptions(class_weights={"normal": 2.0, "hypokinesis": 1.0}, estimator="linear")
    with pytest.raises(ParameterError, match="'hypokinesis'") as caught:
        train(cohort(2), "weights", options)
    assert caught.value.remedy.endswith("global hypokinesia, normal.")


def test_class_weights_pull_towards_a_class() -> None:
    cases = cohort(6)
    plain, pulled = (
        train(cases, "weights", replace(QUICK, class_weights=weights))
        for weights in ("none", {"normal": 50.0})
    )
    k = plain.classes.index("normal")
    before, after = (
        np.array([classify(case.signature, model).probabilities[k] for case in cases])
        for model in (plain, pulled)
    )
    others = before < 0.5
    assert others.any()
    assert after[others].mean() > 1.5 * before[others].mean()
    assert pulled.id != plain.id


def test_an_explanation_names_the_modes_that_move_the_answer() -> None:
    sequence = simulate_ventricle(grid=(12, 24))
    signature = modal_signature(sequence)
    model = train(cohort(12), "explained", replace(QUICK, modes=7, further=False))
    everything = np.full_like(model.domain.limits, np.inf)
    model = replace(model, domain=replace(model.domain, limits=everything))
    # Of one choice, and linear.
    first = replace(model.members[0], weight=1.0)
    model = replace(model, members=(first,), temperature=1.0)
    found = classify(signature, model)
    assert found.explanation
    scores = [abs(part.score) for part in found.explanation]
    assert scores == sorted(scores, reverse=True)
    moving = signature.amplitudes - signature.amplitudes.mean(axis=0)
    place = {str(label): k for k, label in enumerate(signature.modes.labels)}
    for part in found.explanation:
        rows = [place[label] for label in part.modes]
        expected = np.sqrt((moving[:, rows] ** 2).sum(axis=(1, 2)).mean())
        assert part.amplitude == pytest.approx(expected)
        assert part.unit == "mm"
    # The scores of a linear model add up to its lead over that of an average case, but for
    # features of several modes, which belong to none.
    (member,) = model.members
    linear = member.blend.scorers[0]
    read = model.read(signature)
    nearest = model.distance(model.domain.reader.read(signature).kinds).argmin()
    z = member.blend.standardised(read.values[nearest])
    first, second = np.argsort(-found.probabilities)[:2]
    parts = [{place[label] for label in part.modes} for part in found.explanation]
    told = np.array([any(set(c.modes) <= part for part in parts) for c in model.columns])
    lead = (z @ (told[:, None] * linear.weights))[[first, second]] @ [1.0, -1.0]
    total = sum(part.score for part in found.explanation)
    assert total == pytest.approx(lead / linear.temperature / member.blend.temperature, rel=1e-6)
    shown = only_modes(signature, found.explanation[0].modes)
    positions = reconstruct(shown, sequence)
    assert positions.shape == sequence.vertices.shape
    assert np.ptp(positions, axis=0).max() > 0.1
    with pytest.raises(ParameterError, match="no mode"):
        only_modes(signature, ["(9, 9, cos)"])


def noisy(signature: ModalSignature, number: int) -> ModalSignature:
    rng = np.random.default_rng(number)
    jitter = 0.2 * rng.standard_normal(signature.amplitudes.shape)
    return replace(
        signature, amplitudes=signature.amplitudes + jitter, sequence_id=f"{number:064d}"
    )


@pytest.mark.soak
def test_ten_thousand_sequences_are_learned_in_bounded_memory() -> None:
    base = cohort(6)

    def cases() -> Iterator[TrainingCase]:
        for number in range(10_000):
            case = base[number % len(base)]
            yield TrainingCase(noisy(case.signature, number), case.label)

    tracemalloc.start()
    model = train(cases(), "many", replace(QUICK_CARD, folds=2))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert sum(model.card.n_cases.values()) == 10_000
    assert peak < 2**30


def test_of_lattices_of_few_nodes_the_modes_that_all_have_are_read(
    rng: np.random.Generator,
) -> None:
    """A coarse lattice names other modes beyond its Nyquist wavenumbers."""
    few = Acquisition(n_frames=8, noise=0.3)
    cases = [
        TrainingCase(
            simulate_ventricle(draw_parameters(label, rng), grid=grid, acquisition=few, rng=rng),
            str(label),
        )
        for label, grid in zip([*MotionClass][:2] * 4, [(4, 4), *[(6, 8)] * 7], strict=True)
    ]
    options = TrainingOptions(
        estimator="linear", folds=2, repetitions=1, card="quick", kind="material"
    )
    model = train(cases, "coarse", options)
    assert model.readable.n_modes == 7
    assert any("too few vertices" in note for note in model.card.notes)
    assert classify(cases[0].motion, model).classes == model.classes


def test_each_class_has_the_spread_of_its_own_cases() -> None:
    model, cases = curves_model(), curves(12)
    motions = [case.motion for case in cases]
    kinds = [
        model.domain.reader.read(motion).kinds[0]
        for motion in motions
        if isinstance(motion, ModalSignature)
    ]
    apart = model.domain.distances(np.array(kinds))
    for number, label in enumerate(model.classes):
        own = apart[[case.label == label for case in cases], number]
        assert model.domain.spreads[number] == pytest.approx(np.sqrt((own**2).mean()), rel=1e-6)
    assert np.isfinite(model.domain.limits[OF_CLASS])
