"""Templates: natural coordinates, weights, lengths and landmarks of a surface."""

from modalmotion.arguments.checking import check_arguments
from modalmotion.template.construction import make_template
from modalmotion.template.landmarks import GivenLandmarks, Landmarks
from modalmotion.template.numbered_modes import ModeChoice, choose_modes
from modalmotion.template.template import (
    Template,
    Weights,
    require_same_mesh,
    template_id,
)

__all__ = [
    "GivenLandmarks",
    "Landmarks",
    "ModeChoice",
    "Template",
    "Weights",
    "choose_modes",
    "make_template",
    "require_same_mesh",
    "template_id",
]

check_arguments(globals())
