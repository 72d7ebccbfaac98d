"""Phonons: waves on lattices, how fast they travel, and shapes moved by them."""

from modalmotion.phonons.animation import animate, animate_along, directional_mode, vibrate
from modalmotion.phonons.dispersion import (
    dispersion,
    first_zone,
    group_velocity,
    phase_velocity,
    wave_vectors,
)
from modalmotion.phonons.dynamical_matrix import (
    PolarisedWaves,
    dynamical_matrices,
    polarised_waves,
    wave_field,
)
from modalmotion.phonons.potential import HarmonicPotential
from modalmotion.phonons.waves import modal_state, mode_oscillators, propagate, travelling_wave

__all__ = [
    "HarmonicPotential",
    "PolarisedWaves",
    "animate",
    "animate_along",
    "directional_mode",
    "dispersion",
    "dynamical_matrices",
    "first_zone",
    "group_velocity",
    "modal_state",
    "mode_oscillators",
    "phase_velocity",
    "polarised_waves",
    "propagate",
    "travelling_wave",
    "vibrate",
    "wave_field",
    "wave_vectors",
]
