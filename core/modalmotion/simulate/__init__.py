"""Simulated left ventricles with known motion, and labelled cohorts of them."""

from modalmotion.arguments.checking import check_arguments
from modalmotion.simulate.cohort import Case, MotionClass, draw_parameters, simulate_cohort
from modalmotion.simulate.parameters import Territory, VentricleParameters
from modalmotion.simulate.phantom import ImageKind, Phantom, PhantomSettings, simulate_images
from modalmotion.simulate.surface import Pose, Spacing
from modalmotion.simulate.ventricle import Acquisition, simulate_ventricle

__all__ = [
    "Acquisition",
    "Case",
    "ImageKind",
    "MotionClass",
    "Phantom",
    "PhantomSettings",
    "Pose",
    "Spacing",
    "Territory",
    "VentricleParameters",
    "draw_parameters",
    "simulate_cohort",
    "simulate_images",
    "simulate_ventricle",
]

check_arguments(globals())
