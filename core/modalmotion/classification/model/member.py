"""One of the choices of features that a model weighs, with its estimator."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.estimators.machine import machine_log_shares
from modalmotion.classification.estimators.scorer import Blend
from modalmotion.classification.features import Column, FeatureReader
from modalmotion.representation import shown


@shown("reader.description", "weight")
@dataclass(frozen=True, eq=False)
class Member:
    """A choice of features, and what it says of classes.

    Parameters
    ----------
    reader : FeatureReader
    columns : tuple of Column
        The features.
    blend : Blend
        Standardisation and scorers; without scorers where there is a machine.
    machine : bytes
        skops archive of an estimator that is not plain arrays; empty otherwise.
    weight : float
        In the pool of all members.
    """

    reader: FeatureReader
    columns: tuple[Column, ...]
    blend: Blend
    machine: bytes
    weight: float

    @property
    def features(self) -> list[tuple[object, ...]]:
        """What each feature is: equal ones, of this or another member, have equal values."""
        reader = self.reader
        return [(reader.motion_key, reader.covariates, column) for column in self.columns]

    def log_shares(self, features: NDArray[np.float64]) -> NDArray[np.float64]:
        """Log probabilities up to a constant, (cases, classes), of features (cases, features)."""
        if self.machine:
            return machine_log_shares(self.machine, features)
        return self.blend.log_shares(features)
