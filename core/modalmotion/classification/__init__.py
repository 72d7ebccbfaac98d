"""Motion classes: models, their training and tests, and their answers for signatures."""

from typing import TYPE_CHECKING

from modalmotion.arguments.checking import check_arguments
from modalmotion.classification.answer.classification import Classification
from modalmotion.classification.answer.classifier import classify
from modalmotion.classification.answer.explanation import ModeContribution, only_modes
from modalmotion.classification.answer.flags import FLAGS
from modalmotion.classification.evaluation.comparison import Comparison, compare_models
from modalmotion.classification.evaluation.deciding import decided
from modalmotion.classification.evaluation.evaluation import Evaluation, evaluate
from modalmotion.classification.model.card import ModelCard
from modalmotion.classification.model.cross_validation import CrossValidation
from modalmotion.classification.model.hdf5 import model_from_hdf5, model_to_hdf5
from modalmotion.classification.model.markdown import card_markdown
from modalmotion.classification.model.model import Model
from modalmotion.classification.model.shipped import (
    DEFAULT_MODEL,
    OFFSET_MODEL,
    available_models,
    load_model,
    shipped_for,
)
from modalmotion.classification.options import TrainingOptions
from modalmotion.classification.tables.cohort_table import FeatureTable, feature_table
from modalmotion.classification.training.cases import CaseFile, TrainingCase
from modalmotion.classification.training.training import train

if TYPE_CHECKING:
    from modalmotion.classification.estimators.estimator import MotionClassifier
    from modalmotion.classification.tables.signature_features import SignatureFeatures

__all__ = [
    "DEFAULT_MODEL",
    "FLAGS",
    "OFFSET_MODEL",
    "CaseFile",
    "Classification",
    "Comparison",
    "CrossValidation",
    "Evaluation",
    "FeatureTable",
    "ModeContribution",
    "Model",
    "ModelCard",
    "MotionClassifier",
    "SignatureFeatures",
    "TrainingCase",
    "TrainingOptions",
    "available_models",
    "card_markdown",
    "classify",
    "compare_models",
    "decided",
    "evaluate",
    "feature_table",
    "load_model",
    "model_from_hdf5",
    "model_to_hdf5",
    "only_modes",
    "shipped_for",
    "train",
]

check_arguments(globals())


def __getattr__(name: str) -> object:
    """Import a public name (PEP 562): these two need scikit-learn, which takes a second."""
    if name == "MotionClassifier":
        from modalmotion.classification.estimators.estimator import MotionClassifier

        return MotionClassifier
    if name == "SignatureFeatures":
        from modalmotion.classification.tables.signature_features import SignatureFeatures

        return SignatureFeatures
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
