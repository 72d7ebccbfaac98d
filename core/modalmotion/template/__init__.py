"""Templates: natural coordinates, weights, lengths and landmarks of a surface."""

from modalmotion.template.surface import Landmarks
from modalmotion.template.template import Template, Weights, make_template

__all__ = ["Landmarks", "Template", "Weights", "make_template"]
