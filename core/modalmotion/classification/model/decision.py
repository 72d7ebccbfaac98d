"""Decision: how probabilities become a label, where it is not the most probable class."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from modalmotion.representation import shown


@shown("thresholds", "costs")
@dataclass(frozen=True)
class Decision:
    """A rule that a user states; probabilities and class sets stay as they are.

    Part of the model's id, for labels depend on it: another rule makes another model.

    Parameters
    ----------
    classes : tuple of str
        Of the model.
    thresholds : tuple of (str, float)
        The first of these classes whose probability reaches its threshold is the label; if none
        does, the most probable of the others is.
    costs : tuple of tuple of float
        Rows are true classes, columns answers: the label is the answer with the least expected
        cost. Empty where there are thresholds.
    """

    classes: tuple[str, ...]
    thresholds: tuple[tuple[str, float], ...] = ()
    costs: tuple[tuple[float, ...], ...] = ()

    @property
    def text(self) -> str:
        """The rule, in words."""
        if self.costs:
            return "The label is the answer with the least expected cost, by the stated costs."
        rules = ", else ".join(f"{label} from {share:.3g}" for label, share in self.thresholds)
        return (
            f"The label is decided by thresholds of the probability: {rules}, else the most "
            "probable other class."
        )

    def labels(self, probabilities: NDArray[np.float64]) -> NDArray[np.int64]:
        """Choose among the classes, the last axis, of probabilities of any shape.

        Notes
        -----
        Costs: Elkan, The foundations of cost-sensitive learning, IJCAI, 2001, equation 1.
        """
        if self.costs:
            expected = probabilities @ np.array(self.costs)
            cheapest: NDArray[np.int64] = expected.argmin(axis=-1)
            return cheapest
        rest = probabilities.copy()
        places = [(self.classes.index(label), share) for label, share in self.thresholds]
        if len(places) < len(self.classes):
            rest[..., [k for k, _ in places]] = -1.0
        labels: NDArray[np.int64] = rest.argmax(axis=-1)
        for k, share in reversed(places):
            labels = np.where(probabilities[..., k] >= share, k, labels)
        return labels

    def as_json(self) -> dict[str, Any]:
        """Return the rule as JSON-able values."""
        return {
            "thresholds": [list(pair) for pair in self.thresholds],
            "costs": [list(row) for row in self.costs],
        }

    @staticmethod
    def from_json(classes: tuple[str, ...], values: Mapping[str, Any]) -> Decision:
        """Read the output of `as_json`.

        Raises
        ------
        KeyError, TypeError, ValueError
            If it does not fit the classes.
        """
        decision = Decision(
            classes,
            tuple((str(label), float(share)) for label, share in values["thresholds"]),
            tuple(tuple(map(float, row)) for row in values["costs"]),
        )
        n = len(classes)
        if bool(decision.costs) == bool(decision.thresholds) or (
            {label for label, _ in decision.thresholds} - set(classes)
            or (decision.costs and np.shape(decision.costs) != (n, n))
        ):
            raise ValueError("the decision does not fit the classes of the model")
        return decision
