"""Modes: labels, their fixed order, shapes and wavenumbers."""

from modalmotion.modes.label import ModeLabel, ModeSet
from modalmotion.modes.order import all_modes, lowest_modes, whole_count
from modalmotion.modes.shapes import shapes_at, wavenumbers_on

__all__ = [
    "ModeLabel",
    "ModeSet",
    "all_modes",
    "lowest_modes",
    "shapes_at",
    "wavenumbers_on",
    "whole_count",
]
