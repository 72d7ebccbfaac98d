"""The class set of an answer, and what it says where no class is in it."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.model.domain import OF_CLASS
from modalmotion.classification.model.model import Model

# Level at which a case that is in no set is like no class: what `known_share` is by default.
_STRICT: Final = 0.995

# Levels that are named where a set is empty.
_LEVELS: Final = (0.95, 0.98, 0.99, _STRICT)


class ClassSet(NamedTuple):
    """Classes that cannot be ruled out.

    Parameters
    ----------
    classes : tuple of str
    words : str
        Why there is none; empty where there is one.
    is_strange : bool
        Whether the case is like no class even at a level that nearly all cases reach, or farther
        from its class than nearly all of that class are.
    """

    classes: tuple[str, ...]
    words: str
    is_strange: bool


def class_set(
    model: Model,
    probabilities: NDArray[np.float64],
    label: str,
    coverage: float,
    apart: NDArray[np.float64],
) -> ClassSet:
    """Find the classes that cannot be ruled out.

    The label is in the set wherever another class is. A set may be empty: of the cases
    that are like the training ones up to 1 - coverage have no class in it. Such a case keeps its
    label, unless its set is empty at a level of 99.5 %, too, or it is farther from the class that
    is the most probable than nearly all training cases of that class.

    Parameters
    ----------
    model : Model
    probabilities : (classes,) float64
    label : str
        Of the answer.
    coverage : float
    apart : (classes,) float64
        Distances from the classes: see `Judgement.of_classes`.
    """
    held = _held(model, probabilities, coverage)
    if held.any():
        held[model.classes.index(label)] = True
        classes = tuple(c for c, keep in zip(model.classes, held, strict=True) if keep)
        return ClassSet(classes, "", False)
    likeliest = int(probabilities.argmax())
    own = model.classes[likeliest]
    distance, limit = float(apart[likeliest]), float(model.domain.limits[OF_CLASS])
    if distance > limit:
        words = (
            f"it is unlike every class at {100 * coverage:g} %, and farther from {own}, the most "
            f"probable one, than nearly all training cases that are {own} (distance "
            f"{distance:.2f} where theirs are 1 on average, limit {limit:.2f}). Look at the "
            "recording"
        )
        return ClassSet((), words, True)
    for level in _LEVELS:
        if level > coverage and _held(model, probabilities, level).any():
            words = (
                f"Unlike every class at {100 * coverage:g} %: {own} is the most probable, but "
                f"less so than in {100 * coverage:g} % of the cases that are {own}, and so is "
                f"each other class. At {100 * level:g} % the set is not empty."
            )
            if label != own:
                words += f" The answer is {label} by the decision of the model."
            return ClassSet((), words, False)
    words = (
        f"it is unlike every class at {100 * max(coverage, _STRICT):g} %: none is as probable as "
        "in nearly all cases that are of it. Look at the recording"
    )
    return ClassSet((), words, True)


def few_cases(model: Model, coverage: float) -> str:
    """Name classes that no set can rule out; empty where there are none."""
    few = model.calibration.too_few(coverage)
    if not few:
        return ""
    names = ", ".join(model.classes[k] for k in few)
    return (
        f"Too few cases to rule out {names} at a coverage of {coverage:.3g}: every class set "
        f"holds {'it' if len(few) == 1 else 'them'}."
    )


def _held(model: Model, probabilities: NDArray[np.float64], level: float) -> NDArray[np.bool_]:
    return np.asarray(model.calibration.holds(probabilities[None], level)[0])
