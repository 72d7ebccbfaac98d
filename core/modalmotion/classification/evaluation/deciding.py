"""Decisions of a user's own: costs, or sensitivities to reach, chosen on held-out answers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.measures.performance import performance
from modalmotion.classification.model.cross_validation import CrossValidation
from modalmotion.classification.model.decision import Decision
from modalmotion.classification.model.model import Model
from modalmotion.errors import ParameterError

# Thresholds are rounded down to so many digits, so that the case they lie on stays above.
_DIGITS: Final = 6


def decided(
    model: Model,
    *,
    costs: Mapping[str, Mapping[str, float]] | None = None,
    sensitivity: Mapping[str, float] | None = None,
) -> Model:
    """Give a model a rule by which its probabilities become a label.

    Parameters
    ----------
    model : Model
    costs : mapping of true class to mapping of answer to float
        What an error costs; 1 where nothing is stated, and 0 for the right answer.
    sensitivity : mapping of class to float
        Share of each class that is to be answered as such, the most urgent class first: a case that
        reaches the threshold of an earlier one is not asked about later ones. The thresholds are
        the highest that reach them on held-out answers.

    Returns
    -------
    Model
        Another model, with an id of its own: labels differ. Its card says by what rule, and how
        well that does on held-out answers, each threshold chosen without the case's own fold.

    Raises
    ------
    ParameterError
        If not one of the two is stated, a class is unknown, a number is out of range, a
        sensitivity cannot be reached, or the model has no held-out answers to choose on.
    """
    if (costs is None) == (sensitivity is None):
        raise ParameterError(
            "A decision needs costs or sensitivities, and not both.",
            remedy="State one of the two.",
        )
    known = model.cross_validation
    if costs is not None:
        decision = Decision(model.classes, costs=_matrix(model.classes, costs))
        stated: dict[str, Any] = {"costs": {true: dict(row) for true, row in costs.items()}}
    else:
        wanted = dict(sensitivity or {})
        _require_shares(model.classes, wanted)
        if known is None:
            raise ParameterError(
                f"The model {model.name!r} has no held-out answers to choose thresholds on.",
                remedy="Train it again on cases that can be cross-validated, or state costs.",
            )
        every = np.ones(known.folds.shape, dtype=np.bool_)
        decision = Decision(model.classes, _thresholds(known, wanted, every))
        stated = {"sensitivity": wanted, "thresholds": dict(decision.thresholds)}
    stated["text"] = decision.text
    if known is not None:
        stated |= _measured(known, decision, stated.get("sensitivity"))
    return replace(model, decision=decision, card=replace(model.card, decision=stated))


def _measured(
    known: CrossValidation, decision: Decision, wanted: dict[str, float] | None
) -> dict[str, Any]:
    """Figures of the rule on held-out answers."""
    labels = decision.labels(known.probabilities)
    if wanted is not None:
        for fold in np.unique(known.folds):
            own = known.folds == fold
            try:
                others = Decision(known.classes, _thresholds(known, wanted, ~own))
            except ParameterError:
                # Without its own fold it cannot be reached: the rule itself stands in.
                others = decision
            labels = np.where(own, others.labels(known.probabilities), labels)
    figures = performance(known.answers(labels))
    measured: dict[str, Any] = {
        "accuracy": figures.accuracy,
        "accuracy_interval": figures.accuracy_interval,
        "sensitivity_reached": figures.sensitivity,
        "specificity_reached": figures.specificity,
        "confusion": figures.confusion,
    }
    if decision.costs:
        matrix = np.array(decision.costs)
        most_probable = known.probabilities.argmax(axis=2)
        measured["mean_cost"] = float(matrix[known.y, labels].mean())
        measured["mean_cost_of_most_probable"] = float(matrix[known.y, most_probable].mean())
    return measured


def _thresholds(
    known: CrossValidation, wanted: Mapping[str, float], counted: NDArray[np.bool_]
) -> tuple[tuple[str, float], ...]:
    """Highest thresholds that reach the sensitivities on some held-out answers."""
    thresholds: list[tuple[str, float]] = []
    free = counted.copy()
    for label, share in wanted.items():
        k = known.classes.index(label)
        scores = known.probabilities[..., k]
        mine = counted & (known.y == k)
        # Those that an earlier class has taken are lost.
        left = np.sort(scores[mine & free])[::-1]
        needed = int(np.ceil(share * mine.sum() - 1e-9))
        if needed > len(left) or not mine.any():
            most = len(left) / max(int(mine.sum()), 1)
            raise ParameterError(
                f"A sensitivity of {share:g} for {label!r} cannot be reached: classes before it "
                f"leave it {most:.3f} at most.",
                remedy="Ask for less, or state the classes in another order.",
                details={"class": label, "most": most},
            )
        least = float(left[needed - 1])
        threshold = float(np.floor(least * 10**_DIGITS) / 10**_DIGITS)
        thresholds.append((label, threshold))
        free &= scores < threshold
    return tuple(thresholds)


def _matrix(
    classes: tuple[str, ...], costs: Mapping[str, Mapping[str, float]]
) -> tuple[tuple[float, ...], ...]:
    matrix = 1.0 - np.eye(len(classes))
    for true, row in costs.items():
        for answer, cost in row.items():
            _require_classes(classes, (true, answer))
            right = true == answer
            if not np.isfinite(cost) or cost < 0 or (right and cost != 0):
                raise ParameterError(
                    f"The cost of answering {answer!r} where {true!r} is true is {cost!r}.",
                    remedy="Use finite numbers, not below 0; the right answer costs nothing.",
                )
            matrix[classes.index(true), classes.index(answer)] = cost
    if not matrix.any():
        raise ParameterError(
            "No error costs anything, so any answer would do.", remedy="State a cost above 0."
        )
    return tuple(tuple(row) for row in matrix.tolist())


def _require_shares(classes: tuple[str, ...], wanted: Mapping[str, float]) -> None:
    _require_classes(classes, tuple(wanted))
    for label, share in wanted.items():
        if not (np.isfinite(share) and 0 < share <= 1):
            raise ParameterError(
                f"The sensitivity for {label!r} is {share!r}.",
                remedy="Use a share above 0, up to 1.",
            )
    if not wanted:
        raise ParameterError("No sensitivity is stated.", remedy="State one for a class at least.")


def _require_classes(classes: tuple[str, ...], named: tuple[str, ...]) -> None:
    for label in named:
        if label not in classes:
            raise ParameterError(
                f"The model does not know the class {str(label)[:80]!r}.",
                remedy=f"Use: {', '.join(classes)}.",
            )
