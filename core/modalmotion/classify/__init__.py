"""Motion classes: models that are trained, tested and asked, and what they say of a signature."""

from modalmotion.classify.answer.classification import FLAGS, Classification
from modalmotion.classify.answer.classifier import classify
from modalmotion.classify.answer.explanation import ModeContribution, only_modes
from modalmotion.classify.model.card import ModelCard
from modalmotion.classify.model.hdf5 import model_from_hdf5, model_to_hdf5
from modalmotion.classify.model.model import Model
from modalmotion.classify.model.shipped import DEFAULT_MODEL, available_models, load_model
from modalmotion.classify.options import TrainingOptions
from modalmotion.classify.training.cases import CaseFile, TrainingCase
from modalmotion.classify.training.evaluation import Evaluation, evaluate
from modalmotion.classify.training.training import train

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
