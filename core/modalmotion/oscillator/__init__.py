"""Oscillators: the dynamics of modes, each advanced exactly over any time."""

from modalmotion.oscillator.damping import nodal_damping, rayleigh_damping
from modalmotion.oscillator.forces import modal_forces
from modalmotion.oscillator.oscillators import Oscillators, State, energy, phase_error
from modalmotion.oscillator.responses import (
    free_response,
    free_states,
    impulse_response,
    ramp_response,
    step_response,
)
from modalmotion.oscillator.stepping import ExactStep, driven_states, exact_step

__all__ = [
    "ExactStep",
    "Oscillators",
    "State",
    "driven_states",
    "energy",
    "exact_step",
    "free_response",
    "free_states",
    "impulse_response",
    "modal_forces",
    "nodal_damping",
    "phase_error",
    "ramp_response",
    "rayleigh_damping",
    "step_response",
]
