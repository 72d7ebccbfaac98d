"""Deviation of a recording from one's own controls."""

from modalmotion.arguments.checking import check_arguments
from modalmotion.norm.deviations import (
    CohortDeviation,
    Deviation,
    GroupDeviation,
    QuantityDeviation,
)
from modalmotion.norm.norm import (
    Norm,
    cohort_deviation,
    norm_from_hdf5,
    norm_to_hdf5,
    train_norm,
)

__all__ = [
    "CohortDeviation",
    "Deviation",
    "GroupDeviation",
    "Norm",
    "QuantityDeviation",
    "cohort_deviation",
    "norm_from_hdf5",
    "norm_to_hdf5",
    "train_norm",
]

check_arguments(globals())
