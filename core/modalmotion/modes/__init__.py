"""Modes: labels, their fixed order, shapes and wavenumbers."""

from modalmotion.arguments.checking import check_arguments
from modalmotion.modes.label import ModeLabel
from modalmotion.modes.mode_set import ModeSet
from modalmotion.modes.modes import Modes, wave_pairs, whole_counts
from modalmotion.modes.order import all_modes, lowest_modes, whole_count

__all__ = [
    "ModeLabel",
    "ModeSet",
    "Modes",
    "all_modes",
    "lowest_modes",
    "wave_pairs",
    "whole_count",
    "whole_counts",
]

check_arguments(globals())
