"""What a classifier says of one sequence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Classification:
    """A motion class with its probability, or none where the model cannot tell.

    Parameters
    ----------
    sequence_id : str
    model : str
        Name of the model.
    model_id : str
        sha256 of the model's arrays, in hex.
    label : str or None
        The most probable class; None where the model abstains (see `notes`).
    classes : tuple of str
    probabilities : (classes,) float64
        They add up to 1.
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
    notes: tuple[str, ...]
    provenance: dict[str, str]

    @property
    def probability(self) -> float:
        """Probability of the most probable class."""
        return float(self.probabilities.max())
