"""Frequencies of modes on one surface, for waves of a stated speed."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ParameterError
from modalmotion.modes import Modes
from modalmotion.template.template import Template

FASTEST_WAVE: Final = 1e100
"""Largest wave speed, length unit per s: beyond it the energy, which contains its square, may
overflow."""


def require_wave_speed(wave_speed: float) -> None:
    """Refuse what no waves have.

    Raises
    ------
    ParameterError
    """
    if not 0 < wave_speed <= FASTEST_WAVE:
        raise ParameterError(
            f"The wave speed is {wave_speed}.",
            remedy=f"Use a speed above zero, at most {FASTEST_WAVE:g}.",
        )


def frequencies_of(modes: Modes, template: Template, wave_speed: float) -> NDArray[np.float64]:
    """Angular frequencies w = c k of modes on a template's surface.

    Parameters
    ----------
    modes : Modes
    template : Template
    wave_speed : float, length unit per s
        c.

    Returns
    -------
    (modes,) float64, rad per s

    Raises
    ------
    ParameterError
        If no waves have this speed, or a frequency is beyond the largest number.
    """
    require_wave_speed(wave_speed)
    with np.errstate(over="ignore"):
        frequencies = modes.frequencies_on(template, wave_speed)
    if not np.isfinite(frequencies).all():
        raise ParameterError(
            f"Waves of {wave_speed:g} length units per s on a surface of the lengths "
            f"{', '.join(f'{length:.3g}' for length in template.lengths)} have frequencies beyond "
            "the largest number.",
            remedy="State lengths in a smaller unit, or a smaller wave speed.",
        )
    return frequencies
