"""Rows of the table of truth: classes.

Hearts, folds and draws are fewer than a trial would have, to hold the budget: 200 hearts a class of
each generator, five folds of a cohort and thirty draws of few cases are the full count.
"""

from __future__ import annotations

from typing import Final, Literal

import numpy as np
from experiments import Row, experiment
from judged_classes import (
    ALTERATIONS,
    flagged,
    held_out,
    mean,
    on_own,
    on_third,
    told_of_chance,
    with_few,
    without_cavity,
)
from labelled_cases import folds_of, halves, synthetic, tongue, windows
from measure import side_by_side

from modalmotion.classification import DEFAULT_MODEL, OFFSET_MODEL, classify, load_model
from modalmotion.signature.making import modal_signature
from modalmotion.simulate import simulate_ventricle

_Figure = tuple[str, str, float | tuple[float, float], Literal["lower", "higher"]]

_THREE: Final[dict[str, _Figure]] = {
    "accuracy": ("right labels; a flag counts as wrong", "", 1.0, "higher"),
    "auc": ("AUC", "", 1.0, "higher"),
    "log_loss": ("log loss", "nats", 0.0, "lower"),
}
_OWN: Final[dict[str, _Figure]] = _THREE | {
    "answered": ("share with a class", "", 0.9, "higher"),
    "overconfidence": ("confidence minus share right, where unflagged", "", (-0.05, 0.05), "lower"),
    "cover": ("90 % sets that hold the truth, where unflagged", "", 0.85, "higher"),
}
_THIRD: Final[dict[str, _Figure]] = _OWN | {
    "answered": ("share with a class", "", 0.5, "higher"),
    "normal": ("normal ones called normal", "", 0.5, "higher"),
    "contradicted": ("called hypokinetic, of ejection fractions above 55 %", "", 0.0, "lower"),
    "mirrored": ("mirror images that are flagged", "", 0.8, "higher"),
}
_FEW: Final[dict[str, _Figure]] = {
    "accuracy": ("right labels", "", 0.936, "higher"),
    "auc": ("AUC", "", 0.983, "higher"),
    "behind": ("AUC behind the better of motion and of EF with size", "points", 1.0, "lower"),
}


def _rows(name: str, what: str, figures: dict[str, _Figure]) -> tuple[Row, ...]:
    return tuple(
        Row(f"classes.{name}.{figure}", f"{words}: {what}", unit, goal, better)
        for figure, (words, unit, goal, better) in figures.items()
    )


def _shipped(kind: str, model: str) -> None:
    of_model = f"model of {kind} points"

    @experiment(*_rows(f"{kind}.own", f"{of_model}, hearts of its generator", _OWN))
    def of_own(seed: int) -> tuple[float, ...]:
        return on_own(model, 20, seed)

    @experiment(*_rows(f"{kind}.third", f"{of_model}, hearts of a third generator", _THIRD))
    def of_third(seed: int) -> tuple[float, ...]:
        return on_third(model, 30, seed)


_shipped("material", DEFAULT_MODEL)
_shipped("offset", OFFSET_MODEL)


def _cohorts(name: str, *cohorts: str) -> None:
    @experiment(*_rows(name, f"six cohorts of {name}, people kept apart", _THREE))
    def of_cohorts(seed: int) -> tuple[float, ...]:
        made = [synthetic(each, 100 + seed) for each in cohorts]
        return mean([held_out(cases, folds_of(cases, 2), seed) for cases in made])


_cohorts("cycles", "membrane", "torus", "sphere", "cup", "ring", "bulge")
_cohorts("courses", "folding", "words", "words, turned", "figure", "tube", "rope")


@experiment(*_rows("tongue", "two words, sixths left out", _THREE), needs=("tongue",))
def words_of_the_tongue(seed: int) -> tuple[float, ...]:
    cases = tongue()
    return mean([held_out(cases, folds_of(cases, 6), seed)])


def _figure(name: str, n_folds: int) -> None:
    @experiment(*_rows(name, f"windows of the {name}, other half", _THREE), needs=(name,))
    def of_figure(seed: int) -> tuple[float, ...]:
        cases = windows(name, seed % 4)
        return mean([held_out(cases, halves(cases)[:n_folds], seed)])


_figure("robot", n_folds=1)
_figure("fox", n_folds=2)


@experiment(
    *_rows("few16", "16 ventricles a class", _FEW), *_rows("few24", "24 ventricles a class", _FEW)
)
def few(seed: int) -> tuple[float, ...]:
    return with_few(24, 40, (16, 24), seed)


@experiment(*_rows("no_cavity", "8 surfaces a class that hold no cavity", _THREE), quick=True)
def no_cavity(seed: int) -> tuple[float, ...]:
    return without_cavity(8, 20, seed)


@experiment(
    Row("classes.chance.told", "models worse than chance that say so", goal=1.0, better="higher")
)
def chance(seed: int) -> float:
    return told_of_chance(8, seed)


@experiment(
    *(
        Row(f"classes.flags.{what.replace(' ', '_')}", f"flagged: {what}", "", 0.95, "higher")
        for what in (*ALTERATIONS, "no ventricle")
    ),
    Row("classes.flags.sound", "flagged: sound beats", goal=0.1),
    quick=True,
)
def flags(seed: int) -> tuple[float, ...]:
    return flagged(6, 2, seed)


@experiment(
    Row("classes.answer.times", "time of a class over that of a singular value decomposition"),
    quick=True,
    is_timed=True,
)
def answer(seed: int) -> float:
    model, work = load_model(DEFAULT_MODEL), np.random.default_rng(seed).random((120, 120))
    beat = simulate_ventricle(rng=np.random.default_rng([seed, 6]))
    signature = modal_signature(beat, model.signature_parameters)
    calls = {"class": lambda: classify(signature, model), "svd": lambda: np.linalg.svd(work)}
    of_class, of_svd = side_by_side(calls, 20).values()
    return float(of_class.min() / of_svd.min())
