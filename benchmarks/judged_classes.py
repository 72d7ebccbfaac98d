"""How good classes are: of the shipped models, and of models trained on a cohort."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import labelled_cases as labelled
import numpy as np
from altered_beats import ALTERED, mirror_image
from foreign_motions import FLAGGED
from measure import side_by_side
from third_generator import hearts
from train_shipped import RECIPES
from train_shipped import hearts as own_hearts

from modalmotion.classification import (
    DEFAULT_MODEL,
    Evaluation,
    TrainingCase,
    classify,
    evaluate,
    load_model,
)
from modalmotion.classification import train as trained
from modalmotion.classification.evaluation import CaseAnswer, evaluation_of
from modalmotion.mesh import Cavity
from modalmotion.signature.making import modal_signature
from modalmotion.simulate import MotionClass, simulate_cohort, simulate_ventricle

ALTERATIONS: Final = ("motion x3", "motion x0.2", "mirrored", "frames missing in systole")


def on_own(model: str, n_per_class: int, seed: int) -> tuple[float, ...]:
    """Figures of a shipped model on held-out hearts of the generators that it was trained on."""
    cases = own_hearts(RECIPES[model], n_per_class, 7000 + seed)
    return _figures(evaluate(load_model(model), cases))


def on_third(name: str, n_per_class: int, seed: int) -> tuple[float, ...]:
    """Measure the same on hearts of the third generator.

    Then the share of normal ones called normal, the share of those with a preserved ejection
    fraction called globally hypokinetic, and the share of mirror images that are flagged.
    """
    model, rng = load_model(name), np.random.default_rng([seed, 1])
    drawn = list(hearts(n_per_class, seed, RECIPES[name].classes))
    asked = model.signature_parameters
    cases = [TrainingCase(modal_signature(beat, asked), label) for beat, label in drawn]
    found = evaluate(model, cases)
    volumes = [Cavity(beat.faces).volume(beat.vertices.astype(np.float64)) for beat, _ in drawn]
    ejected = np.array([1.0 - each.min() / each.max() for each in volumes])
    answers = np.array([case.answer or "" for case in found.cases])
    normal = answers[[label == MotionClass.NORMAL for _, label in drawn]] == MotionClass.NORMAL
    weak = answers[ejected > 0.55] == MotionClass.HYPOKINESIA
    figures = *_figures(found), float(normal.mean()), float(weak.mean())
    if name != DEFAULT_MODEL:
        return figures  # a mirror image moves along its normals as the heart itself does
    mirrored = [bool(classify(mirror_image(beat, rng), model).flags) for beat, _ in drawn[::4]]
    return *figures, float(np.mean(mirrored))


def held_out(cases: list[TrainingCase], folds: labelled.Folds, seed: int) -> Evaluation:
    """Train in each fold, and measure the answers to the cases outside."""
    options = replace(labelled.QUICK, seed=seed)
    answers: list[CaseAnswer] = []
    for inner, outer in folds:
        model = trained([cases[i] for i in inner], "bench", options)
        answers += evaluate(model, [cases[i] for i in outer]).cases
    return evaluation_of(model, answers, 0.9)


def mean(found: list[Evaluation]) -> tuple[float, ...]:
    """Mean accuracy, AUC and log loss."""
    values = np.array([(e.accuracy, e.auc, e.log_loss) for e in found], dtype=np.float64)
    return tuple(values.mean(axis=0).tolist())


def on_cohorts(names: Sequence[str], seed: int) -> tuple[float, ...]:
    """Mean accuracy, AUC and log loss on halves of synthetic cohorts."""
    made = [labelled.synthetic(name, 100 + seed) for name in names]
    return mean([held_out(cases, labelled.folds_of(cases, 2), seed) for cases in made])


def on_words(seed: int) -> tuple[float, ...]:
    """Accuracy, AUC and log loss on sixths of the words of the tongue."""
    cases = labelled.tongue()
    return mean([held_out(cases, labelled.folds_of(cases, 6), seed)])


def on_windows(name: str, n_folds: int, seed: int) -> tuple[float, ...]:
    """Accuracy, AUC and log loss on one half or both of a recorded figure's motions."""
    cases = labelled.windows(name, seed % 4)
    return mean([held_out(cases, labelled.halves(cases)[:n_folds], seed)])


