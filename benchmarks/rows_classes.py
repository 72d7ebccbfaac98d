"""Rows of the table of truth: classes.

Hearts, folds and draws are fewer than a trial would have, to hold the budget: 200 hearts a class of
each generator, five folds of a cohort and thirty draws of few cases are the full count.
"""

from __future__ import annotations

from functools import partial
from typing import Final, Literal

import judged_classes as judged
from experiments import Row, experiment, quick, timed

from modalmotion.classification import DEFAULT_MODEL, NORMAL_DISPLACEMENT_MODEL

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
_SIZES: Final = (4, 8, 16, 24, 32)
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


for _kind, _model, _of in (
    ("material", DEFAULT_MODEL, "material points"),
    ("normal_displacement", NORMAL_DISPLACEMENT_MODEL, "normal displacements"),
):
    _what = f"model of {_of}, hearts of"
    _own = _rows(f"{_kind}.own", f"{_what} its generator", _OWN)
    experiment(*_own)(partial(judged.on_own, _model, 20))
    _asked = (
        _THIRD if _model == DEFAULT_MODEL else {k: _THIRD[k] for k in _THIRD if k != "mirrored"}
    )
    _third = _rows(f"{_kind}.third", f"{_what} a third generator", _asked)
    experiment(*_third)(partial(judged.on_third, _model, 30))

for _name, _cohorts in {
    "cycles": ("membrane", "torus", "sphere", "cup", "ring", "bulge"),
    "courses": ("folding", "words", "words, turned", "figure", "tube", "rope"),
}.items():
    _six = _rows(_name, f"six cohorts of {_name}, people kept apart", _THREE)
    experiment(*_six)(partial(judged.on_cohorts, _cohorts))

_words = _rows("tongue", "two words, sixths left out", _THREE)
experiment(*_words, needs=("tongue",))(judged.on_words)

for _name, _n_folds in (("robot", 1), ("fox", 2)):
    _half = _rows(_name, f"windows of the {_name}, other half", _THREE)
    experiment(*_half, needs=(_name,))(partial(judged.on_windows, _name, _n_folds))


@experiment(*(row for n in _SIZES for row in _rows(f"few{n}", f"{n} ventricles a class", _FEW)))
def few(seed: int) -> tuple[float, ...]:
    return judged.with_few(32, 40, _SIZES, seed)


@quick(*_rows("no_cavity", "8 surfaces a class that hold no cavity", _THREE))
def no_cavity(seed: int) -> tuple[float, ...]:
    return judged.without_cavity(8, 20, seed)


@experiment(Row("classes.chance.told", "models worse than chance that say so", "", 1.0, "higher"))
def chance(seed: int) -> float:
    return judged.told_of_chance(8, seed)


@quick(
    *(
        Row(f"classes.flags.{what.replace(' ', '_')}", f"flagged: {what}", "", 0.95, "higher")
        for what in (*judged.ALTERATIONS, "no ventricle")
    ),
    Row("classes.flags.sound", "flagged: sound beats", goal=0.1),
)
def flags(seed: int) -> tuple[float, ...]:
    return judged.flagged(6, 2, seed)


timed(Row("classes.answer.times", "time of a class over that of a singular value decomposition"))(
    judged.time_of_answer
)
