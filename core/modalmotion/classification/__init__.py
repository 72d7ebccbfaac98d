"""Motion classes: models, their training and tests, and their answers for signatures."""

from typing import TYPE_CHECKING

from modalmotion.arguments.checking import check_arguments
from modalmotion.classification.answer import (
    Classification,
    ModeContribution,
    classify,
)
from modalmotion.classification.card import ModelCard, card_markdown
from modalmotion.classification.cases import CaseFile, TrainingCase
from modalmotion.classification.evaluation import Comparison, Evaluation, compare_models, evaluate
from modalmotion.classification.feature_tables import FeatureTable, feature_table
from modalmotion.classification.model import Model
from modalmotion.classification.model_files import (
    DEFAULT_MODEL,
    NORMAL_DISPLACEMENT_MODEL,
    available_models,
    load_model,
    model_from_hdf5,
    model_to_hdf5,
    shipped_for,
)
from modalmotion.classification.options import TrainingOptions
from modalmotion.classification.outliers import FLAGS
from modalmotion.classification.performance import CrossValidation
from modalmotion.classification.training import train

if TYPE_CHECKING:
    from modalmotion.classification.scikit_learn import SignatureFeatures

__all__ = [
    "DEFAULT_MODEL",
    "FLAGS",
    "NORMAL_DISPLACEMENT_MODEL",
    "CaseFile",
    "Classification",
    "Comparison",
    "CrossValidation",
    "Evaluation",
    "FeatureTable",
    "ModeContribution",
    "Model",
    "ModelCard",
    "SignatureFeatures",
    "TrainingCase",
    "TrainingOptions",
    "available_models",
    "card_markdown",
    "classify",
    "compare_models",
    "evaluate",
    "feature_table",
    "load_model",
    "model_from_hdf5",
    "model_to_hdf5",
    "shipped_for",
    "train",
]

check_arguments(globals())


def __getattr__(name: str) -> object:
    """Import a public name (PEP 562): it needs scikit-learn, which takes a second."""
    if name == "SignatureFeatures":
        from modalmotion.classification.scikit_learn import SignatureFeatures

        return SignatureFeatures
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