def with_few(n: int, n_tested: int, sizes: tuple[int, ...], seed: int) -> tuple[float, ...]:
    """For each number of cases a class mean accuracy, AUC, and points of AUC that are given away.

    Against the better of the motion alone and of ejection fraction with size, on normal and
    akinetic ventricles of two generators.
    """
    made = [
        [labelled.few_cases(k, 2 * seed + i, is_third=third) for i, k in enumerate((n, n_tested))]
        for third in (False, True)
    ]
    values: list[float] = []
    for size in sizes:
        found, better = [], []
        for pool, tested in made:
            some = labelled.of_pool(pool, size, np.random.default_rng([seed, size]))
            found.append(evaluate(trained(some, "few", labelled.QUICK), tested))
            alone = labelled.of_one_table(some, tested)[1]
            better.append(max(alone, labelled.area_of_volume(some, tested)))
        accuracy, area, _ = mean(found)
        values += [accuracy, area, 100 * (float(np.mean(better)) - area)]
    return tuple(values)


def without_cavity(n: int, n_tested: int, seed: int) -> tuple[float, ...]:
    """Mean accuracy, AUC and log loss on small cohorts of people who all do either motion."""
    motions, found = {"torus": ("forwards", "backwards"), "sphere": ("oval", "squeezes")}, []
    for name, labels in motions.items():
        known, new = (labelled.small(name, labels, k, [seed, k]) for k in (n, n_tested))
        found.append(evaluate(trained(known, name, labelled.QUICK), new))
    return mean(found)


def told_of_chance(n_trainings: int, seed: int) -> float:
    """Share of models of mixed-up labels, worse than chance, whose answers say so."""
    rng, told = np.random.default_rng([seed, 7]), []
    for number in range(n_trainings):
        cases = labelled.small("rope", ("early", "late"), 6, [seed, number])
        labels = rng.permutation([case.label for case in cases]).tolist()
        mixed = [
            replace(case, label=label, subject=None)
            for case, label in zip(cases, labels, strict=True)
        ]
        model = trained(mixed, "mixed", labelled.QUICK)
        if (model.card.auc or 0.0) < 0.5:
            told.append(any("chance" in note for note in classify(mixed[0].motion, model).notes))
    return float(np.mean(told))


def flagged(n_per_class: int, n_foreign: int, seed: int) -> tuple[float, ...]:
    """Shares that are flagged of beats altered in each way, of foreign motions, of sound beats."""
    rng = np.random.default_rng([seed, 5])
    beats = [case.sequence for case in simulate_cohort(n_per_class, rng=rng)]
    kinds = [[ALTERED[what][0](beat, rng) for beat in beats] for what in ALTERATIONS]
    kinds += [[draw(rng) for draw in FLAGGED.values() for _ in range(n_foreign)], beats]
    return tuple(float(np.mean([bool(classify(one).flags) for one in kind])) for kind in kinds)


def time_of_answer(seed: int) -> float:
    """Time of a class, the signature being there, over that of a decomposition of 120 x 120."""
    model, work = load_model(DEFAULT_MODEL), np.random.default_rng(seed).random((120, 120))
    beat = simulate_ventricle(rng=np.random.default_rng([seed, 6]))
    signature = modal_signature(beat, model.signature_parameters)
    calls = {"class": lambda: classify(signature, model), "svd": lambda: np.linalg.svd(work)}
    of_class, of_svd = side_by_side(calls, 20).values()
    return float(of_class.min() / of_svd.min())


def _figures(found: Evaluation) -> tuple[float, ...]:
    """Accuracy, AUC, log loss, share answered; of these confidence - share right, and cover."""
    given = [case for case in found.cases if case.answer is not None]
    apart = [max(case.probabilities) - (case.answer == case.truth) for case in given]
    held = [case.truth in case.class_set for case in given]
    answered = len(given) / found.n_cases
    return *mean([found]), answered, float(np.mean(apart)), float(np.mean(held))
