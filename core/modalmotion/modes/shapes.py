"""Mode shapes and frequencies of a continuum, evaluated at natural coordinates.

The limit of fine lattices: the shapes solve (6) between the nodes too, and the frequencies are
those of (7) while waves are long. Equation numbers are those of Nastar (1994).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from modalmotion.modes.label import ModeSet, scales_of
from modalmotion.modes.topology import CLOSED, End


def shapes_at(modes: ModeSet, coordinates: NDArray[np.float64]) -> NDArray[np.float64]:
    """Evaluate mode shapes Phi, the solutions of (6), at natural coordinates.

    Parameters
    ----------
    modes : ModeSet
    coordinates : (vertices, axes) float64
        s in [0, 1] on open and pole axes, theta in turns on closed ones.

    Returns
    -------
    (vertices, modes) float64
        Phi, each column with mean square 1 over the natural coordinates, whatever surface they map.
        At a pole every mode that turns about it is zero.
    """
    # (6) phi = scale * product over the axes of
    #     open:    cos(p pi s)
    #     closed:  cos or sin(2 pi p theta), of all closed axes together cos or sin(a + b)
    #     cup:     cos(r pi s) where p' is even, sin((r + 1/2) pi s) where it is odd
    #     sphere:  cos(r pi s) where p' is even, sin((r + 1) pi s) where it is odd
    shapes = np.full((len(coordinates), len(modes)), scales_of(modes.n_waves))
    phase = np.zeros_like(shapes)
    for axis, ends in enumerate(modes.topology.ends):
        x = coordinates[:, axis, None]
        h = modes.half_periods[:, axis]
        if ends == CLOSED:
            phase += 2 * np.pi * h * x
        else:
            odd = modes.is_odd_at_pole[:, axis]
            y = h * (np.pi / 2) * x
            shapes *= np.where(odd, np.sin(y), np.cos(y))
        if End.POLE in ends:
            on_pole = x <= 0 if ends[1] != End.POLE else (x <= 0) | (x >= 1)
            turns = modes.wavenumbers[:, axis + 1] != 0
            shapes[on_pole & turns] = 0.0
    if modes.topology.closed_axes:
        shapes *= np.where(modes.is_sine, np.sin(phase), np.cos(phase))
    return shapes


def wavenumbers_on(modes: ModeSet, lengths: tuple[float, ...]) -> NDArray[np.float64]:
    """Physical wavenumbers |k| on a surface with the given axis lengths.

    Parameters
    ----------
    modes : ModeSet
    lengths : tuple of float
        Length along each axis (circumference on closed ones).

    Returns
    -------
    (modes,) float64, rad per length unit
    """
    k = np.zeros(len(modes))
    for axis, ends in enumerate(modes.topology.ends):
        half_turn = 2 * np.pi if ends == CLOSED else np.pi / 2
        # hypot, for the squares of very short lengths overflow.
        k = np.hypot(k, half_turn * modes.half_periods[:, axis] / lengths[axis])
    return k
