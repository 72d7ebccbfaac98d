"""Motion classes: models, their training and tests, and their answers for signatures."""

from modalmotion.classification.answer.classification import Classification
from modalmotion.classification.answer.classifier import classify
from modalmotion.classification.answer.explanation import ModeContribution, only_modes
from modalmotion.classification.answer.flags import FLAGS
from modalmotion.classification.model.card import ModelCard
from modalmotion.classification.model.hdf5 import model_from_hdf5, model_to_hdf5
from modalmotion.classification.model.model import Model
from modalmotion.classification.model.shipped import DEFAULT_MODEL, available_models, load_model
from modalmotion.classification.options import TrainingOptions
from modalmotion.classification.training.cases import CaseFile, TrainingCase
from modalmotion.classification.training.evaluation import Evaluation, evaluate
from modalmotion.classification.training.training import train

__all__ = [
    "DEFAULT_MODEL",
    "FLAGS",
    "CaseFile",
    "Classification",
    "Evaluation",
    "ModeContribution",
    "Model",
    "ModelCard",
    "TrainingCase",
    "TrainingOptions",
    "available_models",
    "classify",
    "evaluate",
    "load_model",
    "model_from_hdf5",
    "model_to_hdf5",
    "only_modes",
    "train",
]
