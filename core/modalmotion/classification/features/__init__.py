"""Features of a motion: numbers that do not depend on pose, size, start angle or sampling."""

from modalmotion.classification.features.alignment import align, mean_motion
from modalmotion.classification.features.axis import READINGS, AxisReading, axis_features
from modalmotion.classification.features.axis_parts import has_axis
from modalmotion.classification.features.columns import (
    Column,
    Columns,
    MotionFeatures,
    MotionValues,
    kind_of,
)
from modalmotion.classification.features.further import (
    CovariateColumn,
    Further,
    covariate_columns,
    further_columns,
    further_values,
    has_volume,
)
from modalmotion.classification.features.known import KnownFeatures
from modalmotion.classification.features.motion_terms import MotionTerms, surface_size
from modalmotion.classification.features.reader import FeatureReader, motion_of
from modalmotion.classification.features.readings import like_most, nearest, right_handed

__all__ = [
    "READINGS",
    "AxisReading",
    "Column",
    "Columns",
    "CovariateColumn",
    "FeatureReader",
    "Further",
    "KnownFeatures",
    "MotionFeatures",
    "MotionTerms",
    "MotionValues",
    "align",
    "axis_features",
    "covariate_columns",
    "further_columns",
    "further_values",
    "has_axis",
    "has_volume",
    "kind_of",
    "like_most",
    "mean_motion",
    "motion_of",
    "nearest",
    "right_handed",
    "surface_size",
]
