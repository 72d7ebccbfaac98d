"""Modes of lattices: labels, order, shapes, transforms, and their dynamics, equation (3)."""

from typing import TYPE_CHECKING

from modalmotion.arguments.public import public_list

if TYPE_CHECKING:
    from modalmotion.modes.mode_set import ModeSet as ModeSet
    from modalmotion.modes.mode_set import all_modes as all_modes
    from modalmotion.modes.mode_set import lowest_modes as lowest_modes
    from modalmotion.modes.mode_set import whole_count as whole_count
    from modalmotion.modes.oscillators import ExactStep as ExactStep
    from modalmotion.modes.oscillators import Oscillators as Oscillators
    from modalmotion.modes.oscillators import State as State
    from modalmotion.modes.oscillators import driven_states as driven_states
    from modalmotion.modes.oscillators import energy as energy
    from modalmotion.modes.oscillators import exact_step as exact_step
    from modalmotion.modes.oscillators import free_response as free_response
    from modalmotion.modes.oscillators import impulse_response as impulse_response
    from modalmotion.modes.oscillators import phase_error as phase_error
    from modalmotion.modes.oscillators import ramp_response as ramp_response
    from modalmotion.modes.oscillators import step_response as step_response
    from modalmotion.modes.topologies import ModeLabel as ModeLabel
    from modalmotion.modes.waves import dispersion as dispersion
    from modalmotion.modes.waves import dynamical_matrices as dynamical_matrices
    from modalmotion.modes.waves import group_velocity as group_velocity
    from modalmotion.modes.waves import phase_velocity as phase_velocity
    from modalmotion.modes.waves import polarised_waves as polarised_waves
    from modalmotion.modes.waves import wave_vectors as wave_vectors

__all__, __getattr__, __dir__ = public_list(globals())
