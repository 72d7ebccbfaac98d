"""The answer of a classifier for one sequence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modalmotion.arguments.tasks import Plotted, Saved
from modalmotion.classification.answer.explanation import ModeContribution
from modalmotion.representation import shown


@shown("label", "probability", "class_set", "coverage", "flags", "model")
@dataclass(frozen=True, eq=False)
class Classification(Saved, Plotted):
    """A motion class with its probability, or none where the model cannot tell.

    Parameters
    ----------
    sequence_id : str
    model : str
        Name of the model.
    model_id : str
        sha256 of the model's arrays, in hex.
    label : str or None
        The most probable class, or what the model's `Decision` chooses; None where the model
        abstains (see `notes`).
    classes : tuple of str
    probabilities : (classes,) float64
        They add up to 1.
    class_set : tuple of str
        Classes that cannot be ruled out: of cases like the training ones it holds the true
        class with the probability `coverage`, whatever the class is. Empty where the case is
        like none at this level: a note says so.
    coverage : float
        The requested level.
    flags : tuple of str
        Of `flags.FLAGS`; empty where nothing speaks against the answer.
    explanation : tuple of ModeContribution
        Modes that moved the prediction, the strongest first; may be empty.
    notes : tuple of str
        Why it abstains, and what a user should know of the model.
    provenance : dict
        Versions of the software that made it.
    """

    sequence_id: str
    model: str
    model_id: str
    label: str | None
    classes: tuple[str, ...]
    probabilities: NDArray[np.float64]
    class_set: tuple[str, ...]
    coverage: float
    flags: tuple[str, ...]
    explanation: tuple[ModeContribution, ...]
    notes: tuple[str, ...]
    provenance: dict[str, str]

    @property
    def probability(self) -> float:
        """Probability of the label; where there is none, of the most probable class."""
        if self.label is None:
            return float(self.probabilities.max())
        return float(self.probabilities[self.classes.index(self.label)])
