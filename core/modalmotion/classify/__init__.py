"""Motion classes: models that are trained, tested and asked, and what they say of a signature."""

from modalmotion.classify.card import ModelCard
from modalmotion.classify.cases import CaseFile, TrainingCase
from modalmotion.classify.classification import FLAGS, Classification
from modalmotion.classify.classifier import classify
from modalmotion.classify.evaluation import Evaluation, evaluate
from modalmotion.classify.explanation import ModeContribution, only_modes
from modalmotion.classify.model import Model
from modalmotion.classify.model_file import model_from_bytes, model_to_bytes
from modalmotion.classify.options import TrainingOptions
from modalmotion.classify.shipped import DEFAULT_MODEL, available_models, load_model
from modalmotion.classify.training import train

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
    "model_from_bytes",
    "model_to_bytes",
    "only_modes",
    "train",
]
