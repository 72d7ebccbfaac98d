"""Modes of lattices: labels, order, shapes, transforms, and their dynamics, equation (3)."""

from typing import TYPE_CHECKING

from modalmotion.arguments.public import public_list

if TYPE_CHECKING:
    from modalmotion.modes.mode_set import ModeSet as ModeSet
    from modalmotion.modes.mode_set import all_modes as all_modes
    from modalmotion.modes.mode_set import lowest_modes as lowest_modes
    from modalmotion.modes.mode_set import wave_pairs as wave_pairs
    from modalmotion.modes.mode_set import whole_count as whole_count
    from modalmotion.modes.mode_set import whole_counts as whole_counts
    from modalmotion.modes.oscillators import Oscillators as Oscillators
    from modalmotion.modes.oscillators import State as State
    from modalmotion.modes.oscillators import animate_along as animate_along
    from modalmotion.modes.oscillators import directional_mode as directional_mode
    from modalmotion.modes.oscillators import energy as energy
    from modalmotion.modes.oscillators import modal_forces as modal_forces
    from modalmotion.modes.oscillators import nodal_damping as nodal_damping
    from modalmotion.modes.oscillators import phase_error as phase_error
    from modalmotion.modes.oscillators import rayleigh_damping as rayleigh_damping
    from modalmotion.modes.potential import HarmonicPotential as HarmonicPotential
    from modalmotion.modes.potential import PolarisedWaves as PolarisedWaves
    from modalmotion.modes.potential import dynamical_matrices as dynamical_matrices
    from modalmotion.modes.potential import polarised_waves as polarised_waves
    from modalmotion.modes.potential import wave_field as wave_field
    from modalmotion.modes.responses import free_response as free_response
    from modalmotion.modes.responses import free_states as free_states
    from modalmotion.modes.responses import impulse_response as impulse_response
    from modalmotion.modes.responses import ramp_response as ramp_response
    from modalmotion.modes.responses import step_response as step_response
    from modalmotion.modes.stepping import ExactStep as ExactStep
    from modalmotion.modes.stepping import driven_states as driven_states
    from modalmotion.modes.stepping import exact_step as exact_step
    from modalmotion.modes.topology import ModeLabel as ModeLabel
    from modalmotion.modes.topology import Modes as Modes
    from modalmotion.modes.waves import dispersion as dispersion
    from modalmotion.modes.waves import first_zone as first_zone
    from modalmotion.modes.waves import group_velocity as group_velocity
    from modalmotion.modes.waves import modal_state as modal_state
    from modalmotion.modes.waves import mode_oscillators as mode_oscillators
    from modalmotion.modes.waves import phase_velocity as phase_velocity
    from modalmotion.modes.waves import propagate as propagate
    from modalmotion.modes.waves import travelling_wave as travelling_wave
    from modalmotion.modes.waves import wave_vectors as wave_vectors

__all__, __getattr__, __dir__ = public_list(globals())
