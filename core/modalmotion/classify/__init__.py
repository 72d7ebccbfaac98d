"""Motion classes: models as plain arrays, and what they say of a signature."""

from modalmotion.classify.classification import Classification
from modalmotion.classify.classifier import classify
from modalmotion.classify.model import (
    DEFAULT_MODEL,
    Model,
    available_models,
    load_model,
    model_from_json,
    model_to_json,
)

__all__ = [
    "DEFAULT_MODEL",
    "Classification",
    "Model",
    "available_models",
    "classify",
    "load_model",
    "model_from_json",
    "model_to_json",
]
