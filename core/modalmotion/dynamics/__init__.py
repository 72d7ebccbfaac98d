"""Dynamics of modes: oscillators (3) advanced exactly, and phonons, waves on lattices."""

from modalmotion.arguments.checking import check_arguments
from modalmotion.dynamics.animation import animate_along, directional_mode
from modalmotion.dynamics.damping import nodal_damping, rayleigh_damping
from modalmotion.dynamics.dispersion_relation import (
    dispersion,
    first_zone,
    group_velocity,
    phase_velocity,
    wave_vectors,
)
from modalmotion.dynamics.dynamical_matrix import (
    PolarisedWaves,
    dynamical_matrices,
    polarised_waves,
    wave_field,
)
from modalmotion.dynamics.forces import modal_forces
from modalmotion.dynamics.oscillators import Oscillators, State, energy, phase_error
from modalmotion.dynamics.potential import HarmonicPotential
from modalmotion.dynamics.responses import (
    free_response,
    free_states,
    impulse_response,
    ramp_response,
    step_response,
)
from modalmotion.dynamics.stepping import ExactStep, driven_states, exact_step
from modalmotion.dynamics.waves import modal_state, mode_oscillators, propagate, travelling_wave

__all__ = [
    "ExactStep",
    "HarmonicPotential",
    "Oscillators",
    "PolarisedWaves",
    "State",
    "animate_along",
    "directional_mode",
    "dispersion",
    "driven_states",
    "dynamical_matrices",
    "energy",
    "exact_step",
    "first_zone",
    "free_response",
    "free_states",
    "group_velocity",
    "impulse_response",
    "modal_forces",
    "modal_state",
    "mode_oscillators",
    "nodal_damping",
    "phase_error",
    "phase_velocity",
    "polarised_waves",
    "propagate",
    "ramp_response",
    "rayleigh_damping",
    "step_response",
    "travelling_wave",
    "wave_field",
    "wave_vectors",
]

check_arguments(globals())
